"""A mesh world that a person brings: a small YAML beside the mesh.

```yaml
mesh: small_house.npz        # .glb .obj .ply .stl .dae, or .npz with V and F; relative to this file
scale: 1.0                   # metres per unit
up: z                        # axis of the file that points up
bounds: [[-9, -5, -0.1], [9, 5, 2.5]]              # corners of where goals are drawn; left out: the mesh's
start: {x: -7.0, y: 2.0, yaw_deg: 90.0, z: 0.0}    # floor height z; left out: sampled
goals: [[4.0, -2.0], [5.0, 1.0, 1.5]]              # x, y on the floor; x, y, z in the air; left out: sampled
```
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from labr_autonomy.config import Section
from labr_autonomy.errors import BadInput
from labr_autonomy.mission.load import load_as
from labr_autonomy.record.run_folder import slug
from sim.bench.settings import Place


class Start(Section):
    """Where the robot stands at first."""

    x: float
    y: float
    yaw_deg: float = 0.0
    z: float = Field(default=0.0, description="height of the floor there [m]")


Corner = Annotated[list[float], Field(min_length=3, max_length=3)]
Goal = Annotated[list[float], Field(min_length=2, max_length=3)]


class WorldFile(Section):
    """The whole file."""

    mesh: str = Field(min_length=1)
    name: str | None = Field(default=None, min_length=1)
    scale: float = Field(default=1.0, gt=0.0)
    up: Literal["x", "y", "z", "X", "Y", "Z"] | None = None
    start: Start | None = None
    bounds: list[Corner] | None = Field(default=None, min_length=2, max_length=2)
    goals: list[Goal] | None = Field(default=None, min_length=1)


def load_place(path: Path) -> Place:
    """Read a world file.

    Returns:
        A place whose spec holds `mesh`, `scale`, `up`, `worlds_dir` as `build_world` takes them, and
        `bounds`, `start` [x, y, yaw_rad, floor z] and `goals` where the file names them.

    Raises:
        FileProblems, BadInput: when it cannot be used.
    """
    world = load_as(path, WorldFile)
    mesh = (path.parent / world.mesh).resolve()
    if not mesh.is_file():
        raise BadInput(f"{path} names the mesh '{world.mesh}', which is not beside it", "Correct `mesh`")
    spec: dict[str, Any] = {"mesh": mesh.name, "scale": world.scale, "worlds_dir": str(mesh.parent)}
    if world.up is not None:
        spec["up"] = world.up.lower()
    if world.start is not None:
        start = world.start
        spec["start"] = [start.x, start.y, math.radians(start.yaw_deg), start.z]
    if world.bounds is not None:
        spec["bounds"] = world.bounds
    if world.goals is not None:
        spec["goals"] = world.goals
    return Place(slug(world.name or path.stem), spec)
