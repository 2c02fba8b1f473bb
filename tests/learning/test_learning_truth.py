"""How far a place is from what hinders: against analytic distances, slopes against differences."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from learning_rig import BELOW_M, box_distance, shard, solid_distance  # noqa: E402

from labr_autonomy.gkpn.learning.truth import DRIVEN_M, FLOWN_M, look  # noqa: E402
from labr_autonomy.gkpn.learning.views import join  # noqa: E402


@pytest.fixture(scope="module")
def views():
    return join([shard(seed=1), shard(seed=2)])


def places(views, rise, count=200):
    rng = np.random.default_rng(0)
    xy = rng.uniform([1.2, -2.0], [4.5, 2.0], (count, 2))
    points = np.column_stack([xy, np.full(count, BELOW_M + rise)])
    view = np.full(1, len(views) - 1)
    return torch.from_numpy(points[None].astype(np.float32)), torch.from_numpy(view), points


def test_a_low_place_is_judged_as_driven(views):
    points, view, at = places(views, 0.0)
    distance, rise = look(points, view, views)
    expected = np.clip(box_distance(at[:, :2]), -1.27, 1.27)
    np.testing.assert_allclose(distance[0].numpy(), expected, atol=0.06)  # cells of 0.1 m
    assert np.median(np.abs(distance[0].numpy() - expected)) < 0.01
    np.testing.assert_allclose(rise.numpy(), 0.0, atol=1e-5)


def test_a_high_place_is_judged_as_flown(views):
    points, view, at = places(views, 0.9)
    distance, rise = look(points, view, views)
    np.testing.assert_allclose(distance[0].numpy(), np.clip(solid_distance(at), -1.27, 1.27), atol=0.06)
    np.testing.assert_allclose(rise.numpy(), 0.9, atol=1e-5)


def test_over_the_box_it_is_free_only_in_the_air(views):
    view = torch.tensor([0])
    middle = torch.tensor([[[2.8, 0.0, BELOW_M], [2.8, 0.0, BELOW_M + 1.2]]])
    low, high = look(middle, view, views)[0][0].tolist()
    assert low < -0.2
    assert high > 0.4
    driven = look(middle, view, views, drives=True)[0][0].tolist()
    assert driven[1] == pytest.approx(low)


@pytest.mark.parametrize("rise", [0.0, 0.5 * (DRIVEN_M + FLOWN_M), 0.9])
def test_slopes_are_those_of_the_values(views, rise):
    points, view, _ = places(views, rise, 60)
    points.requires_grad_(True)
    distance, height = look(points, view, views)
    (distance.sum() + height.sum()).backward()
    step = 2e-3
    worst = []
    for axis in range(3):
        move = torch.zeros(3)
        move[axis] = step
        with torch.no_grad():
            high, low = (look(points + s * move, view, views) for s in (1.0, -1.0))
        numeric = ((high[0] + high[1]) - (low[0] + low[1])) / (2.0 * step)
        worst.append((numeric - points.grad[..., axis]).abs()[0].numpy())
    assert np.median(worst) < 0.02
    assert np.quantile(worst, 0.8) < 0.1  # beyond that: kinks between cells


def test_a_path_up_a_slope_keeps_its_height():
    steep = join([shard(seed=3, slope=0.1)])
    view = torch.tensor([0])
    x0 = float(steep.poses[0, 0])
    line = torch.tensor([[[x0 + 1.0, 2.5, BELOW_M + 0.9], [x0 + 4.0, 2.5, BELOW_M + 0.9]]])
    distance, rise = look(line, view, steep)
    np.testing.assert_allclose(rise.numpy(), 0.9, atol=1e-5)
    # the air field of this scene has a level floor: followed heights are looked up 0.1 and 0.4 m higher
    np.testing.assert_allclose(distance[0].numpy(), [1.12, 1.27], atol=0.03)
    assert look(line, view, join([shard(seed=3)]))[0][0, 1] == pytest.approx(1.02, abs=0.03)
