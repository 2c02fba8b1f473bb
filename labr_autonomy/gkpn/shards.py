"""Training data on disk: one file of arrays for each scene, and a manifest that vouches for a folder of them.

Frames: odom for poses and fields, the level frame of each view for its goals. Lengths are metres unless the
name says otherwise: images are whole millimetres, distances whole centimetres, so that a scene fits into a
few megabytes.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.local_map import CHANNELS, SIDE

FORMAT = 1
LAND_SIDE, LAND_CELL_M = 160, 0.1  # field of driving around each view
NO_FLOOR = -32768  # in `floors_cm`
FAR_CM = 127  # distances are clipped to this
MANIFEST = "manifest.json"
REMEDY = "Delete it and run the same labr-mission dataset command again"


@dataclass(frozen=True, slots=True)
class Shard:
    """Views of one scene, with goals and the truth that a loss needs."""

    images_mm: NDArray[np.uint16]  # (v, h, w) the network's depth image, 0 = invalid
    maps: NDArray[np.uint8]  # (v, CHANNELS, SIDE * SIDE // 8) packed bits of `gkpn.local_map.local_map`
    poses: NDArray[np.float32]  # (v, 6) x, y, z, yaw, roll, pitch of the body, odom
    floor_m: NDArray[np.float32]  # (v,) h_R: z, level frame, at which it would drive below; 0 where it stands
    goals_m: NDArray[np.float32]  # (v, k, 3) level frame
    in_air: NDArray[np.bool_]  # (v, k) the goal is flown to
    hard: NDArray[np.bool_]  # (v, k) the straight line to it is blocked
    land_cm: NDArray[np.int8]  # (v, LAND_SIDE, LAND_SIDE) signed distance to what hinders driving
    floors_cm: NDArray[np.int16]  # (v, LAND_SIDE, LAND_SIDE) above the floor under the robot, or NO_FLOOR
    land_corner_m: NDArray[np.float32]  # (v, 2) lower corner of cell (0, 0), odom; axes parallel to odom
    air_cm: NDArray[np.int8]  # (nx, ny, nz) signed distance of voxel centres to any surface
    air_origin_m: NDArray[np.float32]  # (3,) lower corner of voxel (0, 0, 0), odom
    air_cell_m: float
    family: str
    seed: int


_KINDS: dict[str, tuple[str, int]] = {  # dtype, dimensions
    "images_mm": ("uint16", 3),
    "maps": ("uint8", 3),
    "poses": ("float32", 2),
    "floor_m": ("float32", 1),
    "goals_m": ("float32", 3),
    "in_air": ("bool", 2),
    "hard": ("bool", 2),
    "land_cm": ("int8", 3),
    "floors_cm": ("int16", 3),
    "land_corner_m": ("float32", 2),
    "air_cm": ("int8", 3),
    "air_origin_m": ("float32", 1),
}
_NAMES = {f.name for f in fields(Shard)}


def write_shard(path: Path, shard: Shard) -> str:
    """Write a shard under another name, then rename it; returns its sha256."""
    stream = io.BytesIO()
    np.savez_compressed(stream, format=FORMAT, **{name: getattr(shard, name) for name in sorted(_NAMES)})
    data = stream.getvalue()
    _write(path, data)
    return hashlib.sha256(data).hexdigest()


def read_shard(path: Path) -> Shard:
    """The shard of a file.

    Raises:
        BadInput: when it is missing, damaged, of another format, or its arrays do not fit together.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            values: dict[str, Any] = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise BadInput(f"there is no shard {path}", "Make it with: labr-mission dataset FOLDER") from None
    except (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile, zlib.error):
        raise BadInput(f"the shard {path} is damaged", f"{REMEDY}.") from None
    found = int(values.pop("format", -1))
    if found != FORMAT:
        raise BadInput(f"the shard {path} has format {found}, not {FORMAT}", "Make the folder anew.")
    wrong = _misfit(values)
    if wrong:
        raise BadInput(f"the shard {path} is damaged: {wrong}", f"{REMEDY}.")
    scalars = {
        "air_cell_m": float(values["air_cell_m"]),
        "family": str(values["family"]),
        "seed": int(values["seed"]),
    }
    return Shard(**{**values, **scalars})


def _misfit(values: Mapping[str, Any]) -> str:
    """What is wrong with the arrays of a shard; empty when they fit."""
    if set(values) != _NAMES:
        return f"its arrays are {', '.join(sorted(values))}"
    for name, (kind, dimensions) in _KINDS.items():
        if str(values[name].dtype) != kind or values[name].ndim != dimensions:
            return f"'{name}' is {values[name].dtype} of shape {values[name].shape}"
    v, k = values["in_air"].shape
    wanted = {
        "images_mm": (v, *values["images_mm"].shape[1:]),
        "maps": (v, CHANNELS, SIDE * SIDE // 8),
        "poses": (v, 6),
        "floor_m": (v,),
        "goals_m": (v, k, 3),
        "hard": (v, k),
        "land_cm": (v, LAND_SIDE, LAND_SIDE),
        "floors_cm": (v, LAND_SIDE, LAND_SIDE),
        "land_corner_m": (v, 2),
        "air_origin_m": (3,),
    }
    for name, shape in wanted.items():
        if values[name].shape != shape:
            return f"'{name}' has shape {values[name].shape} instead of {shape}"
    return "" if values["air_cell_m"] > 0.0 else "its voxels have no size"


def write_manifest(
    folder: Path,
    settings: Mapping[str, Any],
    entries: Sequence[Mapping[str, Any]],
    skipped: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Vouch for a folder of shards, and return what is written.

    Args:
        folder: Of the shards.
        settings: What they were made by, plain JSON.
        entries: One a shard: file, sha256, family, seed, views, and the numbers of goals, hard and air ones.
        skipped: Shards that could not be made: file, why.
    """
    listed = sorted(entries, key=lambda entry: str(entry["file"]))
    views, goals, hard, air = (sum(e[key] for e in listed) for key in ("views", "goals", "hard", "air"))
    counts = {
        "scenes": len(listed),
        "views": views,
        "goals": goals,
        "hard_share": round(hard / goals, 4) if goals else None,
        "air_share": round(air / goals, 4) if goals else None,
    }
    manifest = {
        "format": FORMAT,
        "settings": dict(settings),
        "families": {f: sum(e["family"] == f for e in listed) for f in sorted({e["family"] for e in listed})},
        "counts": counts,
        "sha256": hashlib.sha256("".join(e["sha256"] for e in listed).encode()).hexdigest(),
        "shards": listed,
        "skipped": sorted(skipped, key=lambda entry: str(entry["file"])),
    }
    _write(folder / MANIFEST, (json.dumps(manifest, indent=1) + "\n").encode())
    return manifest


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a folder of shards.

    Raises:
        BadInput: when there is none, or it cannot be used.
    """
    path = folder / MANIFEST
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        whole = hashlib.sha256("".join(e["sha256"] for e in manifest["shards"]).encode()).hexdigest()
        good = manifest["sha256"] == whole and isinstance(manifest["settings"], dict)
    except FileNotFoundError:
        raise BadInput(
            f"there is no data set in {folder}", "Make one with: labr-mission dataset FOLDER"
        ) from None
    except (ValueError, KeyError, TypeError, OSError):
        good = False
    if not good:
        raise BadInput(f"{path} is damaged", f"{REMEDY}.")
    if manifest["format"] != FORMAT:
        raise BadInput(f"{path} has format {manifest['format']}, not {FORMAT}", "Make the folder anew.")
    checked: dict[str, Any] = manifest
    return checked


def read_folder(folder: Path) -> list[Path]:
    """Shards of a folder in the manifest's order, each compared with its sha256.

    Raises:
        BadInput: when one is missing or is not what the manifest vouches for.
    """
    paths = []
    for entry in read_manifest(folder)["shards"]:
        path = folder / entry["file"]
        if not path.is_file():
            raise BadInput(f"the shard {path} is missing", "Run the same labr-mission dataset command again.")
        if digest(path) != entry["sha256"]:
            raise BadInput(f"the shard {path} is damaged: its sha256 is not the manifest's", f"{REMEDY}.")
        paths.append(path)
    return paths


def digest(path: Path) -> str:
    """The sha256 of a file, hexadecimal."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _write(path: Path, data: bytes) -> None:
    """All of a file or nothing."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    part.write_bytes(data)
    part.replace(path)
