"""A run folder as a flight would leave it, made without flying: a drive, a hop, a drive home."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from labr_autonomy.config import Camera
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.record.flight_log import FlightLog
from labr_autonomy.record.summary import Leg, Summary, percentiles, write_summary
from labr_autonomy.types import (
    DepthFrame,
    Intrinsics,
    KeyPoints,
    Mode,
    Odometry,
    Pose,
    SetPoint,
    Source,
    Trajectory,
)

T0_S = 1000.0
LENGTH_S = 60.0


def position(t: float) -> np.ndarray:
    """Out along a bend, up at 20 s, down at 40 s, on in a bend."""
    height = 0.12 + 1.4 * np.clip((t - 20) / 3, 0, 1) * np.clip((42 - t) / 3, 0, 1)
    return np.array([-5.5 + 0.17 * t, -3 + 2.2 * math.sin(t / 14), height])


def flying(t: float) -> bool:
    return 20 <= t < 42


def pose(t: float) -> Pose:
    ahead = position(t + 0.1) - position(t)
    return Pose(position(t), quaternion_from_rpy(0.0, 0.0, math.atan2(ahead[1], ahead[0])))


def frame(sequence: int, stamp_s: float) -> DepthFrame:
    """A floor, a far wall and a box in a small image."""
    k = Camera().intrinsics
    k = Intrinsics(k.width // 2, k.height // 2, k.fx / 2, k.fy / 2, k.cx / 2, k.cy / 2)
    v = np.arange(k.height)[:, None] + np.zeros((1, k.width))
    with np.errstate(divide="ignore"):
        floor = np.where(v > k.cy, 0.18 * k.fy / (v - k.cy), np.inf)
    depth = np.minimum(floor, 7.0).astype(np.float32)
    depth[40:75, 120:160] = 2.4
    depth[:, :6] = 0.0
    return DepthFrame(sequence, stamp_s, depth, k)


def key_points(t: float, mu: float) -> KeyPoints:
    points = np.array([position(t + s) for s in (1.5, 3, 5, 7, 9)])
    air = np.array([flying(t + s) for s in (1.5, 3, 5, 7, 9)])
    points[~air, 2] = 0.0
    return KeyPoints(points, air, mu, Source.GKPN)


def trajectory(t: float) -> Trajectory:
    grid = np.arange(0, 3.05, 0.1)
    points = np.array([position(t + s) for s in grid])
    zero = np.zeros_like(points)
    flat = np.zeros(len(grid))
    mode = Mode.AIR if flying(t) else Mode.LAND
    return Trajectory(mode, T0_S + t, 0.1, points, zero, zero, flat, flat, flat)


FACTS = {
    "mission": "synthetic",
    "run": "run",
    "camera": {"fx": 106.0, "fy": 106.0, "cx": 106.0, "cy": 60.0, "x_m": 0.14, "z_m": 0.06},
    "fences": [],
}


def console_state(t: float) -> dict:
    phase = "flying" if flying(t) else "driving"
    here, q = position(t).tolist(), pose(t).quaternion.tolist()
    return {
        "stamp_s": T0_S + t,
        "mode": "AIR" if flying(t) else "LAND",
        "phase": phase,
        "pose": {"position_m": here, "quaternion": q, "yaw_rad": 0.0},
    }


def write_log(path: Path, *, length_s: float = LENGTH_S, rate_hz: float = 10.0, frames: int = 8) -> None:
    with FlightLog(path, metadata={"mission": "synthetic"}) as log:
        log.facts(T0_S, FACTS)
        log.pilot(T0_S, lambda: {"call": "begin", "now_s": T0_S})
        log.event(T0_S, "mission begins")
        log.mode(T0_S, "land", "driving")
        log.mode(T0_S + 20, "air", "taking off", "goal is in the air")
        log.mode(T0_S + 42, "land", "driving", "settled")
        log.event(T0_S + 31, "pose corrected", level="warning", metres=0.12)
        for i in range(int(length_s * rate_hz)):
            t = i / rate_hz
            log.odometry(
                Odometry(
                    T0_S + t,
                    Pose(position(t) + 0.03, pose(t).quaternion),
                    np.zeros(3),
                    np.zeros(3),
                    np.eye(6) * 1e-4,
                )
            )
            mode = Mode.AIR if flying(t) else Mode.LAND
            log.setpoint(SetPoint(T0_S + t, mode, position(t), np.zeros(3), np.zeros(3), 0.0, 0.0, 0.5))
            if i % 10 == 0:
                log.console(T0_S + t, console_state(t))
                log.map(T0_S + t, np.array([[1.0 + t / 100, 2.0]]), 0.0)
            if i % 5 == 0:
                log.link_ages(T0_S + t, {"air": 0.01, "ground": math.inf})
                air_s = float(np.clip(t - 23, 0, 16))
                lift_s = float(np.clip(t - 20, 0, 3) + np.clip(t - 39, 0, 3))
                log.battery(
                    T0_S + t,
                    voltage_v=20.1,
                    power_w=84.0,
                    energy_land_j=84 * (t - air_s - lift_s),
                    energy_air_j=590 * air_s,
                    energy_transition_j=500 * lift_s,
                )
        for i in range(frames):
            t = i * length_s / frames
            log.depth(frame(i, T0_S + t), pose(t), Camera())
            mu = 0.12 if i != 2 else 0.81
            log.plan(
                T0_S + t + 0.05,
                frame_stamp_s=T0_S + t,
                network=key_points(t, mu),
                followed=None,
                trajectory=trajectory(t),
                source=Source.GKPN if mu < 0.5 else Source.SEARCH,
                clearance_m=0.4,
                timings_s={"total_s": 0.03},
            )


def summary() -> Summary:
    loop = percentiles(np.linspace(0.2, 4.0, 500))
    return Summary(
        outcome="success",
        reason="all 3 items are done",
        duration_s=LENGTH_S,
        land_m=9.4,
        air_m=4.8,
        energy_land_j=3200.0,
        energy_air_j=9440.0,
        energy_transition_j=3000.0,
        contacts=0,
        min_clearance_m=0.31,
        goal_errors_m=[0.21, 0.18, 0.3],
        tick_late_ms=loop,
        plan_cycle_ms=percentiles([35.0, 41.0, 60.0]),
        setpoint_age_ms=percentiles([70.0, 90.0, 140.0]),
        seed=1,
        mission="first flight",
        start_m=(-5.5, -3.0, 0.12),
        extra={"leg_ends_mono_s": [T0_S + 19, T0_S + 38, T0_S + 60]},
        legs=[
            Leg(0, "goto far_corner", "done", 0.0, 19.0, (-2.3, -0.8), 4.1, 0.0, 1596.0, 0.21),
            Leg(1, "goto lookout", "done", 19.0, 19.0, (1.0, -2.1, 1.5), 0.3, 4.2, 11000.0, 0.18),
            Leg(2, "return", "failed", 41.0, 19.0, (4.7, -5.0), 3.0, 0.0, 1600.0, None),
        ],
    )


@pytest.fixture(scope="session")
def whole_run(tmp_path_factory) -> Path:
    run = tmp_path_factory.mktemp("runs") / "20261122-120000-first-flight"
    run.mkdir()
    write_log(run / "flight.mcap")
    write_summary(summary(), run)
    t = np.arange(0, LENGTH_S, 0.1)
    np.savez(
        run / "truth.npz",
        stamp_s=T0_S + t,
        position_m=np.array([position(s) for s in t]),
        quaternion=np.tile([1.0, 0, 0, 0], (len(t), 1)),
        mode=np.array(["air" if flying(s) else "land" for s in t]),
    )
    late = np.random.default_rng(2).gamma(2.0, 0.01, 500)
    np.savez(run / "latencies.npz", tick_late_s=late / 20, plan_cycle_s=late * 3, setpoint_age_s=late * 5)
    rng = np.random.default_rng(1)
    boxes = np.round(rng.uniform([-6, -4.5], [6, 4.5], (14, 2)), 1)
    side = np.linspace(-0.4, 0.4, 9)  # 0.1 m cells, as of the map
    cells = (boxes[:, None] + np.array([(a, b) for a in side for b in side])[None]).reshape(-1, 2)
    np.savez(run / "map.npz", occupied_xy=cells)
    return run
