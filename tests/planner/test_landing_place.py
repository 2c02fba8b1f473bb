"""Where a robot in the air comes down: off a table, and where its flight gets no farther."""

from __future__ import annotations

import numpy as np
from planner_rig import CONFIG, looked_round

from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.planner.pipeline import DESCENTS_MAX, Pipeline
from labr_autonomy.types import Mode, Pose

PERIOD_S = 0.1
TABLE_M = 0.9  # half of its edge
UPRIGHT = quaternion_from_rpy(0.0, 0.0, 0.0)


def seen_from(height_m, *boxes):
    """A pipeline that has seen open space all round, but for boxes (x0, y0, z0, x1, y1, z1)."""
    pipeline = Pipeline(CONFIG, network=False)
    grid = looked_round(pipeline, Pose(np.array([0.0, 0.0, height_m]), UPRIGHT))
    grid.driving.heights_mm[:] = 0
    grid.log_odds[:] = -40
    for box in boxes:
        low, high = (
            np.round((np.array(box[k : k + 3]) - grid.origin_m) / grid.cell_m).astype(int) for k in (0, 3)
        )
        low = np.maximum(low, 0)
        grid.log_odds[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = 60
    grid.log_odds[:, :, : round(-grid.origin_m[2] / grid.cell_m)] = 60
    return pipeline


def flown(pipeline, place, goal, seconds, *, in_air, until):
    """Fly as planned until something holds; the results on the way and the last place."""
    place, goal = np.array(place), np.array(goal)
    velocity, acceleration, yaw, results = np.zeros(3), np.zeros(3), 0.0, []
    for k in range(round(seconds / PERIOD_S)):
        pose = Pose(place.copy(), quaternion_from_rpy(0.0, 0.0, yaw))
        motion = Motion(place.copy(), velocity, acceleration, yaw, 0.0, 0.0)
        request = PlanRequest(k, 0, pose, pose, PERIOD_S * k, motion, Mode.AIR, goal, in_air, 0.0, 1.5)
        results.append(pipeline.cycle(request, None))
        if until(results[-1]):
            break
        s = results[-1].trajectory.sample(PERIOD_S * (k + 1))
        place, velocity, acceleration, yaw = s.position_m, s.velocity_mps, s.acceleration_mps2, s.yaw_rad
    return results, place


def test_it_flies_off_the_table_before_it_may_come_down():
    pipeline = seen_from(1.5, (-TABLE_M, -TABLE_M, 0.6, TABLE_M, TABLE_M, 0.75))
    goal = (0.1, 0.0, CONFIG.body.below_m)
    results, place = flown(
        pipeline, (0.1, 0.0, 1.5), goal, 20.0, in_air=False, until=lambda r: r.landing_clear
    )
    assert not results[0].landing_clear
    assert results[-1].landing_clear
    off_m = np.abs(place[:2]).max() - TABLE_M
    assert off_m > CONFIG.body.radius_m + CONFIG.clearance.landing_m - 0.1
    assert off_m < 1.5, "and no farther than it must"


CURTAIN = (
    2.0,
    -10.0,
    0.6,
    2.2,
    10.0,
    3.5,
)  # right across the way of a flight; there is room to drive under it


def test_a_flight_that_is_held_up_comes_down_to_drive_on():
    pipeline, goal = seen_from(1.5, CURTAIN), (5.0, 0.0, 1.5)

    def done(result):
        return result.stuck or (result.hop and result.landing_clear)

    results, place = flown(pipeline, (0.0, 0.0, 1.5), goal, 30.0, in_air=True, until=done)
    assert not results[-1].stuck
    assert results[-1].hop
    assert place[0] < 2.0


def test_it_comes_down_so_twice_at_most():
    pipeline, goal = seen_from(1.5, CURTAIN), (5.0, 0.0, 1.5)
    flown(pipeline, (0.0, 0.0, 1.5), goal, 0.1, in_air=True, until=lambda r: False)
    pipeline._descents = DESCENTS_MAX
    results, _ = flown(pipeline, (0.0, 0.0, 1.5), goal, 30.0, in_air=True, until=lambda r: r.stuck)
    assert results[-1].stuck
    assert not any(r.hop for r in results)


def test_another_goal_is_flown_to_again():
    pipeline = seen_from(1.5, CURTAIN)
    results, place = flown(
        pipeline, (0.0, 0.0, 1.5), (5.0, 0.0, 1.5), 30.0, in_air=True, until=lambda r: r.hop
    )
    assert results[-1].hop
    after, _ = flown(pipeline, place, (-3.0, 0.0, 1.5), 0.2, in_air=True, until=lambda r: False)
    assert not after[-1].hop
