"""Images that show nothing, the same everywhere, or never change are not believed; odd but true ones are."""

import numpy as np
import pytest
from floor_scenes import CONFIG, LEVEL, OPTICS, box, seen, standing

from labr_autonomy.perception.frame_check import SURE_S, FrameCheck
from labr_autonomy.types import DepthFrame

RANGE_M = CONFIG.camera.range_max_m
SHAPE = (OPTICS.height, OPTICS.width)
PERIOD_S = 0.1


def watched(images, places=None):
    """What is said of images at 10 Hz, and how many were believed."""
    check, believed = FrameCheck(RANGE_M), 0
    for k, image in enumerate(images):
        at = standing(0.0 if places is None else float(places[k]))
        believed += check.good(DepthFrame(k, PERIOD_S * k, np.asarray(image, np.float32), OPTICS), at)
    return check.fault, believed


def scene(seed=0, x=0.0):
    things = [LEVEL, box([2.0, -0.4, 0.0], [2.4, 0.3, 1.0])]
    return seen(things, standing(x), np.random.default_rng(seed))


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (np.zeros(SHAPE), "nothing within"),
        (np.full(SHAPE, np.nan), "nothing within"),
        (np.full(SHAPE, 65.0), "nothing within"),
        (np.full(SHAPE, RANGE_M), "everywhere"),
        (np.full(SHAPE, 1.5), "everywhere"),
    ],
)
def test_an_image_that_shows_no_scene_is_not_mapped_and_soon_said_to_be_wrong(image, said):
    fault, believed = watched([scene(), *[image] * 4])
    assert said in fault
    assert believed == 1
    assert watched([scene(), image, scene(1)]) == ("", 2), "one lost frame is no fault"


def test_images_that_stay_the_same_are_a_fault_once_the_robot_moves():
    image = scene()
    fault, _ = watched([image] * 8, 0.08 * np.arange(8))
    assert "do not change" in fault
    assert watched([image] * 8) == ("", 8), "a simulated camera without noise at rest"
    fresh = [scene(k, 0.08 * k) for k in range(8)]
    assert watched(fresh, 0.08 * np.arange(8)) == ("", 8)


def test_it_stays_a_fault_while_the_robot_holds_and_ends_with_the_first_good_image():
    image = scene()
    places = [*0.08 * np.arange(6), *[0.4] * 20]
    assert "do not change" in watched([image] * 26, places)[0]
    assert watched([*[image] * 26, scene(3)], [*places, 0.4])[0] == ""


def test_strange_scenes_are_believed():
    close = seen([box([0.6, -9.0, -1.0], [0.7, 9.0, 3.0])], standing(), np.random.default_rng(2))
    assert watched([close] * 1 + [scene(k) for k in range(3)])[1] == 4, "a wall that fills the view"
    holes = [np.where(np.random.default_rng(k).random(SHAPE) < 0.9, 0.0, scene(k)) for k in range(5)]
    assert watched(holes) == ("", 5), "nine pixels in ten are lost"
    assert SURE_S < 0.5
