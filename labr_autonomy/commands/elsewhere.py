"""`labr-mission fly --world W`: a mission in another world than that of its own `sim` block."""

from __future__ import annotations

import math
from pathlib import Path

from labr_autonomy.errors import BadInput
from labr_autonomy.mission.schema import DescribedWorld, GeneratedWorld, MeshWorld, Mission, Sim, Start

FAMILIES = ("indoor", "rooms", "garage", "forest", "hall")


def in_world(mission: Mission, world: str, worlds_dir: Path | None) -> Mission:
    """The mission with its `sim.world` replaced.

    Args:
        mission: Start, seed and disturbances of its `sim` block stay; without one a world file's start holds.
        world: A family, or a world file or mesh: a path, or a name below the worlds folder.
        worlds_dir: Folder with mesh worlds.

    Raises:
        BadInput: It is neither.
    """
    from sim.worlds.mesh import SUFFIXES

    path = Path(world)
    file = str(path.resolve()) if path.is_file() else world
    said: DescribedWorld | MeshWorld | GeneratedWorld
    # A path that an operator types may lie anywhere; the schema's rule is for what a mission file names.
    if path.suffix.lower() in (".yaml", ".yml"):
        said = DescribedWorld.model_construct(file=file)
    elif path.suffix.lower() in SUFFIXES:
        said = MeshWorld.model_construct(mesh=file)
    elif world in FAMILIES:
        said = GeneratedWorld(family=world)
    else:
        raise BadInput(
            f"'{world}' is no world",
            f"Name a family ({', '.join(FAMILIES)}), a world file (.yaml) or a mesh ({' '.join(SUFFIXES)}).",
        )
    if mission.sim is not None:
        return mission.model_copy(update={"sim": mission.sim.model_copy(update={"world": said})})
    start = _start_of(said, worlds_dir) if isinstance(said, DescribedWorld) else Start()
    return mission.model_copy(update={"sim": Sim.model_construct(world=said, start=start)})


def _start_of(world: DescribedWorld, worlds_dir: Path | None) -> Start:
    from sim.worlds.build import worlds_folder
    from sim.worlds.world_file import find_world_file, read_world_file

    folder = worlds_folder(worlds_dir)
    place = read_world_file(find_world_file(world.file, folder), folder).get("start")
    if place is None:
        return Start()
    x, y, yaw_rad, z = place
    return Start(x=x, y=y, z=z, yaw_deg=math.degrees(yaw_rad))
