"""One trial: drive, stop, lift off, fly a little, land and drive on, judged by the truth."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import roll_pitch_of
from labr_autonomy.mission.pilot_io import Actions
from labr_autonomy.mission.steps import Kind, Policy, Step
from labr_autonomy.modes.transition import Phase
from labr_autonomy.types import Array
from sim.bench.transitions.open_ground import OpenGround, sloping_ground
from sim.camera.process import Eye
from sim.camera.renderer import make_renderer
from sim.disturbances import Disturbances, Pack, Wind
from sim.lockstep.flight import LockstepFlight
from sim.lockstep.planner import Planner
from sim.plant import LOADED_N, Plant
from sim.vio import VioStandIn
from sim.worlds.surface import Surface

SLOPE_MAX_RAD = math.radians(5.0)
MEAN_MAX_MPS, GUST_MPS = 1.0, (0.2, 0.8)  # from drafts indoors to wind under trees, `sim.disturbances`
CHARGE = (0.3, 1.0)
DRIVE_M = (1.5, 3.0)
FLY_M = (0.8, 1.6)
HEIGHT_M = (0.8, 1.5)  # of the body above its driving height
STEP_LIMIT_S = 40.0
LIMIT_S = 120.0
NEAR_M = 0.05  # the last part of a descent, in which the speed of touching down is looked for
TILT_MAX_RAD = math.radians(15.0)  # rotors off at more would be off on something that is no floor
_STREAM = 0x7A


@dataclass(frozen=True, slots=True)
class Conditions:
    """What a seed draws."""

    seed: int
    slope_deg: float
    uphill_deg: float  # the way the floor rises, from east
    heading_deg: float  # of the robot
    mean_mps: float
    gust_mps: float
    charge: float
    drive_m: float
    fly_m: float
    height_m: float


@dataclass(frozen=True, slots=True)
class Hop:
    """How a trial went. Figures are null where it did not get that far."""

    conditions: Conditions
    done: bool
    reason: str  # "" when it is done
    stop_error_m: float | None  # from where it was to stop to where it stood when the rotors began to turn
    landing_error_m: float | None  # from below where it was to hover to where it stood afterwards
    touchdown_mps: float | None
    tilt_deg: float | None  # of the body when the wheels touched
    time_s: float
    events: list[tuple[float, str]] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return asdict(self)


def draw(seed: int) -> Conditions:
    """The conditions of a seed."""
    rng = np.random.default_rng([seed, _STREAM])
    slope, mean, gust, charge, drive, fly, height = rng.random(7)
    uphill, heading = rng.uniform(-180.0, 180.0, 2)

    def between(share: float, low: float, high: float) -> float:
        return float(low + share * (high - low))

    return Conditions(
        seed=seed,
        slope_deg=math.degrees(SLOPE_MAX_RAD) * float(slope),
        uphill_deg=float(uphill),
        heading_deg=float(heading),
        mean_mps=MEAN_MAX_MPS * float(mean),
        gust_mps=between(gust, *GUST_MPS),
        charge=between(charge, *CHARGE),
        drive_m=between(drive, *DRIVE_M),
        fly_m=between(fly, *FLY_M),
        height_m=between(height, *HEIGHT_M),
    )


def rises(c: Conditions) -> tuple[float, float]:
    """Rise of the floor per metre east and north."""
    rise, uphill = math.tan(math.radians(c.slope_deg)), math.radians(c.uphill_deg)
    return rise * math.cos(uphill), rise * math.sin(uphill)


def mission(c: Conditions, robot: RobotConfig) -> list[Step]:
    """Drive, hover some way on, land, drive on: all straight ahead from the origin."""
    heading = math.radians(c.heading_deg)
    ahead = np.array([math.cos(heading), math.sin(heading)])
    slope = np.array(rises(c))

    def place(way_m: float, height_m: float = 0.0) -> Array:
        xy = way_m * ahead
        return np.append(xy, float(xy @ slope) + robot.body.below_m + height_m)

    stop, over, end = c.drive_m, c.drive_m + c.fly_m, 2.0 * c.drive_m + c.fly_m
    return [
        Step(Kind.GOTO, "stop", place(stop), policy=Policy.GROUND, timeout_s=STEP_LIMIT_S),
        Step(Kind.GOTO, "hover", place(over, c.height_m), True, Policy.AIR, timeout_s=STEP_LIMIT_S),
        Step(Kind.LAND, "land", timeout_s=STEP_LIMIT_S),
        Step(Kind.GOTO, "on", place(end), policy=Policy.GROUND, timeout_s=STEP_LIMIT_S),
    ]


class Measure:
    """Watches the truth of one trial.

    Args:
        plant: The physics.
        steps: Of the mission, as `mission` makes them.
    """

    def __init__(self, plant: Plant, steps: list[Step]) -> None:
        self._plant = plant
        self._stop_m, self._over_m = (np.asarray(step.goal_m)[:2] for step in steps[:2])
        self._phase = Phase.DRIVING
        self._airborne = False
        self._sinking_mps = 0.0
        self.stop_error_m: float | None = None
        self.landing_error_m: float | None = None
        self.touchdown_mps: float | None = None
        self.tilt_rad: float | None = None
        self.fault = ""

    def step(self, now_s: float) -> None:
        """After each step of the physics."""
        plant = self._plant
        s = plant.state
        if plant.height_m > NEAR_M:
            self._airborne, self._sinking_mps = True, 0.0
        elif self._airborne:
            self._sinking_mps = max(self._sinking_mps, -float(s.velocity_mps[2]))
            if s.on_wheels or float(s.wheel_load_n.sum()) > LOADED_N:
                self._airborne = False
                self.touchdown_mps = max(self.touchdown_mps or 0.0, self._sinking_mps)
                roll, pitch = roll_pitch_of(s.quaternion)
                self.tilt_rad = max(self.tilt_rad or 0.0, math.hypot(roll, pitch))

    def tick(self, now_s: float, actions: Actions) -> None:
        """After each tick of the flight."""
        there = self._plant.state.position_m[:2]
        if actions.phase is not self._phase:
            if actions.phase is Phase.ARMING and self.stop_error_m is None:
                self.stop_error_m = float(np.linalg.norm(there - self._stop_m))
            if actions.phase is Phase.DRIVING and self._phase in (Phase.DISARMING, Phase.SETTLING):
                self.landing_error_m = float(np.linalg.norm(there - self._over_m))
            if actions.phase is Phase.DRIVING and self._plant.height_m > NEAR_M:
                self.fault = f"the rotors were taken for off {self._plant.height_m:.2f} m above the floor"
            self._phase = actions.phase


def fly(seed: int, record: Callable[[LockstepFlight], None] | None = None, *, whole: bool = False) -> Hop:
    """Fly the trial of a seed; the answer follows from the seed alone.

    Args:
        seed: Of conditions and noise.
        record: Is given the flight before it begins, to listen to it.
        whole: Fly with camera, map and network as well, by the flight's own planner.
    """
    c, robot = draw(seed), RobotConfig()
    usual = Disturbances()
    disturbed = replace(
        usual, wind=Wind(mean_mps=c.mean_mps, gust_mps=c.gust_mps), battery=Pack(charge=c.charge)
    )
    surface = sloping_ground(*rises(c), robot.body)
    plant = Plant(robot, surface, (0.0, 0.0, math.radians(c.heading_deg), 0.0), seed, disturbed)
    steps = mission(c, robot)
    measure = Measure(plant, steps)
    with _looking(robot, surface, seed, whole=whole) as (eye, planner):
        flight = LockstepFlight(robot, plant, VioStandIn(seed, usual.vio), eye, planner, steps, seed)
        flight.on_step, flight.on_tick = measure.step, measure.tick
        if record is not None:
            record(flight)
        outcome, why = flight.run(LIMIT_S)
    return Hop(
        conditions=c,
        done=outcome == "reached" and not _fault(measure),
        reason=_fault(measure) or ("" if outcome == "reached" else why),
        stop_error_m=measure.stop_error_m,
        landing_error_m=measure.landing_error_m,
        touchdown_mps=measure.touchdown_mps,
        tilt_deg=None if measure.tilt_rad is None else math.degrees(measure.tilt_rad),
        time_s=flight.time_s,
        events=flight.record.events,
    )


@contextlib.contextmanager
def _looking(
    robot: RobotConfig, surface: Surface, seed: int, *, whole: bool
) -> Iterator[tuple[Eye | None, Planner]]:
    """The camera, if any, and the planner of a trial."""
    if not whole:
        yield None, OpenGround(robot)
        return
    from labr_autonomy.planner.pipeline import Pipeline

    camera = robot.camera
    with contextlib.closing(make_renderer(surface.world, camera.intrinsics, camera.range_max_m)) as renderer:
        yield Eye(renderer, camera, seed=seed), Pipeline(robot)


def _fault(measure: Measure) -> str:
    """What makes a mission that was carried out a failure all the same."""
    if measure.fault:
        return measure.fault
    if measure.tilt_rad is not None and measure.tilt_rad > TILT_MAX_RAD:
        return f"it touched down tilted by {math.degrees(measure.tilt_rad):.0f} degrees"
    return "" if measure.landing_error_m is not None else "it never stood again"
