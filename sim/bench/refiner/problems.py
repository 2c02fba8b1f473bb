"""Chains of random problems: each begins where the last trajectory led, in a scene that may have changed."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.refine.planner import Refiner
from labr_autonomy.refine.values import AirState, LandState, RefineResult
from labr_autonomy.types import Array, Mode, SetPoint, Trajectory
from sim.bench.refiner.judge import faults
from sim.bench.refiner.scenes import HEIGHT_M, SIDE_M, Scene, draw

CHAIN = 10  # problems of one scene
POP_UP, NEW_GOAL, WILD = 0.15, 0.3, 0.1  # shares: a thing appears; another goal; key points like no planner's
STRAY_M = 0.08  # of key points, one sigma
NOISE_M, NOISE_RAD = 0.004, 0.005  # of the robot about its trajectory, one sigma
DRAWS = 200


@dataclass
class Tally:
    """What a chain, or many, came to."""

    problems: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    sources: Counter[str] = field(default_factory=Counter)
    bad: list[tuple[int, int, str]] = field(default_factory=list)  # seed, number in the chain, what
    took_ms: list[float] = field(default_factory=list)

    def add(self, other: Tally) -> None:
        """Count another one in."""
        self.problems += other.problems
        self.faults += other.faults
        self.sources += other.sources
        self.bad += other.bad
        self.took_ms += other.took_ms


_refiners: dict[str, Refiner] = {}


def chain(job: tuple[str, int]) -> tuple[str, Tally]:
    """One chain of a mode ("land" or "air") and a seed."""
    mode, seed = job
    config = RobotConfig()
    refiner = _refiners.setdefault("one", Refiner(config))
    rng = np.random.default_rng([seed, 2 if mode == "land" else 3])
    d, hard_m = (2, refiner.land_hard_m) if mode == "land" else (3, refiner.air_hard_m)
    tally, clock = Tally(), SystemClock()
    scene = draw(rng, d)
    begin = _free_place(rng, scene, hard_m)
    if begin is None:
        return mode, tally
    now_s, yaw = 0.0, float(rng.uniform(-np.pi, np.pi))
    motion: SetPoint | None = None
    previous: Trajectory | None = None
    points = _key_points(rng, begin)
    for k in range(CHAIN):
        if motion is not None and rng.random() < POP_UP:
            scene = _changed(rng, scene, motion, refiner, now_s, hard_m)
        here = begin if motion is None else motion.position_m[:d]
        if rng.random() < NEW_GOAL:
            points = _key_points(rng, here)
        began_s = clock.now_s()
        result = _ask(refiner, scene, motion, begin, yaw, points, now_s, previous)
        tally.took_ms.append(1e3 * (clock.now_s() - began_s))
        tally.problems += 1
        tally.sources[result.source.value] += 1
        for what in faults(result.trajectory, scene, config, hard_m):
            tally.faults[what] += 1
            tally.bad.append((seed, k, what))
        previous = result.trajectory
        now_s += float(rng.uniform(0.05, 0.4))
        motion = _strayed(rng, previous.sample(now_s), d)
    return mode, tally


def _ask(
    refiner: Refiner,
    scene: Scene,
    motion: SetPoint | None,
    begin: Array,
    yaw: float,
    points: Array,
    now_s: float,
    previous: Trajectory | None,
) -> RefineResult:
    if scene.dimensions == 2:
        land = LandState(begin, yaw, 0.0, 0.0)
        if motion is not None:
            land = LandState(motion.position_m[:2], motion.yaw_rad, motion.speed_mps, motion.yaw_rate_rps)
        return refiner.land(land, points, scene.field, now_s, previous)
    air = AirState(begin, np.zeros(3), np.zeros(3), yaw)
    if motion is not None:
        air = AirState(motion.position_m, motion.velocity_mps, motion.acceleration_mps2, motion.yaw_rad)
    return refiner.air(air, points, scene.field, now_s, previous)


def _free_place(rng: np.random.Generator, scene: Scene, hard_m: float) -> Array | None:
    low, high = np.full(2, 0.5), np.full(2, SIDE_M - 0.5)
    if scene.dimensions == 3:
        low, high = np.append(low, 0.5), np.append(high, HEIGHT_M - 0.6)
    for place in rng.uniform(low, high, (DRAWS, scene.dimensions)):
        if scene.field.lookup(place[None])[0] > hard_m + 0.02:
            out: Array = place
            return out
    return None


def _key_points(rng: np.random.Generator, here: Array) -> Array:
    """Five points towards a goal somewhere, as a network might say; now and then as none would."""
    goal = rng.uniform(0.0, SIDE_M, len(here))
    if len(here) == 3:
        goal[2] = rng.uniform(0.3, HEIGHT_M - 0.5)
    line = here + (goal - here) * np.linspace(0.2, 1.0, 5)[:, None]
    wild = rng.random() < WILD
    out: Array = line + rng.normal(0.0, 1.5 if wild else STRAY_M, line.shape)
    return out


def _changed(
    rng: np.random.Generator, scene: Scene, motion: SetPoint, refiner: Refiner, now_s: float, hard_m: float
) -> Scene:
    """A thing appears somewhere ahead, as near as leaves the robot room to brake."""
    d = scene.dimensions
    ahead = rng.normal(0.0, 1.2, d)
    if d == 3:
        ahead[2] *= 0.3
    fresh = scene.with_box(motion.position_m[:d] + ahead)
    if d == 2:
        state = LandState(motion.position_m[:2], motion.yaw_rad, motion.speed_mps, motion.yaw_rate_rps)
        stop = refiner.brake_land(state, now_s)
    else:
        stop = refiner.brake_air(
            AirState(motion.position_m, motion.velocity_mps, motion.acceleration_mps2, motion.yaw_rad), now_s
        )
    room = float(fresh.field.lookup(stop.position_m[:, :d]).min())
    return fresh if room > hard_m + 0.02 else scene


def _strayed(rng: np.random.Generator, motion: SetPoint, d: int) -> SetPoint:
    """The robot is never quite where its trajectory is."""
    noise = np.zeros(3)
    noise[:d] = rng.normal(0.0, NOISE_M, d)
    return SetPoint(
        motion.stamp_s,
        Mode.LAND if d == 2 else Mode.AIR,
        motion.position_m + noise,
        motion.velocity_mps,
        motion.acceleration_mps2,
        motion.yaw_rad + float(rng.normal(0.0, NOISE_RAD)),
        motion.yaw_rate_rps,
        motion.speed_mps,
    )
