"""Key points in the depth image, also where a figure is unknown."""

import math

import pytest

from labr_autonomy.console.depth_view import project
from labr_autonomy.mission.portrait import number, row

CAMERA = {"fx": 320.0, "fy": 320.0, "cx": 320.0, "cy": 180.0, "x_m": 0.1, "z_m": 0.05}
POSE = {"position_m": [1.0, 2.0, 0.2], "quaternion": [1.0, 0.0, 0.0, 0.0]}


def test_a_point_ahead_is_where_the_pinhole_puts_it_and_one_behind_is_not_seen():
    points = [[3.1, 2.0, 0.25, 0], [3.1, 1.5, 0.5, 1], [0.0, 2.0, 0.2, 0]]
    assert project(points, POSE, CAMERA, 640, 360) == [[320.0, 180.0, 0], [400.0, 140.0, 1]]


def test_a_figure_that_is_unknown_is_left_out_and_ends_nothing():
    unknown = [*row((3.1, math.nan, 0.25)), 0]
    assert project([unknown, [3.1, 2.0, 0.25, 0]], POSE, CAMERA, 640, 360) == [[320.0, 180.0, 0]]


@pytest.mark.parametrize("name", ["position_m", "quaternion"])
def test_without_a_pose_nothing_is_seen(name):
    lost = {**POSE, name: [number(math.nan), *POSE[name][1:]]}
    assert project([[3.1, 2.0, 0.25, 0]], lost, CAMERA, 640, 360) == []
    assert project([[3.1, 2.0, 0.25, 0]], None, CAMERA, 640, 360) == []
