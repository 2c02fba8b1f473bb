"""Measured power, phases and motion of a recorded flight, at the same instants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from labr_autonomy.errors import BadInput
from labr_autonomy.modes.energy_fit import SAMPLES_MIN, Samples
from labr_autonomy.modes.transition import Phase
from labr_autonomy.record.mcap_reader import read_log
from labr_autonomy.types import Array

LOG = "flight.mcap"
_PHASES = {phase.value: phase for phase in Phase}


@dataclass(frozen=True, slots=True)
class PowerLog:
    """What a flight's log says of the battery."""

    samples: Samples
    channel: str  # "ground" or "air": whose measurement is used
    other_over_used: float | None  # energy by the other channel over that by the used one; None without it


def read_power(run_dir: Path, track_m: float) -> PowerLog:
    """Read a run's battery telemetry with the modes and the motion.

    Both channels measure the same pack; the ground channel's word is taken, the air channel's where that has
    none.

    Args:
        run_dir: A run folder.
        track_m: Distance of the wheels, for their speed in a turn.

    Raises:
        BadInput: where there is no log, or no telemetry of battery, modes or motion in it.
    """
    path = run_dir / LOG
    if not path.is_file():
        raise BadInput(f"{run_dir} holds no {LOG}", "Name the folder of a run that was flown")
    wanted: dict[str, list[dict[str, Any]]] = {"/battery": [], "/mode": [], "/odometry": []}
    for topic, message in read_log(path):
        if topic in wanted and isinstance(message.get("stamp_s"), (int, float)):
            wanted[topic].append(message)
    battery, modes, odometry = wanted.values()
    stamps = _column(battery, "stamp_s")
    ground_w = _measured(battery, "voltage_v", "power_w")
    air_w = _measured(battery, "air_voltage_v", "air_power_w")
    use_air = np.isfinite(ground_w).sum() < SAMPLES_MIN
    power_w, other_w = (air_w, ground_w) if use_air else (ground_w, air_w)
    if np.isfinite(power_w).sum() < SAMPLES_MIN:
        raise BadInput(
            f"{path} holds no battery telemetry: neither channel reported voltage and current",
            "Connect a power module to the autopilot or the land controller and fly again",
        )
    if len(odometry) < 2 or not modes:
        raise BadInput(f"{path} holds no motion or no modes beside the battery", "Name another run")
    both = np.isfinite(power_w) & np.isfinite(other_w)
    ratio = float(other_w[both].sum() / power_w[both].sum()) if both.sum() >= SAMPLES_MIN else None
    kept = np.isfinite(power_w) & (np.diff(stamps, prepend=-np.inf) > 0.0)
    samples = _samples(stamps[kept], power_w[kept], modes, odometry, track_m)
    return PowerLog(samples, "air" if use_air else "ground", ratio)


def _column(messages: Sequence[dict[str, Any]], name: str) -> Array:
    """A figure of each message, nan where it is unknown, (n,)."""
    return np.array([v if (v := m.get(name)) is not None else np.nan for m in messages], dtype=np.float64)


def _measured(battery: Sequence[dict[str, Any]], voltage: str, power: str) -> Array:
    """Power of one channel [W], nan where it has not reported: its voltage is then unknown or zero."""
    volts, watts = _column(battery, voltage), _column(battery, power)
    return np.where(volts > 0.0, watts, np.nan)


def _samples(
    stamps_s: Array,
    power_w: Array,
    modes: Sequence[dict[str, Any]],
    odometry: Sequence[dict[str, Any]],
    track_m: float,
) -> Samples:
    at = _column(odometry, "stamp_s")
    place = np.array([m["position_m"] for m in odometry], dtype=np.float64)
    velocity = np.array([m["velocity_mps"] for m in odometry], dtype=np.float64)
    turn = np.array([m["angular_velocity_rps"][2] for m in odometry], dtype=np.float64)
    wheels = np.maximum(np.hypot(velocity[:, 0], velocity[:, 1]), 0.5 * track_m * np.abs(turn))
    began_s = np.array([float(m["stamp_s"]) for m in modes])
    words = [_PHASES.get(str(m.get("phase"))) for m in modes]
    index = np.searchsorted(began_s, stamps_s, side="right") - 1
    return Samples(
        stamps_s,
        power_w,
        tuple(words[i] if i >= 0 else None for i in index),
        np.interp(stamps_s, at, wheels),
        np.interp(stamps_s, at, velocity[:, 2]),
        np.interp(stamps_s, at, place[:, 2]),
    )
