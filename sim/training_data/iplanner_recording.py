"""Reading one recording in iPlanner's own layout: poses, cameras, and its cost map turned into distances.

Lengths in metres; its odom is ours (z up). Its cost map is log(penetration + 1.00001), the penetration in
cells of 0.05 m into what is occupied or was never seen; what lies under 0.65 of a cell is free.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from labr_autonomy.errors import BadInput
from labr_autonomy.perception.fields import Field2
from labr_autonomy.types import Array, Image, Intrinsics

PENETRATION_CELLS = 0.65
_ODOM, _MAP = "odom_ground_truth.txt", "tsdf1"
_LAYOUT = "See the collector of github.com/leggedrobotics/iPlanner for the layout."


@dataclass(frozen=True, slots=True)
class Recording:
    """One environment."""

    name: str
    folder: Path
    position_m: Array  # (n, 3) odom
    rotation: Array  # (n, 3, 3) body to odom
    T_body_camera: Array  # (4, 4) camera-FLU to body
    projection: tuple[float, float, float, float]  # fx, fy, cx, cy [px]
    land: Field2  # over the whole map

    def __len__(self) -> int:
        """Number of pictures."""
        return len(self.position_m)

    def picture(self, number: int) -> tuple[Image, Intrinsics]:
        """Depth (h, w) [m], 0 = invalid, and the camera."""
        path = self.folder / "depth" / f"{number}.png"
        raw = cv2.imread(str(path), cv2.IMREAD_ANYDEPTH)
        if raw is None or raw.dtype != np.uint16 or raw.ndim != 2:
            raise BadInput(f"{path} is no 16-bit depth image", _LAYOUT)
        fx, fy, cx, cy = self.projection
        h, w = raw.shape
        return raw.astype(np.float32) / np.float32(1000.0), Intrinsics(w, h, fx, fy, cx, cy)


def find_recordings(folder: Path) -> list[Path]:
    """The folder itself if it is a recording, else those in it.

    Raises:
        BadInput: when there is none.
    """
    if (folder / _ODOM).is_file():
        return [folder]
    found = sorted(path.parent for path in folder.glob(f"*/{_ODOM}"))
    if not found:
        raise BadInput(f"there is no recording of iPlanner in {folder}", f"It has a file {_ODOM}.")
    return found


def poses_in(folder: Path) -> Array:
    """Rows x, y, z, qx, qy, qz, qw of a recording, (n, 7)."""
    return _rows(folder / _ODOM, (7,))


def read_recording(folder: Path) -> Recording:
    """A recording without its pictures.

    Raises:
        BadInput: when a file of it is missing or cannot be understood.
    """
    rows = poses_in(folder)
    extrinsic = _rows(folder / "camera_extrinsic.txt", (7,))[0]  # qx, qy, qz, qw, x, y, z
    k = _rows(folder / "depth_intrinsic.txt", (12, 16))[0]
    optical = _rotations(extrinsic[None, :4])[0]  # z along the optical axis
    T = np.eye(4)
    T[:3, :3] = optical @ np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    T[:3, 3] = extrinsic[4:]
    if T[0, 0] < 0.5:
        raise BadInput(
            f"the camera of {folder} does not look ahead",
            "Give camera_extrinsic.txt as [qx, qy, qz, qw, x, y, z] of the optical frame in the body.",
        )
    projection = (float(k[0]), float(k[5]), float(k[2]), float(k[6]))
    return Recording(
        folder.name, folder, rows[:, :3], _rotations(rows[:, 3:]), T, projection, _land(folder / "maps")
    )


def _land(maps: Path) -> Field2:
    """Signed distance to what is occupied or unknown, over the whole map and a rim round it."""
    parameters = _numbers(maps / "params" / f"{_MAP}_param.txt")
    if len(parameters) < 3 or parameters[0] <= 0.0:
        raise BadInput(f"{maps / 'params' / f'{_MAP}_param.txt'} has no voxel and start", _LAYOUT)
    cell_m, start_m = parameters[0], np.array(parameters[1:3])
    path = maps / "data" / f"{_MAP}_map.txt"
    try:
        cost = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError):
        raise BadInput(f"the cost map {path} cannot be read", _LAYOUT) from None
    solid = np.pad(np.exp(cost) - 1.00001 > PENETRATION_CELLS, 1, constant_values=True)
    corner = start_m - 1.5 * cell_m  # its cell i has its middle at start + i * voxel; the rim is one cell
    return Field2.from_occupied(solid, np.ones(solid.shape, np.bool_), corner, cell_m)


def _rotations(xyzw: Array) -> Array:
    """Rotation matrices (n, 3, 3) of quaternions (n, 4)."""
    x, y, z, w = (xyzw / np.linalg.norm(xyzw, axis=1, keepdims=True)).T
    out: Array = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    return out


def _rows(path: Path, lengths: tuple[int, ...]) -> Array:
    """Lines "[a, b, ...]" of numbers, (n, length)."""
    try:
        lines = [line.strip().strip("[]") for line in path.read_text(encoding="utf-8").splitlines()]
        rows = [[float(v) for v in re.split(r"[,\s]+", line.strip())] for line in lines if line]
    except (OSError, ValueError):
        raise BadInput(f"{path} cannot be read", _LAYOUT) from None
    if not rows or any(len(row) != len(rows[0]) for row in rows) or len(rows[0]) not in lengths:
        wanted = " or ".join(str(n) for n in lengths)
        raise BadInput(f"{path} does not have {wanted} numbers a line", _LAYOUT)
    out = np.array(rows)
    if not np.isfinite(out).all():
        raise BadInput(f"{path} has numbers that are not finite", _LAYOUT)
    return out


def _numbers(path: Path) -> list[float]:
    return [float(v) for v in _rows(path, (1,)).ravel()]
