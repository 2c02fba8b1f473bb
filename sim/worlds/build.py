"""One entry for every world: a generated family or a mesh file, from a few plain values."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from labr_autonomy.errors import BadInput
from labr_autonomy.types import Array
from sim.worlds.mesh import load_mesh
from sim.worlds.world import World

_ENV = "LABR_WORLDS"
_SHARED = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "worlds"
_FAMILY_KEYS = {"family", "size_m", "difficulty", "seed", "clear_m"}
_MESH_KEYS = {"mesh", "scale", "up", "worlds_dir", "name", "bounds", "start", "goals"}
_KEYS = _FAMILY_KEYS | _MESH_KEYS | {"file"}

# Where the world data that the missions name comes from; none of it is in this repository.
_SOURCES = {
    "aws_small_house": "AWS RoboMaker small house world "
    "(github.com/aws-robotics/aws-robomaker-small-house-world, MIT-0)",
    "ethz_forest": "ETH Zurich forest generator (github.com/ethz-asl/forest_gen, BSD-2-Clause)",
    "parking_garage": "mesh navigation tutorials "
    "(github.com/naturerobots/mesh_navigation_tutorials, BSD-3-Clause)",
}

Place = tuple[float, float, float]


def build_world(
    spec: Mapping[str, Any],
    *,
    seed: int,
    clear_m: Sequence[Place] = (),
    worlds_dir: Path | None = None,
) -> World:
    """Make the world of a mission.

    Args:
        spec: {"family": name, "size_m": [x, y], "difficulty": 0..1} for a generated world, or {"mesh": file,
            "scale": metres per unit, "up": axis, "bounds": [[x, y, z], [x, y, z]], "start", "goals"} for a
            mesh file, or {"file": a world file that says all this} (see `world_file`).
        seed: Seed of a generated world.
        clear_m: Places (x, y, z) in odom [m] that a generated world keeps free.
        worlds_dir: Folder of the mesh files; by default $LABR_WORLDS, else `shared/data/worlds` beside the
            checkout.

    Returns:
        The world; its `spec` is plain JSON and `rebuild_world(spec)` makes the same world again.
    """
    unknown = sorted(set(spec) - _KEYS)
    if unknown:
        raise BadInput(f"a world has no field '{unknown[0]}'", f"Known fields: {', '.join(sorted(_KEYS))}.")
    if sum(kind in spec for kind in ("family", "mesh", "file")) != 1:
        raise BadInput("a world is either a `family` or a `mesh` or a `file`", "Give exactly one of them.")
    if "file" in spec:
        return _described(spec, worlds_dir)
    return _mesh(spec, worlds_dir) if "mesh" in spec else _family(spec, seed, clear_m)


def rebuild_world(spec: Mapping[str, Any]) -> World:
    """The world that `build_world` described in `World.spec`, for another process."""
    folder = spec.get("worlds_dir")
    return build_world(
        spec,
        seed=int(spec.get("seed", 0)),
        clear_m=[(float(x), float(y), float(z)) for x, y, z in spec.get("clear_m", ())],
        worlds_dir=Path(folder) if folder else None,
    )


def _family(spec: Mapping[str, Any], seed: int, clear_m: Sequence[Place]) -> World:
    from sim.worlds.families.draw import DIFFICULTY, SIZES, draw_world

    name = str(spec["family"])
    try:
        x_m, y_m = (float(v) for v in spec.get("size_m") or SIZES.get(name, (14.0, 10.0)))
    except (TypeError, ValueError) as error:
        raise BadInput(f"size_m is {spec['size_m']!r}", "Give two lengths [x, y] in metres.") from error
    places = [[float(v) for v in place] for place in clear_m]
    kept = np.array(places).reshape(-1, 3)
    again: dict[str, Any] = {"family": name, "size_m": [x_m, y_m], "seed": seed, "clear_m": places}
    if name == "hall":
        from sim.worlds.solids import generate

        return replace(generate(name, seed, (x_m, y_m), kept), spec=again)
    difficulty = float(spec.get("difficulty", DIFFICULTY))
    if not 0.0 <= difficulty <= 1.0:
        raise BadInput(f"the difficulty of '{name}' is {difficulty:g}", "Give 0 (easy) to 1 (hard).")
    world = draw_world(name, seed, (x_m, y_m), difficulty, kept)
    return replace(world, spec={**again, "difficulty": difficulty})


def worlds_folder(worlds_dir: Path | None) -> Path:
    """Where mesh worlds are: as named, else $LABR_WORLDS, else beside the checkout."""
    return worlds_dir or Path(os.environ.get(_ENV) or _SHARED)


def _described(spec: Mapping[str, Any], worlds_dir: Path | None) -> World:
    """The world of a world file, which is checked against its mesh; its spec names the mesh itself."""
    from sim.worlds.fit import check_fit
    from sim.worlds.world_file import find_world_file, read_world_file

    folder = worlds_folder(worlds_dir)
    said = read_world_file(find_world_file(str(spec["file"]), folder), folder)
    world = _mesh(said, Path(said["worlds_dir"]))
    check_fit(world, said)
    return world


def _mesh(spec: Mapping[str, Any], worlds_dir: Path | None) -> World:
    name = str(spec["mesh"])
    folder = worlds_folder(worlds_dir)
    path = folder / name
    if not path.is_file():
        source = _SOURCES.get(Path(name).parts[0] if Path(name).parts else "")
        origin = f"Its public source is the {source}: get it and" if source else "Get it and"
        raise BadInput(
            f"the world mesh '{name}' is not in {folder}",
            f"{origin} name the folder that holds it by --worlds DIR.",
        )
    try:
        scale = float(spec.get("scale", 1.0))
    except (TypeError, ValueError) as error:
        raise BadInput(f"the scale of '{name}' is {spec['scale']!r}", "Give metres per unit.") from error
    up = spec.get("up")
    called = str(spec["name"]) if "name" in spec else None
    world = load_mesh(path, scale=scale, up=None if up is None else str(up).lower(), name=called)
    again: dict[str, Any] = {"mesh": name, "scale": scale, "worlds_dir": str(folder)}
    again |= {key: spec[key] for key in ("name", "bounds", "start", "goals") if key in spec}
    if up is not None:
        again["up"] = str(up).lower()
    region = _region(name, spec["bounds"]) if "bounds" in spec else world.region_m
    return replace(world, spec=again, region_m=region)


def _region(name: str, bounds: Any) -> Array:
    """Bounds as an array (2, 3), odom [m]."""
    try:
        region = np.array(bounds, dtype=np.float64)
    except (TypeError, ValueError):
        region = np.zeros(0)
    if region.shape != (2, 3) or not np.isfinite(region).all() or (region[0] >= region[1]).any():
        raise BadInput(
            f"the bounds of '{name}' are {bounds!r}", "Give [[x0, y0, z0], [x1, y1, z1]] in metres."
        )
    return region
