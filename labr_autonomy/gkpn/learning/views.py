"""Training data in memory: the views of many shards, with what judges a path through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.local_map import CHANNELS, SIDE, with_distances
from labr_autonomy.gkpn.shards import LAND_CELL_M, LAND_SIDE, NO_FLOOR, Shard, read_folder, read_shard

STANDING_M = 0.05  # lower than this above its driving height, a robot stands
_OF_GOAL = ("goals_m", "target_z_m", "in_air", "hard")
_OF_VIEW = ("images_mm", "maps", "poses", "floor_m", "land_cm", "floors_cm", "land_corner_m", "scene")


@dataclass(frozen=True, slots=True)
class Air:
    """Signed distances to any surface in each scene, one behind the other."""

    values_cm: NDArray[np.int8]  # all voxels of all scenes
    start: NDArray[np.int64]  # (s,) where a scene begins
    shape: NDArray[np.int64]  # (s, 3)
    origin_m: NDArray[np.float64]  # (s, 3) lower corner, odom
    cell_m: NDArray[np.float64]  # (s,)


@dataclass(frozen=True, slots=True)
class Views:
    """Views of one or several data sets; fields as of `gkpn.shards.Shard`, joined."""

    images_mm: NDArray[np.uint16]  # (v, h, w)
    maps: NDArray[np.uint8]  # (v, CHANNELS, SIDE * SIDE // 8)
    poses: NDArray[np.float32]  # (v, 6)
    floor_m: NDArray[np.float32]  # (v,)
    goals_m: NDArray[np.float32]  # (v, k, 3); on land with heights followed, as the flight knows them
    target_z_m: NDArray[np.float32]  # (v, k) of the goals, all followed (see `truth`)
    in_air: NDArray[np.bool_]  # (v, k)
    hard: NDArray[np.bool_]  # (v, k)
    land_cm: NDArray[np.int8]  # (v, n, n)
    floors_cm: NDArray[np.int16]  # (v, n, n)
    land_corner_m: NDArray[np.float32]  # (v, 2)
    scene: NDArray[np.int64]  # (v,)
    air: Air
    families: tuple[str, ...]  # (s,)
    seeds: tuple[int, ...]  # (s,)

    def __len__(self) -> int:
        """Number of views."""
        return len(self.images_mm)

    def images_m(self, index: NDArray[np.int64]) -> Tensor:
        """(b, 1, h, w) depth [m], 0 = invalid."""
        return torch.from_numpy(self.images_mm[index].astype(np.float32) * 1e-3)[:, None]

    def local_maps(self, index: NDArray[np.int64]) -> Tensor:
        """(b, SHOWN, SIDE, SIDE) as the network is shown them."""
        bits = np.unpackbits(self.maps[index], axis=-1).reshape(-1, CHANNELS, SIDE, SIDE)
        return torch.from_numpy(np.array([with_distances(one) for one in bits]))

    def only_land(self) -> Views:
        """Views from the wheels, and goals on the floor: half as many of each view, for what only drives."""
        kept = self.goals_m.shape[1] // 2
        order = np.argsort(self.in_air, axis=1, kind="stable")[:, :kept]
        good = (self.floor_m > -STANDING_M) & ~np.take_along_axis(self.in_air, order, axis=1)[:, -1]
        view, order = np.flatnonzero(good), order[good]
        changed = {name: getattr(self, name)[view] for name in _OF_VIEW}
        for name in _OF_GOAL:
            values = getattr(self, name)[view]
            changed[name] = values[np.arange(len(view))[:, None], order]
        return replace(self, **changed)

    def facts(self) -> dict[str, object]:
        """What the data are, for a manifest."""
        counts = {family: self.families.count(family) for family in sorted(set(self.families))}
        goals = int(self.goals_m.shape[1])
        seeds = [min(self.seeds), max(self.seeds)]
        hard = round(float(self.hard.mean()), 4)
        return {
            "scenes": counts,
            "seeds": seeds,
            "views": len(self),
            "goals_per_view": goals,
            "hard": hard,
        }


def load_views(folders: Sequence[Path]) -> Views:
    """Read every shard of some folders.

    Raises:
        BadInput: for a damaged shard, for none at all, and for folders whose images or goals do not match.
    """
    paths = [path for folder in folders for path in read_folder(folder)]
    if not paths:
        raise BadInput(
            "no training data is named" if not folders else f"{folders[0]} holds no shard",
            "Make a data set with labr-mission dataset, and name its folder.",
        )
    return join([read_shard(path) for path in paths])


def join(shards: Sequence[Shard]) -> Views:
    """Shards, one per scene, as one set of views."""
    for what in ("images_mm", "goals_m"):
        shapes = sorted({getattr(shard, what).shape[1:] for shard in shards})
        if len(shapes) > 1:
            raise BadInput(
                f"data sets differ in {what}: {' and '.join(str(shape) for shape in shapes)}",
                "Make them with the same --size and --goals.",
            )

    def joined(name: str) -> NDArray[np.generic]:
        return np.concatenate([getattr(shard, name) for shard in shards])

    sizes = [shard.air_cm.size for shard in shards]
    air = Air(
        values_cm=np.concatenate([shard.air_cm.ravel() for shard in shards]),
        start=np.cumsum([0, *sizes[:-1]]).astype(np.int64),
        shape=np.array([shard.air_cm.shape for shard in shards], np.int64),
        origin_m=np.array([shard.air_origin_m for shard in shards], np.float64),
        cell_m=np.array([shard.air_cell_m for shard in shards], np.float64),
    )
    stored = (set(_OF_GOAL) | set(_OF_VIEW)) - {"target_z_m", "scene"}
    arrays = {name: joined(name) for name in stored}
    step_m = np.concatenate([_goal_steps(shard) for shard in shards])
    goals = arrays["goals_m"].astype(np.float32)
    target_z_m = goals[..., 2] - step_m
    goals[..., 2] = np.where(arrays["in_air"], goals[..., 2], target_z_m)
    arrays["goals_m"] = goals
    return Views(
        **arrays,  # type: ignore[arg-type]
        target_z_m=target_z_m,
        scene=np.repeat(np.arange(len(shards)), [len(shard.images_mm) for shard in shards]),
        air=air,
        families=tuple(shard.family for shard in shards),
        seeds=tuple(shard.seed for shard in shards),
    )


def _goal_steps(shard: Shard) -> NDArray[np.float32]:
    """Height of the floor at each goal (v, k) above the floor under the robot [m]; 0 where none is known."""
    goals, yaw = shard.goals_m, shard.poses[:, 3]
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x = c * goals[..., 0] - s * goals[..., 1] + shard.poses[:, None, 0]
    y = s * goals[..., 0] + c * goals[..., 1] + shard.poses[:, None, 1]
    at = (np.stack([x, y], axis=-1) - shard.land_corner_m[:, None]) / LAND_CELL_M
    cell = np.clip(at.astype(np.int64), 0, LAND_SIDE - 1)
    step = shard.floors_cm[np.arange(len(goals))[:, None], cell[..., 0], cell[..., 1]]
    return np.where(step == NO_FLOOR, 0.0, 0.01 * step).astype(np.float32)
