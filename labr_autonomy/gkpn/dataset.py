"""Reading training data: depth views, poses, goals and the solids they were drawn from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from labr_autonomy.errors import BadInput

NAMES = ("images_m", "poses", "goals_m", "scene", "solids", "families", "seeds")
MAKE = "Make one with: python -m sim.dataset FILE.npz"
FLOOR_HEIGHT_M = 0.12  # body origin above the floor when it stands on its wheels (config.Body.below_m)


@dataclass(frozen=True, slots=True)
class Views:
    """One data set in memory; an .npz file with arrays of these names.

    Rows of `solids` are: kind (0 box, 1 vertical cylinder), centre x y z, half extents x y z (a cylinder's
    radius twice), yaw; odom, metres and radians. Rows beyond a scene's solids lie 1 km away.
    """

    images_m: Tensor  # (v, 90, 160) float16, 0 = invalid
    poses: Tensor  # (v, 6) float32: x, y, z, yaw, roll, pitch of the body in odom
    goals_m: Tensor  # (v, g, 3) float32, level frame
    scene: Tensor  # (v,) int64 index into solids
    solids: Tensor  # (s, n, 8) float32
    families: tuple[str, ...]  # (s,)
    seeds: tuple[int, ...]  # of the files

    def __len__(self) -> int:
        """Number of views."""
        return len(self.images_m)

    def floor_m(self, index: Tensor) -> Tensor:
        """h_R of the views: driving height relative to the body (b,)."""
        return FLOOR_HEIGHT_M - self.poses[index, 2]

    def facts(self) -> dict[str, object]:
        """What the data set is, for the manifest."""
        counts = {family: self.families.count(family) for family in sorted(set(self.families))}
        goals = int(self.goals_m.shape[1])
        return {"seeds": list(self.seeds), "scenes": counts, "views": len(self), "goals_per_view": goals}


def load(*paths: Path) -> Views:
    """Read one or several files as one data set."""
    parts = [_read(path) for path in paths]
    rows = max(p["solids"].shape[1] for p in parts)
    offset, scenes, solids = 0, [], []
    for p in parts:
        scenes.append(p["scene"].astype(np.int64) + offset)
        offset += len(p["solids"])
        far = np.zeros((len(p["solids"]), rows - p["solids"].shape[1], 8), np.float32)
        far[..., 1:4], far[..., 4:7] = 1e3, 0.1
        solids.append(np.concatenate([p["solids"], far], axis=1))

    def joined(name: str) -> Tensor:
        return torch.from_numpy(np.concatenate([p[name] for p in parts]))

    return Views(
        images_m=joined("images_m"),
        poses=joined("poses"),
        goals_m=joined("goals_m"),
        scene=torch.from_numpy(np.concatenate(scenes)),
        solids=torch.from_numpy(np.concatenate(solids)),
        families=tuple(str(f) for p in parts for f in p["families"]),
        seeds=tuple(int(s) for p in parts for s in p["seeds"]),
    )


def _read(path: Path) -> dict[str, np.ndarray]:
    """The arrays of one file."""
    try:
        with np.load(path) as file:
            arrays = {name: file[name] for name in NAMES}
    except FileNotFoundError:
        raise BadInput(
            f"there is no data set {path}", "Make one with: python -m sim.dataset FILE.npz"
        ) from None
    except KeyError as error:
        raise BadInput(
            f"{path} is no GKPN data set: {error}", "Make it with: python -m sim.dataset"
        ) from None
    used = int((np.abs(arrays["solids"][..., 1]) < 500.0).any(axis=0).sum())
    arrays["solids"] = arrays["solids"][:, : max(used, 1)]
    return arrays
