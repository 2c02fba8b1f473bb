"""When it pays to fly over what is in the way of a goal on land, and where to come down."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.perception.fields import Field2
from labr_autonomy.planner.hops import ALOFT_MAX_S, Hops
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.planner.refusals import WAITS_S, Refusals
from labr_autonomy.refine.search import CostToGo
from labr_autonomy.types import Mode, Pose

CONFIG = RobotConfig()
WORTH_M = EnergyModel.of(CONFIG).detour_worth_flying_m(0.0, 0.0)
SIDE_M, CELL_M, HARD_M = 70.0, 0.1, 0.36
NONE = Refusals(0.4)
GOAL = np.array([25.0, 5.0, 0.12])
STILL = np.array([1.0, 0.0, 0.0, 0.0])
OPEN = ()


def plan(*boxes):
    """A square with solid boxes (x0, y0, x1, y1) and a wall all round."""
    n = round(SIDE_M / CELL_M)
    occupied = np.zeros((n, n), bool)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    for box in boxes:
        x0, y0, x1, y1 = np.round(np.array(box) / CELL_M).astype(int)
        occupied[x0:x1, y0:y1] = True
    return Field2.from_occupied(occupied, np.ones_like(occupied), np.zeros(2), CELL_M)


def fence(length_m):
    """From one side of the square across the straight way to the goal."""
    return (20.0, 0.0, 20.2, length_m)


class Seen:
    """The rolling map at the height of flight, and between floor and there."""

    cell_m = CELL_M

    def __init__(self, high=OPEN, column=None):
        self._layer, self._column = plan(*high), plan(*(high if column is None else column))

    def slice_field(self, pose, floor_z_m):
        return self._layer

    def column_field(self, low_m, high_m):
        return self._column


def request(x, y, mode=Mode.LAND, now_s=0.0, **changes):
    place = np.array([x, y, 0.12 if mode is Mode.LAND else 1.3])
    motion = Motion(place, np.zeros(3), np.zeros(3), 0.0, 0.0, 0.0)
    pose = Pose(place, STILL)
    asked = PlanRequest(1, 1, pose, pose, now_s, motion, mode, GOAL, False, 0.0, 1.3)
    return replace(asked, **changes)


def on_land(hops, asked, *boxes):
    drive = plan(*boxes)
    land = CostToGo(drive, GOAL[:2], HARD_M)
    ways = hops.on_land(asked, drive, land, lambda o: CostToGo(drive, GOAL[:2], HARD_M, offers=o))
    return ways, hops.planned(ways, asked.body_pose.position_m)


def test_a_long_fence_is_flown_over_from_close_by():
    asked = request(15.0, 5.0)
    ways, hops = on_land(Hops(CONFIG, Seen(), HARD_M, NONE), asked, fence(60.0))
    assert hops
    end = ways.end(np.array([15.0, 5.0]))
    assert 18.5 < end[0] < 20.0 - HARD_M
    assert abs(end[1] - 5.0) < 0.5


@pytest.mark.parametrize(("more_m", "flies"), [(-6.0, False), (12.0, True)])
def test_it_flies_when_the_detour_is_longer_than_the_closed_form_says(more_m, flies):
    """The way round the fence is twice as long as it reaches past the robot; the hop costs metres too."""
    asked = request(17.0, 5.0)
    _, hops = on_land(Hops(CONFIG, Seen(), HARD_M, NONE), asked, fence(5.0 + (WORTH_M + more_m) / 2.0))
    assert hops is flies


@pytest.mark.parametrize(
    "why",
    [
        {"seen": Seen(high=[fence(69.0)])},  # the fence is a wall
        {"may_hop": False},  # the mission says ground, or the battery is low
        {"seen": Seen(column=[(5.0, 0.0, 19.9, 14.0)])},  # no room to take off near by
    ],
    ids=["wall", "not allowed", "no room above"],
)
def test_it_drives_round_where_it_cannot_fly(why):
    asked = request(15.0, 5.0, may_hop=why.get("may_hop", True))
    ways, hops = on_land(Hops(CONFIG, why.get("seen", Seen()), HARD_M, NONE), asked, fence(60.0))
    assert not hops
    assert ways.end(np.array([15.0, 5.0])) == pytest.approx(GOAL[:2], abs=0.11)


def test_it_comes_down_behind_the_fence_and_not_before():
    hops = Hops(CONFIG, Seen(column=[fence(60.0)]), HARD_M, NONE)
    land = CostToGo(plan(fence(60.0)), GOAL[:2], HARD_M)
    may = {x: hops.may_land(request(x, 5.0, Mode.AIR, x), land, True) for x in (18.5, 19.5, 21.0, 23.0)}
    assert may == {18.5: False, 19.5: False, 21.0: True, 23.0: True}
    assert not hops.may_land(request(23.0, 5.0, Mode.AIR, 23.5), land, False), "without room never"
    end = hops.in_air(request(18.5, 5.0, Mode.AIR, 24.0), land).end(np.array([18.5, 5.0]))
    assert 20.2 + HARD_M < end[0] < 21.5


def test_who_has_flown_for_long_comes_down_wherever_there_is_room():
    hops = Hops(CONFIG, Seen(column=[fence(60.0)]), HARD_M, NONE)
    land = CostToGo(plan(fence(60.0)), GOAL[:2], HARD_M)
    assert not hops.may_land(request(18.5, 5.0, Mode.AIR, 10.0), land, True)
    late_s = 10.0 + ALOFT_MAX_S + 0.1
    assert hops.may_land(request(18.5, 5.0, Mode.AIR, late_s), land, True)
    assert not hops.may_land(request(20.0, 5.0, Mode.AIR, late_s), land, False)
    end = hops.in_air(request(20.0, 5.0, Mode.AIR, late_s), land).end(np.array([20.0, 5.0]))
    assert np.hypot(*(end - [20.0, 5.0])) < 1.0


def test_a_place_where_it_cannot_come_down_is_left_for_the_next():
    hops = Hops(CONFIG, Seen(column=[fence(60.0)]), HARD_M, NONE)
    land = CostToGo(plan(fence(60.0)), GOAL[:2], HARD_M)
    first = hops.in_air(request(18.5, 5.0, Mode.AIR), land).end(np.array([18.5, 5.0]))
    for now_s in np.arange(0.0, 0.5 + WAITS_S, 0.1):
        assert not hops.may_land(request(*first, Mode.AIR, float(now_s)), land, False)
    second = hops.in_air(request(*first, Mode.AIR, 3.0), land).end(first)
    assert np.hypot(*(second - first)) > 0.7
