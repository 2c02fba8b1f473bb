"""Whether depth images can be believed: one that shows nothing, the same everywhere, or never changes cannot.

A frame that is spoiled is not mapped; after `SURE_S` of them the robot has to hold (faults.md, row 36).
"""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.frames import wrap_pi, yaw_of
from labr_autonomy.types import Array, DepthFrame, Image, Pose

SURE_S = 0.2  # of frames without a good one: a single frame may be lost to the sun
EMPTY_SHARE = 0.02  # of pixels with a distance within the camera's range; floor or walls always show more
SAME_SHARE = 0.98  # of pixels with one and the same distance: noise alone spreads those of a wall
STRIDE = 4  # of the pixels that are counted
MOVED_M, TURNED_RAD = 0.05, 0.05  # a camera that has moved by so much sees something else


class FrameCheck:
    """Looks at each new image once.

    Args:
        range_m: Farthest distance that the camera measures.
    """

    def __init__(self, range_m: float) -> None:
        self._range_m = range_m
        self._bad_since_s: float | None = None
        self._last: Image | None = None
        self._place_m: Array = np.full(3, np.inf)  # where the image last changed
        self._yaw_rad = 0.0
        self.fault = ""  # one sentence, while images cannot be believed

    def good(self, frame: DepthFrame, pose: Pose) -> bool:
        """Whether an image may be mapped.

        Args:
            frame: A new one.
            pose: Of the body at its exposure, odom.
        """
        why = self._objection(frame.depth_m, pose)
        if not why:
            self._bad_since_s, self.fault = None, ""
        elif self._bad_since_s is None:
            self._bad_since_s = frame.stamp_s
        if self._bad_since_s is not None and frame.stamp_s - self._bad_since_s >= SURE_S:
            self.fault = why
        return not why

    def _objection(self, depth_m: Image, pose: Pose) -> str:
        stuck = self._stuck(depth_m, pose)
        some = depth_m[::STRIDE, ::STRIDE]
        measured = some[(some > 0.0) & (some <= self._range_m)]  # False for not-a-number
        if measured.size < EMPTY_SHARE * some.size:
            return f"depth images show nothing within {self._range_m:g} m"
        middle = np.median(measured)
        if np.count_nonzero(measured == middle) > SAME_SHARE * some.size:
            return f"depth images show {middle:.2f} m everywhere"
        return "depth images do not change though the robot moves" if stuck else ""

    def _stuck(self, depth_m: Image, pose: Pose) -> bool:
        yaw = yaw_of(pose.quaternion)
        if self._last is None or not np.array_equal(depth_m, self._last, equal_nan=True):
            self._last, self._place_m, self._yaw_rad = depth_m.copy(), pose.position_m, yaw
            return False
        moved = math.dist(pose.position_m, self._place_m) > MOVED_M
        return moved or abs(wrap_pi(yaw - self._yaw_rad)) > TURNED_RAD
