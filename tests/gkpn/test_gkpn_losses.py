import math
from dataclasses import replace

import numpy as np
import pytest

from sim.worlds.primitives import Scene, box, cylinder

torch = pytest.importorskip("torch", reason="the losses need the train extra (torch)")
torch.set_num_threads(1)
from labr_autonomy.gkpn.losses import LossConfig, goal_distance, level_to_odom, losses, scene_distance  # noqa: E402

ROWS = np.stack([box([2.0, 0.1, 0.5], [0.3, 0.4, 0.5], 0.3), cylinder(4.0, -1.0, 0.3, 0.0, 2.0)])
SOLIDS = torch.tensor(ROWS, dtype=torch.float64)[None]


def straight(goal):
    goal = torch.as_tensor(goal, dtype=torch.float64).reshape(1, 3)
    return goal[:, None] * (torch.arange(1, 6, dtype=torch.float64) / 5)[None, :, None], goal


def judged(points, goal, *, floor=0.0, config=None, height=0.12):
    pose = torch.tensor([[0.0, 0.0, height, 0.0]], dtype=torch.float64)
    logit, at = torch.zeros(1, 1, dtype=torch.float64), torch.tensor([floor], dtype=torch.float64)
    return losses(points, logit, goal, pose, SOLIDS, at, config or LossConfig())


def test_scene_distance_is_the_worlds_own():
    points = np.random.default_rng(1).uniform([-1, -3, 0], [6, 3, 2.5], (200, 3))
    found = scene_distance(torch.tensor(points)[None], SOLIDS)[0].numpy()
    np.testing.assert_allclose(found, Scene(ROWS).distance(points), atol=5e-5)


def test_level_frame_of_the_losses_is_that_of_the_robot():
    from labr_autonomy import frames
    from labr_autonomy.types import Pose

    yaw, at = 0.7, np.array([1.0, -2.0, 0.5])
    points = np.array([[1.0, 2.0, 3.0], [-1.0, 0.5, 0.0]])
    expected = frames.level_to_odom(points, Pose(at, frames.quaternion_from_rpy(0.1, -0.2, yaw)))
    found = level_to_odom(torch.tensor(points)[None], torch.tensor([[*at, yaw]]))
    np.testing.assert_allclose(found[0].numpy(), expected, atol=1e-12)


def test_gradients_of_the_total_are_those_of_finite_differences():
    points, goal = straight([3.0, 0.3, 0.9])
    points = points + 0.05 * torch.sin(torch.arange(15, dtype=torch.float64)).reshape(1, 5, 3)
    points.requires_grad_()
    judged(points, goal).total.backward()
    h = 1e-6
    for i, j in ((0, 1), (2, 0), (2, 2), (4, 1)):
        shift = torch.zeros_like(points)
        shift[0, i, j] = h
        with torch.no_grad():
            slope = (judged(points + shift, goal).total - judged(points - shift, goal).total) / (2 * h)
        assert float(points.grad[0, i, j]) == pytest.approx(float(slope), rel=1e-3, abs=1e-4)


def test_obstacle_term_pushes_the_path_out_of_a_solid():
    points, goal = straight([2.4, -0.5, 0.0])
    points.requires_grad_()
    out = judged(points, goal)
    out.terms["obstacle"].backward()
    # The box lies to the left of the path, so descending the gradient goes right, towards negative y.
    assert float(points.grad[0, 3, 1]) > 0.0
    assert float(out.collides) == 1.0


def test_a_land_goal_counts_in_x_y_only_and_an_air_goal_in_all_three():
    last = torch.tensor([[1.0, 0.0, 0.5], [1.0, 0.0, 0.5]])
    goal = torch.tensor([[1.0, 0.0, -0.03], [1.0, 0.0, 1.5]])
    found = goal_distance(last, goal, torch.zeros(2))
    assert found[0] == pytest.approx(0.0, abs=1e-4)
    assert found[1] == pytest.approx(1.0, abs=1e-4)


def test_conditional_height_follows_the_floor_for_an_airborne_robot():
    """A goal 0.3 m below a robot that flies at 1.12 m is still in the air; one 1 m below is on land."""
    last, goal = torch.zeros(2, 3), torch.tensor([[0.0, 0.0, -0.3], [0.0, 0.0, -1.0]])
    found = goal_distance(last, goal, torch.full((2,), -1.0))
    assert found[0] == pytest.approx(0.3, abs=1e-4)
    assert found[1] == pytest.approx(0.0, abs=1e-4)


def test_goal_term_is_a_logarithm():
    points, goal = straight([0.0, 2.0, 0.0])
    out = judged(points * 0.0, goal)
    assert float(out.terms["goal"]) == pytest.approx(math.log(3.0), abs=1e-4)


def test_energy_is_height_above_the_driving_height_also_in_the_air():
    points, goal = straight([0.0, 4.0, 0.0])
    assert float(judged(points, goal).terms["energy"]) == pytest.approx(0.0, abs=1e-9)
    assert float(judged(points, goal, floor=-1.0, height=1.12).terms["energy"]) == pytest.approx(
        1.0, abs=1e-6
    )


def test_motion_of_an_even_straight_path_is_nothing_and_of_a_detour_its_extra_length():
    points, goal = straight([0.0, 4.0, 0.0])
    assert float(judged(points, goal).terms["motion"]) == pytest.approx(0.0, abs=1e-4)
    assert float(judged(points * 1.5, goal).terms["motion"]) == pytest.approx(2.0, abs=1e-3)


def test_path_under_the_floor_pays():
    points, goal = straight([0.0, 4.0, 0.0])
    sunk = points - torch.tensor([0.0, 0.0, 0.2], dtype=torch.float64)
    free = float(judged(points, goal).terms["obstacle"])
    assert free == pytest.approx(0.0, abs=1e-9)
    assert float(judged(sunk, goal).terms["obstacle"]) > 20.0


def test_total_is_the_weighted_sum_and_each_weight_counts():
    points, goal = straight([4.0, 0.0, 1.0])
    config = LossConfig()
    out = judged(points, goal, config=config)
    expected = sum(getattr(config, name) * float(term) for name, term in out.terms.items())
    assert float(out.total) == pytest.approx(expected, rel=1e-9)
    for name in out.terms:
        other = judged(points, goal, config=replace(config, **{name: getattr(config, name) + 1.0}))
        assert float(other.total - out.total) == pytest.approx(float(out.terms[name]), rel=1e-6)


def test_fear_label_is_one_only_where_the_path_comes_within_the_radius():
    for sideways, expected in ((0.0, 1.0), (3.0, 0.0)):
        points, goal = straight([4.0, sideways, 0.0])
        assert float(judged(points, goal).collides) == expected
