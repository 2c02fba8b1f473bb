"""How movers walk, whom they stop for, and what the referee makes of a touch."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from movers_rig import BODY, BOX, CONFIG, DT_S, Walk, mover

from sim.battery import Battery
from sim.movers.crowd import ACCELERATION_MPS2, KEEP_M, PATIENCE_S, SET_OUT_M, TURN_BACK_S, Crowd
from sim.movers.draw import PERSON
from sim.referee import Referee

BEFORE = np.array([0.0, 0.0, BODY.below_m])  # a robot in the middle of the track


def test_positions_by_time_follow_speed_acceleration_and_pause():
    walk = Walk(mover(speed=1.5, pause=1.0))
    walk.go(10.0)
    t, y, _ = np.array(walk.history).T
    speed = np.abs(np.diff(y)) / DT_S
    assert speed.max() == pytest.approx(1.5, abs=1e-6)
    assert np.abs(np.diff(speed)).max() / DT_S < 20.0 * ACCELERATION_MPS2  # no jump from walking to standing
    # A ramp up and one down cost v / a together on top of length over speed.
    there_s = 6.0 / 1.5 + 1.5 / ACCELERATION_MPS2
    assert y[np.searchsorted(t, there_s + 0.1)] == pytest.approx(3.0, abs=2e-3)
    pausing = (t > there_s + 0.15) & (t < there_s + 0.9)
    assert np.ptp(y[pausing]) == 0.0
    assert y[-1] < 0.0  # and on its way back


def test_the_same_steps_give_the_same_places_to_the_last_bit():
    walks = [Walk(mover(), position=BEFORE + np.array([0.9, 0.0, 0.0])) for _ in range(2)]
    for walk in walks:
        walk.go(7.0, velocity=(0.0, 0.01, 0.0))
    assert walks[0].history == walks[1].history


def test_a_person_stops_short_of_a_robot_that_stands_and_turns_back():
    walk = Walk(mover(), position=BEFORE)
    walk.go(6.0)
    assert walk.least_gap_m == pytest.approx(KEEP_M, abs=0.01)
    stood_s = sum(DT_S for _, _, gap in walk.history if gap < KEEP_M)
    assert stood_s >= TURN_BACK_S - 0.01
    walk.go(0.8)
    assert walk.crowd.placed[0].y_m < -2.5  # gone back, not past


def test_a_person_does_not_give_way_to_a_robot_that_moves():
    walk = Walk(mover(), position=BEFORE - np.array([0.3, 0.0, 0.0]))
    walk.go(6.0, velocity=(0.1, 0.0, 0.0))
    assert walk.least_gap_m <= 0.0


def test_nobody_sets_out_close_to_the_robot():
    beside = BEFORE + np.array([0.3, -3.0 + 0.9, 0.0])
    walk = Walk(mover(), position=beside)
    assert walk.crowd.placed[0].clearance_m(*beside, BODY) < SET_OUT_M
    walk.go(PATIENCE_S - 0.1)
    assert walk.crowd.placed[0].y_m == -3.0
    walk.go(1.0)
    assert walk.crowd.placed[0].y_m > -3.0


def test_a_box_goes_on_until_it_touches_and_does_not_pass_through():
    walk = Walk(mover(BOX), position=BEFORE)
    walk.go(12.0)
    assert -0.02 < walk.least_gap_m <= 0.0
    assert max(y for _, y, _ in walk.history) < 0.0


def test_a_hovering_robot_that_sways_counts_as_standing_in_the_air_alone():
    for on_wheels, stands in ((False, True), (True, False)):
        walk = Walk(mover(), position=BEFORE + np.array([0.0, 20.0, 1.0]))
        walk.go(1.2, velocity=(0.1, 0.0, 0.0), on_wheels=on_wheels)
        assert walk.crowd.robot_stands is stands


@dataclass
class Robot:
    position_m: np.ndarray
    velocity_mps: np.ndarray = field(default_factory=lambda: np.zeros(3))
    quaternion: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    on_wheels: bool = True


@dataclass
class Body:
    """As much of a plant as the referee looks at."""

    state: Robot
    clearance_m: float = 1.0
    falls: int = 0
    height_m: float = 0.0
    battery: Battery = field(default_factory=Battery)


def judged(shape, position, velocity, seconds):
    walk = Walk(mover(shape), position=position)
    referee = Referee(crowd=walk.crowd)
    plant = Body(Robot(walk.position, np.array(velocity, dtype=float)))
    for _ in range(round(seconds / DT_S)):
        walk.go(DT_S, velocity)
        plant.state.position_m = walk.position
        referee.watch(walk.now_s, plant)
    return referee


def test_a_touch_of_a_mover_by_a_moving_robot_is_a_contact():
    referee = judged(PERSON, BEFORE - np.array([0.3, 0.0, 0.0]), (0.1, 0.0, 0.0), 4.0)
    assert (referee.contacts, referee.mover_contacts, referee.struck) == (1, 1, 0)
    assert referee.min_clearance_m == referee.min_mover_clearance_m <= 0.0
    assert len(referee.contact_places_m) == 1


def test_a_box_that_runs_into_a_standing_robot_is_recorded_apart():
    referee = judged(BOX, BEFORE, (0.0, 0.0, 0.0), 6.0)
    assert (referee.contacts, referee.struck) == (0, 1)
    assert referee.contact_places_m == []


def test_a_contact_with_a_mover_that_the_camera_did_not_look_at_is_told_apart():
    for yaw_rad, unseen in ((-0.5 * np.pi, 0), (0.5 * np.pi, 1)):  # the mover comes from the south
        crowd = Crowd([mover()], CONFIG)
        place, velocity = BEFORE - np.array([0.3, 0.0, 0.0]), np.array([0.1, 0.0, 0.0])
        referee, plant = Referee(crowd=crowd), Body(Robot(place, velocity))
        for i in range(round(3.0 / DT_S)):
            plant.state.position_m = place + velocity * DT_S * i
            crowd.step(DT_S, plant.state.position_m, velocity, on_wheels=True, yaw_rad=yaw_rad)
            referee.watch(DT_S * i, plant)
        assert (referee.mover_contacts, referee.unseen_contacts) == (1, unseen)


def test_a_person_sees_within_half_a_second_that_the_robot_stands():
    for stood_s, met in ((0.7, False), (0.2, True)):
        walk = Walk(mover(), position=BEFORE)
        while walk.crowd.placed[0].clearance_m(*BEFORE, BODY) > KEEP_M + 1.5 * stood_s:
            walk.go(DT_S, velocity=(0.0, 0.06 if len(walk.history) % 2 else -0.06, 0.0))
        walk.go(1.0)
        assert (walk.least_gap_m <= 0.0) is met


def test_every_time_counts_once():
    referee = judged(BOX, BEFORE, (0.0, 0.0, 0.0), 15.0)
    assert referee.struck == 2


def test_the_account_says_who_walked_where(tmp_path):
    walk = Walk(mover())
    referee = Referee(crowd=walk.crowd)
    plant = Body(Robot(walk.position))
    for _ in range(10):
        walk.go(DT_S)
        referee.watch(walk.now_s, plant)
    referee.save(tmp_path, plant)
    account = (tmp_path / "referee.json").read_text()
    assert '"movers": 1' in account
    assert '"struck_while_standing": 0' in account
    with np.load(tmp_path / "truth.npz") as truth:
        assert truth["movers_m"].shape == (len(truth["stamp_s"]), 1, 3)
        assert truth["movers_m"][0, 0] == pytest.approx([0.0, -3.0, 0.0], abs=1e-3)
