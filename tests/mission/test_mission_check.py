from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import Refused
from labr_autonomy.mission.check import check_mission, clear_places, height_max_m, refuse
from labr_autonomy.mission.fence import polygon_fault
from labr_autonomy.mission.schema import Mission

ROBOT = RobotConfig()
SQUARE = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
NOTCHED = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (5.0, 5.0), (0.0, 10.0)]  # concave


def mission(items, **more):
    return Mission.model_validate({"version": 1, "name": "t", "items": items, **more})


def codes(m, **more):
    return [(f.code, f.item) for f in check_mission(m, ROBOT, **more)]


def fence(keep="in", polygon=SQUARE, **more):
    return {"keep": keep, "polygon": polygon, **more}


def test_a_feasible_mission_has_no_findings():
    m = mission([{"goto": {"x": 5, "y": 5}}, {"goto": {"x": 5, "y": 6, "z": 1.5}}], fence=[fence()])
    assert codes(m, start_xy_m=(1.0, 1.0), clearance_at=lambda x, y, z: 1.0) == []


def test_everything_wrong_is_found_at_once_and_refused_in_one_error():
    items = [
        {"goto": {"x": 12, "y": 5}},  # outside
        {"goto": {"x": 5, "y": 5, "z": 3}},  # above the ceiling
        {"goto": {"x": 2, "y": 2}},  # inside an obstacle
        {"goto": {"x": 3, "y": 3}},  # too near to it
    ]
    m = mission(items, fence=[fence(), fence("out", [(0, 0), (2, 2), (2, 0), (0, 2)])])
    findings = check_mission(
        m,
        ROBOT,
        start_xy_m=(0.1, 5),
        clearance_at=lambda x, y, z: -0.1 if x == 2 else 0.05 if x == 3 else 1.0,
    )
    assert {f.code for f in findings} == {
        "fence_invalid",
        "start_outside_fence",
        "goal_outside_fence",
        "goal_too_high",
        "goal_in_obstacle",
        "goal_near_obstacle",
    }
    with pytest.raises(Refused) as caught:
        refuse(findings)
    assert caught.value.exit_code == 3
    for finding in findings:
        assert finding.sentence in str(caught.value)


def test_no_findings_are_not_refused_and_one_is_one_sentence():
    refuse([])
    one = check_mission(mission([{"goto": {"x": 12, "y": 5}}], fence=[fence()]), ROBOT)
    with pytest.raises(
        Refused, match=r"^not feasible: the goal of item 1 at \(12, 5\) puts the robot 2.30 m outside"
    ):
        refuse(one)


@pytest.mark.parametrize(("x", "found"), [(9.71, True), (9.70, False), (0.30, False), (0.29, True)])
def test_the_outline_stays_inside_not_only_the_middle(x, found):
    assert bool(codes(mission([{"goto": {"x": x, "y": 5}}], fence=[fence()]))) is found


@pytest.mark.parametrize(
    ("z", "heights", "keep", "found"),
    [
        (1.0, [0, 2], "in", False),
        (1.9, [0, 2], "in", True),  # the top sticks out
        (None, [0, 2], "in", False),  # on its wheels the outline starts at the floor
        (None, [0.5, 2], "in", True),
        (1.0, [1.2, 2], "out", False),  # passes below
        (1.0, [1.1, 2], "out", True),
        (1.0, [0, 0.8], "out", False),  # passes above
        (None, [0, 0.8], "out", True),
    ],
)
def test_heights_of_a_fence(z, heights, keep, found):
    goal = {"x": 5, "y": 5} | ({} if z is None else {"z": z})
    assert bool(codes(mission([{"goto": goal}], fence=[fence(keep, z=heights)]))) is found


def test_the_lower_ceiling_counts():
    goal = [{"goto": {"x": 1, "y": 1, "z": 2}}]
    assert codes(mission(goal)) == []
    assert codes(mission(goal, limits={"height_max_m": 1.9})) == [("goal_too_high", 0)]
    assert height_max_m(mission(goal, limits={"height_max_m": 50}), ROBOT) == ROBOT.air.height_max_m


def test_the_start_of_the_simulation_is_looked_at():
    sim = {"world": {"family": "hall"}, "start": {"x": -1, "y": 5}}
    m = mission([{"land": {}}], fence=[fence()], sim=sim)
    assert codes(m) == [("start_outside_fence", None)]
    assert codes(m, start_xy_m=(5.0, 5.0)) == []


def test_goals_are_probed_at_the_height_of_the_body():
    seen = []
    m = mission([{"goto": "a"}, {"goto": {"x": 3, "y": 4, "z": 1.5}}], places={"a": {"x": 1, "y": 2}})
    codes(m, clearance_at=lambda *p: seen.append(p) or 1.0)
    assert seen == [(1, 2, ROBOT.body.below_m), (3, 4, 1.5)]


def test_a_mission_beyond_the_pack_is_found():
    far = [{"goto": {"x": 0, "y": 0}}, {"goto": {"x": 9000, "y": 0}}]
    assert codes(mission(far)) == [("energy_short", None)]


@pytest.mark.parametrize(
    ("corners", "word"),
    [
        (SQUARE, None),
        (NOTCHED, None),
        ([(0, 0), (1, 1), (1, 0), (0, 1)], "cross"),
        ([(0, 0), (1, 0), (1, 0), (0, 1)], "same point"),
        ([(0, 0), (1, 0), (2, 0)], "no area"),
        ([(0, 0), (4, 0), (4, 4), (2, 0), (0, 4)], "cross"),  # touches its own edge
    ],
)
def test_polygons_that_bound_nothing(corners, word):
    fault = polygon_fault(corners)
    assert fault is None if word is None else word in fault


@settings(deadline=None, max_examples=60)
@given(st.floats(-1, 11), st.floats(-1, 11))
def test_a_goal_inside_the_fence_is_inside_by_the_outline(x, y):
    square = codes(mission([{"goto": {"x": x, "y": y}}], fence=[fence()]))
    assert bool(square) is not (0.3 <= x <= 9.7 and 0.3 <= y <= 9.7)


@pytest.mark.parametrize(("x", "found"), [(4.4, False), (4.2, True), (0.0, True)])
def test_a_round_keep_out_is_grown_by_the_outline(x, found):
    round_ = {"circle": {"x": 0, "y": 0, "radius_m": 4}, "keep": "out"}
    assert bool(codes(mission([{"goto": {"x": x, "y": 0}}], fence=[round_]))) is found


def test_places_to_keep_clear_are_start_then_goals():
    sim = {"world": {"family": "hall"}, "start": {"x": 1, "y": 5}}
    m = mission([{"goto": {"x": 3, "y": 4}}, {"return": {}}, {"goto": {"x": 6, "y": 7, "z": 1.5}}], sim=sim)
    assert clear_places(m, ROBOT) == [(1, 5, 0.12), (3, 4, 0.12), (6, 7, 1.5)]
