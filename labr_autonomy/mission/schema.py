"""What a mission file may say. The field descriptions are the file's documentation (`check --schema`).

Positions are metres in odom: x and y on the floor, z up from the map's floor. A person writes degrees,
marked `_deg`; all else is SI.
"""

from __future__ import annotations

import enum
import re
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Tag, field_validator, model_validator
from pydantic_core import PydanticCustomError

from labr_autonomy.mission.disturbances import Disturbances
from labr_autonomy.mission.section import Section

SPAN_M = 10_000.0  # no coordinate is farther from the origin than this
AIR_GOAL_MIN_M = 0.4  # below this the rotors work in their own ground wash and the wheels do it better
RADIUS_MAX_M = 5.0
PLACE_NAME = r"^[A-Za-z_][A-Za-z0-9_-]{0,39}$"

Coordinate = Annotated[float, Field(ge=-SPAN_M, le=SPAN_M)]
Corner = Annotated[tuple[Coordinate, Coordinate], Field(description="[x, y] in metres")]


class GoalMode(enum.Enum):
    """How a goal may be reached."""

    AUTO = "auto"
    GROUND = "ground"
    AIR = "air"


class OnFail(enum.Enum):
    """What happens when an item cannot be done."""

    STOP = "stop"
    SKIP = "skip"
    HOLD = "hold"


class Point(Section):
    """A place to be."""

    x: Coordinate
    """East of the origin [m]."""
    y: Coordinate
    """North of the origin [m]."""
    z: Coordinate | None = None
    """Height of the body above the map's floor [m]. Leave it out for a goal on the floor."""

    @field_validator("z")
    @classmethod
    def _z_is_flown(cls, z: float | None) -> float | None:
        if z is not None and z < AIR_GOAL_MIN_M:
            raise PydanticCustomError(
                "air_goal_low",
                "a goal in the air is at least {least} m up (z is {z} m)",
                {"least": AIR_GOAL_MIN_M, "z": z, "hint": "leave z out to drive there"},
            )
        return z


def _point_or_name(value: Any) -> str:
    return "PlaceName" if isinstance(value, str) else "Point"


PlaceName: TypeAlias = Annotated[str, Field(pattern=PLACE_NAME, description="a name from `places`")]
Target = Annotated[
    Annotated[Point, Tag("Point")] | Annotated[PlaceName, Tag("PlaceName")], Discriminator(_point_or_name)
]


class Accept(Section):
    """When a goal counts as reached.

    Also where the robot gets no nearer because something stands there, up to 0.6 m off.
    """

    radius_m: Annotated[float, Field(gt=0.0, le=RADIUS_MAX_M)] = 0.35
    """Distance at which the goal counts as reached [m]; on the floor in x and y, in the air in x, y and z."""


class Step(Section):
    """What every item can say besides what it does."""

    timeout_s: Annotated[float, Field(gt=0.0, le=3600.0)] = 180.0
    """The item has failed when it takes longer [s]."""
    on_fail: OnFail = OnFail.STOP
    """When the item fails: `stop` comes down and ends the mission, `skip` goes on with the next item, `hold`
    stays where it is until the operator decides."""


class Goto(Step):
    """Go to a point or a named place."""

    goto: Target
    """`{x, y}` is a goal on the floor, `{x, y, z}` a goal in the air; or the name of a place."""
    mode: GoalMode = GoalMode.AUTO
    """`auto` drives where it can and flies where it must or where it costs less; `ground` never takes off;
    `air` flies all the way."""
    accept: Accept = Accept()

    @model_validator(mode="after")
    def _ground_goals_have_no_height(self) -> Goto:
        if self.mode is GoalMode.GROUND and isinstance(self.goto, Point) and self.goto.z is not None:
            raise PydanticCustomError(
                "ground_goal_high",
                "mode 'ground' cannot reach a goal {z} m up",
                {"z": self.goto.z, "hint": "leave z out, or use mode 'auto' or 'air'", "at": "mode"},
            )
        return self


class WaitOptions(Section):
    """How long to wait."""

    seconds: Annotated[float, Field(gt=0.0, le=3600.0)]
    """Time to stay [s]."""


class Wait(Step):
    """Stay where it is, on the floor or in the air."""

    wait: WaitOptions


class LandOptions(Section):
    """Nothing to set yet."""


class Land(Step):
    """Come down here; does nothing when it stands on its wheels."""

    land: LandOptions


class ReturnOptions(Section):
    """Nothing to set yet."""


class Return(Step):
    """Go back to where the mission started, on the floor."""

    return_: ReturnOptions = Field(alias="return")
    mode: GoalMode = GoalMode.AUTO
    """As for `goto`."""
    accept: Accept = Accept()


ITEM_VERBS = {"goto": "Goto", "wait": "Wait", "land": "Land", "return": "Return"}


def _item_kind(value: Any) -> str | None:
    """Which item a mapping means; None when it names no action or more than one."""
    if isinstance(value, Step):
        return type(value).__name__
    verbs = [verb for verb in ITEM_VERBS if isinstance(value, dict) and verb in value]
    return ITEM_VERBS[verbs[0]] if len(verbs) == 1 else None


Item = Annotated[
    Annotated[Goto, Tag("Goto")]
    | Annotated[Wait, Tag("Wait")]
    | Annotated[Land, Tag("Land")]
    | Annotated[Return, Tag("Return")],
    Discriminator(_item_kind),
]


class SpeedLimits(Section):
    """Speeds that are not exceeded; the robot's own limits hold as well."""

    ground: Annotated[float, Field(gt=0.0, le=20.0)] | None = None
    """Driving [m/s]."""
    air: Annotated[float, Field(gt=0.0, le=20.0)] | None = None
    """Flying [m/s]."""


class Limits(Section):
    """Limits of the whole mission."""

    speed_mps: SpeedLimits = SpeedLimits()
    height_max_m: Annotated[float, Field(ge=AIR_GOAL_MIN_M, le=120.0)] | None = None
    """Height of the body above the map's floor never exceeded [m]; the robot's own limit by default."""
    duration_s: Annotated[float, Field(gt=0.0, le=7200.0)] = 900.0
    """The mission ends when it takes longer [s]: the robot comes down and stops."""


class Circle(Section):
    """A round fence."""

    x: Coordinate
    y: Coordinate
    radius_m: Annotated[float, Field(gt=0.0, le=SPAN_M)]


class Fence(Section):
    """A region the robot's whole outline stays inside or outside of. Every fence of the list holds."""

    polygon: Annotated[list[Corner], Field(min_length=3, max_length=200)] | None = None
    """Corners in order, not repeated at the end."""
    circle: Circle | None = None
    """A round region instead of a polygon."""
    keep: Literal["in", "out"]
    """`in`: stay inside; `out`: stay outside."""
    z: tuple[Coordinate, Coordinate] | None = None
    """Lowest and highest point of the region [m] above the map's floor; all heights if left out."""

    @model_validator(mode="after")
    def _one_shape(self) -> Fence:
        if (self.polygon is None) == (self.circle is None):
            raise PydanticCustomError(
                "fence_shape", "a fence is either a polygon or a circle", {"hint": "give one of the two"}
            )
        if self.z is not None and self.z[0] >= self.z[1]:
            raise PydanticCustomError(
                "fence_z",
                "z is [lowest, highest], but {a} >= {b}",
                {"a": self.z[0], "b": self.z[1], "at": "z"},
            )
        return self


class EnergyPolicy(Section):
    """What is kept in the pack."""

    reserve_pct: Annotated[float, Field(ge=0.0, lt=100.0)] = 15.0
    """Share of the pack that is not planned with [%]."""


MOVERS_MAX = 50


class WithMovers(Section):
    """A world in which people and boxes may walk to and fro across the robot's likely way."""

    movers: Annotated[int, Field(ge=0, le=MOVERS_MAX)] = 0
    """How many, drawn by the seed; fewer where the way leaves no room for their tracks."""


class GeneratedWorld(WithMovers):
    """A world drawn from a family and the seed."""

    family: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
    """Family of worlds: `indoor`, `rooms`, `garage`, `forest` or `hall`."""
    size_m: (
        tuple[Annotated[float, Field(ge=2.0, le=200.0)], Annotated[float, Field(ge=2.0, le=200.0)]] | None
    ) = None
    """Extent in x and y [m]; the world is centred on (0, 0). By default the family's own size."""
    difficulty: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """From 0, easy, to 1, hard; 0.5 if left out. The `hall` has none."""
    clear: bool = True
    """Leave out furnishings at the start and the goals; without, the world is as its seed draws it."""

    def spec(self) -> dict[str, object]:
        """What `sim.worlds` builds it from."""
        known: dict[str, object] = {"family": self.family, "size_m": self.size_m and list(self.size_m)}
        known["difficulty"] = self.difficulty
        return {name: value for name, value in known.items() if value is not None}


def _stays_below(file: str) -> str:
    if file.startswith(("/", "~")) or "\\" in file or ":" in file or ".." in re.split("/", file):
        raise PydanticCustomError(
            "mesh_path",
            "the file must lie below the worlds folder",
            {"hint": "name the folder with --worlds DIR"},
        )
    return file


BelowFolder = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_stays_below)]


class MeshWorld(WithMovers):
    """A world read from a file of triangles."""

    mesh: BelowFolder
    """File below the worlds folder (`--worlds DIR`): .glb .obj .ply .stl .dae, or .npz with V and F."""
    scale: Annotated[float, Field(gt=0.0, le=1000.0)] = 1.0
    """Metres per unit of the file."""
    up: Literal["x", "y", "z"] = "z"
    """The file's axis that points up."""

    def spec(self) -> dict[str, object]:
        """What `sim.worlds` builds it from."""
        return {"mesh": self.mesh, "scale": self.scale, "up": self.up}


class DescribedWorld(WithMovers):
    """A mesh with its bounds, start and goals, described by a world file."""

    file: Annotated[BelowFolder, Field(pattern=r"\.ya?ml$")]
    """World file (.yaml) below the worlds folder (`--worlds DIR`), or one of those that come with the
    simulator, for example `workshop.yaml`."""

    def spec(self) -> dict[str, object]:
        """What `sim.worlds` builds it from."""
        return {"file": self.file}


_WORLD_KINDS = {"family": "GeneratedWorld", "mesh": "MeshWorld", "file": "DescribedWorld"}


def _world_kind(value: Any) -> str | None:
    if isinstance(value, Section):
        return type(value).__name__
    kinds = [kind for key, kind in _WORLD_KINDS.items() if isinstance(value, dict) and key in value]
    return kinds[0] if len(kinds) == 1 else None


World = Annotated[
    Annotated[GeneratedWorld, Tag("GeneratedWorld")]
    | Annotated[MeshWorld, Tag("MeshWorld")]
    | Annotated[DescribedWorld, Tag("DescribedWorld")],
    Discriminator(_world_kind),
]


class Start(Section):
    """Where the robot stands at first."""

    x: Coordinate = 0.0
    y: Coordinate = 0.0
    z: Coordinate = 0.0
    """Height of the floor there [m]; goals count from it."""
    yaw_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 0.0
    """Heading, counter-clockwise from x [deg]."""


class Sim(Section):
    """The simulated world. A real robot flies the mission without looking at this block."""

    world: World
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 1
    """Seed of the world and of all noise; `--seed` wins over it."""
    start: Start = Start()
    disturbances: Disturbances | None = None
    """What disturbs the robot; by default what is usual in such a world."""


class Expect(Section):
    """What a run must show; a miss is exit code 4. Only what is given is looked at."""

    outcome: Literal["success", "refused", "aborted", "failsafe", "failed"] = "success"
    """How the mission ends."""
    contacts: Annotated[int, Field(ge=0)] | None = None
    """The most contacts with obstacles."""
    min_land_m: Annotated[float, Field(ge=0.0)] | None = None
    """The least distance driven [m]."""
    min_air_m: Annotated[float, Field(ge=0.0)] | None = None
    """The least distance flown [m]."""
    max_goal_error_m: Annotated[float, Field(gt=0.0)] | None = None
    """The largest distance of the true pose from a goal when it counted as reached [m]."""


class Mission(Section):
    """A land-air mission: places, what to do in turn, and what holds throughout."""

    model_config = ConfigDict(title="LABR mission")

    version: Literal[1]
    """Version of this format."""
    name: Annotated[str, Field(min_length=1, max_length=80)]
    """What the run is called in logs and folders."""
    notes: Annotated[str, Field(max_length=10_000)] = ""
    """Free text."""
    places: dict[PlaceName, Point] = Field(default={})
    """Named points."""
    items: Annotated[list[Item], Field(min_length=1, max_length=500)]
    """What to do, in turn."""
    limits: Limits = Limits()
    fence: list[Fence] = Field(default=[], max_length=100)
    """Regions to stay inside or outside of."""
    energy: EnergyPolicy = EnergyPolicy()
    sim: Sim | None = None
    expect: Expect | None = None

    def target(self, item: Goto) -> Point:
        """The point a `goto` means."""
        return item.goto if isinstance(item.goto, Point) else self.places[item.goto]


def json_schema() -> dict[str, Any]:
    """JSON Schema of the mission file (draft 2020-12)."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **Mission.model_json_schema(by_alias=True),
    }
