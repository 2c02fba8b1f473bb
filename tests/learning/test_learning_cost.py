"""The paper's loss, term by term, and where an optimal path takes off."""

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from learning_rig import shard  # noqa: E402

from labr_autonomy.gkpn.learning.cost import Cost, goal_error, spline  # noqa: E402
from labr_autonomy.gkpn.learning.iplanner_cost import IPlannerCost  # noqa: E402
from labr_autonomy.gkpn.learning.step import asked  # noqa: E402
from labr_autonomy.gkpn.learning.teacher import best_paths, teach  # noqa: E402
from labr_autonomy.gkpn.learning.views import join  # noqa: E402
from labr_autonomy.gkpn.spline import path_points  # noqa: E402


@pytest.fixture(scope="module")
def views():
    return join([shard(seed=4, views=16)])


def straight(goal_m):
    return goal_m[:, None] * (torch.arange(1, 6) / 5.0)[None, :, None]


def test_the_path_is_the_flight_s_spline():
    keys = np.random.default_rng(0).normal(size=(5, 3)).astype(np.float32)
    np.testing.assert_allclose(spline(torch.from_numpy(keys)[None])[0].numpy(), path_points(keys), atol=1e-5)


def test_a_free_straight_line_costs_nothing_but_its_height(views):
    easy = np.argwhere(~views.hard & ~views.in_air & (views.floor_m > -0.05)[:, None])
    what = asked(views, easy[:, 0], easy[:, 1])
    judged = Cost().judge(straight(what.goal_m), what, views)
    clear = judged.distance_m.min(dim=1).values > 0.42
    assert clear.sum() >= 3
    for name in ("obstacle", "energy"):
        assert judged.terms[name][clear].abs().max() < 0.02
    assert judged.terms["motion"].max() < 0.02
    assert judged.terms["goal"].max() < 1e-3
    assert not judged.collides[clear].any()


def test_a_line_through_the_box_pays_and_is_to_be_feared(views):
    hard = np.argwhere(views.hard & ~views.in_air & (views.floor_m > -0.05)[:, None])
    what = asked(views, hard[:, 0], hard[:, 1])
    judged = Cost().judge(straight(what.goal_m), what, views)
    through = judged.distance_m.min(dim=1).values < 0.1
    assert through.any()
    assert judged.terms["obstacle"][through].min() > 5.0
    assert judged.collides[through].all()


def test_the_goal_counts_its_height_only_in_the_air(views):
    what = asked(views, np.array([0, 0]), np.array([0, 7]))
    assert what.in_air.tolist() == [False, True]
    last = what.target_m + torch.tensor([0.3, 0.4, 1.0])
    np.testing.assert_allclose(goal_error(last, what).numpy(), [0.5, math.sqrt(1.25)], atol=1e-5)


def test_weights_and_the_convention_of_sums_are_in_one_place(views):
    what = asked(views, np.arange(4), np.array([0, 2, 4, 6]))
    cost = Cost(obstacle=2.0, motion=0.0, goal=0.0, energy=3.0)
    judged = cost.judge(straight(what.goal_m), what, views)
    rise = judged.rise_m.abs().mean(dim=1)
    np.testing.assert_allclose(
        cost.total(judged).numpy(), (2.0 * judged.terms["obstacle"] + 3.0 * rise).numpy(), rtol=1e-5
    )


def test_energy_makes_it_drive_first_and_climb_near_the_goal(views):
    far = np.argwhere(views.in_air & (views.floor_m > -0.05)[:, None])
    points, clear = best_paths(views, far[:, 0], far[:, 1], Cost())
    rise = points[..., 2].numpy()  # standing robots: the driving height is 0
    assert clear.float().mean() > 0.9
    assert np.median(rise[:, 1]) < 0.1  # still on its wheels at two fifths
    assert np.median(rise[:, 4] / views.target_z_m[far[:, 0], far[:, 1]]) > 0.9
    free, _ = best_paths(views, far[:, 0], far[:, 1], Cost(energy=0.0))
    assert np.median(free[:, 1, 2].numpy()) > 0.2  # without the energy it climbs at once


def test_the_teacher_finds_ways_round_the_box(views):
    taught = teach(views, Cost())
    hard = views.hard
    known = ~np.isnan(taught[..., 0, 0])
    assert not known[~hard].any()
    assert known[hard].mean() > 0.9
    where = np.argwhere(known)
    what = asked(views, where[:, 0], where[:, 1])
    judged = Cost().judge(torch.from_numpy(taught[known]), what, views)
    assert judged.distance_m.min() > 0.3
    assert torch.expm1(judged.terms["goal"]).max() < 0.3


def test_iplanner_s_cost_is_its_smoothed_penetration(views):
    cost = IPlannerCost()
    deep, free, edge = cost.cost(torch.tensor([-0.6, 2.0, cost.inflate_m]))
    assert deep == pytest.approx(math.log(1.0 / cost.cell_m + 1.00001), rel=1e-3)
    assert free == pytest.approx(1e-5, abs=1e-4)
    assert edge == pytest.approx(
        math.log(cost.smooth_m / math.sqrt(2 * math.pi) / cost.cell_m + 1.0), rel=1e-3
    )


def test_iplanner_fears_only_what_comes_within_two_metres(views):
    land = views.only_land()
    hard = np.argwhere(land.hard)
    what = asked(land, hard[:, 0], hard[:, 1])
    line = straight(what.goal_m)
    near = IPlannerCost().judge(line, what, land).collides
    far = IPlannerCost(fear_ahead_m=9.0).judge(line, what, land).collides
    assert far.sum() > near.sum()


def test_only_land_leaves_standing_views_and_floor_goals(views):
    land = views.only_land()
    assert 0 < len(land) < len(views)
    assert not land.in_air.any()
    assert land.goals_m.shape[1] == views.goals_m.shape[1] // 2
    assert (land.floor_m > -0.05).all()
