"""World files: a page of YAML that names a mesh and says where in it a robot may be asked to go.

Everything is in the frame of the world, which is odom of the simulator: the mesh after `scale` and `up`,
metres, z up. `read_world_file` checks the file by itself; `sim.worlds.fit` checks it against the mesh.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from labr_autonomy.errors import BadInput
from labr_autonomy.mission.load import validated
from labr_autonomy.mission.schema import BelowFolder, Coordinate
from labr_autonomy.mission.section import Section
from labr_autonomy.mission.source import read_source

SHIPPED = Path(__file__).resolve().parent / "files"  # world files that come with the simulator
THINNEST_M = 1.0  # bounds thinner than this in x or y hold no way to anywhere

Corner3 = Annotated[tuple[Coordinate, Coordinate, Coordinate], Field(description="[x, y, z] in metres")]


class StartPlace(Section):
    """Where a robot stands at first."""

    x: Coordinate
    y: Coordinate
    z: Coordinate = 0.0
    """Height of the floor there [m]."""
    yaw_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 0.0
    """Heading, counter-clockwise from x [deg]."""


class GoalPlace(Section):
    """A place worth going to: `{x, y}` on the floor, `{x, y, z}` in the air."""

    x: Coordinate
    y: Coordinate
    z: Coordinate | None = None
    """Height of the body [m], in the mesh's own heights; leave it out for a place on the floor."""


class WorldFile(Section):
    """A mesh as a world."""

    model_config = ConfigDict(title="LABR world")

    version: Literal[1]
    """Version of this format."""
    name: Annotated[str, Field(min_length=1, max_length=80)]
    """What the world is called in reports."""
    mesh: BelowFolder
    """Mesh file, relative to this file or to the worlds folder (`--worlds DIR`)."""
    scale: Annotated[float, Field(gt=0.0, le=1000.0)] = 1.0
    """Metres per unit of the mesh; for COLLADA, on top of the file's own unit."""
    up: Literal["x", "y", "z"] | None = None
    """The mesh's axis that points up; what the format says when left out."""
    bounds: tuple[Corner3, Corner3] | None = None
    """Lower and upper corner of where a robot may be asked to go [m]; the whole mesh when left out."""
    start: StartPlace | None = None
    goals: Annotated[tuple[GoalPlace, ...], Field(max_length=500)] = ()
    """Places worth going to."""
    notes: Annotated[str, Field(max_length=10_000)] = ""
    """Free text: where the mesh comes from, under which licence."""

    @model_validator(mode="after")
    def _lies_within_its_bounds(self) -> WorldFile:
        if self.bounds is None:
            return self
        low, high = self.bounds
        for axis, least_m in (("x", THINNEST_M), ("y", THINNEST_M), ("z", 0.0)):
            k = "xyz".index(axis)
            if high[k] - low[k] <= least_m:
                raise PydanticCustomError(
                    "bounds_thin",
                    "the bounds are {wide} m wide in {axis}",
                    {
                        "wide": f"{high[k] - low[k]:.6g}",
                        "axis": axis,
                        "at": "bounds",
                        "hint": "give [[x0, y0, z0], [x1, y1, z1]], the lower corner first",
                    },
                )
        places = {"start": (self.start,) if self.start else (), "goals": self.goals}
        for key, listed in places.items():
            for place in listed:
                at = (place.x, place.y)
                if any(not low[k] <= at[k] <= high[k] for k in (0, 1)):
                    raise PydanticCustomError(
                        "outside_bounds",
                        "({x}, {y}) lies outside the bounds in x or y",
                        {
                            "x": f"{at[0]:g}",
                            "y": f"{at[1]:g}",
                            "at": key,
                            "hint": "widen `bounds` or move it",
                        },
                    )
        return self


def find_world_file(name: str, folder: Path) -> Path:
    """A world file below the worlds folder, or one that comes with the simulator.

    Raises:
        BadInput: when it is in neither.
    """
    for place in (folder, SHIPPED):
        if (place / name).is_file():
            return place / name
    shipped = ", ".join(sorted(path.name for path in SHIPPED.glob("*.yaml")))
    raise BadInput(
        f"the world file '{name}' is not in {folder}",
        f"Name the folder that holds it by --worlds DIR, or take one that comes along: {shipped}.",
    )


def read_world_file(path: Path, worlds_dir: Path) -> dict[str, Any]:
    """The spec for `build_world` that a world file stands for.

    Args:
        path: The file.
        worlds_dir: Where its mesh is when it is not beside the file.

    Returns:
        {"mesh", "scale", "worlds_dir", "name"} and, where given, "up"; "bounds" [[x, y, z], [x, y, z]];
        "start" [x, y, yaw [rad], floor z]; "goals" [[x, y] or [x, y, z], ...]. World frame [m].

    Raises:
        FileProblems: with everything wrong in it.
        BadInput: when it cannot be read.
    """
    said = validated(read_source(path), WorldFile)
    beside = path.resolve().parent
    spec: dict[str, Any] = {
        "mesh": said.mesh,
        "scale": said.scale,
        "name": said.name,
        "worlds_dir": str(beside if (beside / said.mesh).is_file() else worlds_dir),
    }
    if said.up is not None:
        spec["up"] = said.up
    if said.bounds is not None:
        spec["bounds"] = [list(corner) for corner in said.bounds]
    if said.start is not None:
        start = said.start
        spec["start"] = [start.x, start.y, math.radians(start.yaw_deg), start.z]
    if said.goals:
        spec["goals"] = [[g.x, g.y] if g.z is None else [g.x, g.y, g.z] for g in said.goals]
    return spec
