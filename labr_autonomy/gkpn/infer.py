"""A planning network in flight, GKPN above all: one thread of ONNX Runtime; torch is never imported here."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from labr_autonomy.clock import SystemClock
from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.choice import chosen
from labr_autonomy.gkpn.local_map import LocalMap, with_distances
from labr_autonomy.gkpn.package import (
    ONNX_NAME,
    REMEDY,
    RuntimeName,
    packaged_dir,
    read_manifest,
    read_verified,
)
from labr_autonomy.gkpn.resample import network_image
from labr_autonomy.gkpn.runtime import start
from labr_autonomy.types import Array, Image, Intrinsics

GOAL_RANGE_M = 9.0  # farthest goal of the training data where the manifest does not say it


class PlanningOnnx:
    """A trained network with inputs `depth`, `goal`, perhaps `map` and `floor`, and outputs `points`, `mu`.

    Args:
        folder: With the model and manifest.json. A file whose sha256 is not the manifest's is refused with
            `BadInput`.
        name: Of the model's file.
        remedy: What to do about weights that are refused.
        runtime: What computes it.
    """

    def __init__(
        self, folder: Path, name: str, remedy: str = REMEDY, runtime: RuntimeName = "onnxruntime"
    ) -> None:
        self.manifest: dict[str, Any] = read_manifest(folder, remedy)
        self._runtime = start(read_verified(folder, name, remedy), name=runtime)
        inputs = self._runtime.inputs
        self._height, self._width = inputs["depth"][2:]
        self._unmapped = np.zeros(inputs["map"], np.float32) if "map" in inputs else None
        self._told_floor = "floor" in inputs
        self.range_m = float(self.manifest.get("goal_range_m", GOAL_RANGE_M))  # farther goals are drawn in
        self._clock = SystemClock()
        camera = Intrinsics(16, 9, 8.0, 8.0, 8.0, 4.5)
        self.predict(np.ones((9, 16), np.float32), camera, np.ones(3))  # compiles and allocates before flight

    @property
    def takes_map(self) -> bool:
        """Whether it wants to be shown what has been seen lately as well."""
        return self._unmapped is not None

    def predict(
        self,
        depth_m: Image,
        intrinsics: Intrinsics,
        goal_level_m: Array,
        seen: LocalMap | None = None,
        floor_m: float = 0.0,
    ) -> tuple[Array, float, float]:
        """Key points towards a goal.

        The goal should lie within 75 degrees of the heading (the training data's range; turn first
        otherwise). For a goal on the floor pass the robot's driving height, so z = 0 for a robot on wheels.

        Args:
            depth_m: (h, w) along the optical axis [m], 0 = invalid.
            intrinsics: Of the camera; the image may be a scaled version of its size.
            goal_level_m: (3,) level frame.
            seen: What has been seen lately (`gkpn.local_map`), for a network that `takes_map`.
            floor_m: Height at which the robot drives, level frame.

        Returns:
            Key points (5, 3) level frame [m], collision probability mu in 0..1, time taken [s].
        """
        began_s = self._clock.now_s()
        goal = np.asarray(goal_level_m, dtype=np.float64)
        if goal.shape != (3,) or not np.isfinite(goal).all():
            raise BadInput(
                f"the goal {goal_level_m!r} is not three finite numbers", "Pass x, y, z in metres."
            )
        feed = {
            "depth": network_image(depth_m, intrinsics, self._width, self._height)[None, None],
            "goal": drawn_in(goal, self.range_m)[None].astype(np.float32),
        }
        if self._unmapped is not None:
            feed["map"] = self._unmapped if seen is None else with_distances(seen)[None]
        if self._told_floor:
            feed["floor"] = np.array([[floor_m]], np.float32)
        points, mu = self._runtime.run(feed)
        paths = points.reshape(1, -1, *points.shape[-2:]).astype(np.float64)  # (1, hypotheses, n, 3)
        taken = int(chosen(paths, mu, floor_m)[0])
        return paths[0, taken], float(mu[0, taken]), self._clock.now_s() - began_s


class GkpnOnnx(PlanningOnnx):
    """The trained GKPN.

    Args:
        weights_dir: Folder with gkpn.onnx and manifest.json; the packaged one by default.
        runtime: What computes it.
    """

    def __init__(self, weights_dir: Path | None = None, runtime: RuntimeName = "onnxruntime") -> None:
        super().__init__(weights_dir or packaged_dir(), ONNX_NAME, runtime=runtime)


def drawn_in(goal_m: Array, range_m: float) -> Array:
    """The goal, brought to this distance along its bearing if it is farther in x, y; z is kept."""
    far = math.hypot(goal_m[0], goal_m[1])
    if far <= range_m:
        return goal_m
    share = range_m / far
    near: Array = goal_m * np.array([share, share, 1.0])
    return near
