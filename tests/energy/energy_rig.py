"""Recorded flights of a robot whose powers are known, with noise that lasts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.record.flight_log import FlightLog
from labr_autonomy.types import Odometry, Pose

T0_S = 500.0
DT_S = 0.1
MASS_KG = 3.4
LIFT_J_PER_M = MASS_KG * 9.80665 / 0.5


@dataclass(frozen=True)
class Truth:
    idle_w: float = 17.0
    fixed_w: float = 30.0
    per_mps_w: float = 70.0
    hover_w: float = 640.0
    climb_w_per_mps: float = 60.0
    take_off_j: float = 2100.0
    landing_j: float = 1900.0

    def land_w(self, speed_mps):
        return self.idle_w + self.fixed_w + self.per_mps_w * speed_mps


# phase, seconds; a hop between two drives
HOP = (("driving", 14.0), ("stopping", 1.5), ("arming", 1.5), ("lifting", 3.0), ("flying", 8.0),
       ("descending", 3.0), ("settling", 0.6), ("disarming", 0.9), ("driving", 8.0))  # fmt: skip
UP = {"arming": 0.3, "lifting": 0.7}  # shares of a take-off's joules
DOWN = {"descending": 0.85, "settling": 0.1, "disarming": 0.05}


def profile(hops=2):
    """Rows of t, phase, speed, climb, height."""
    rows, t, z, driven_s = [], 0.0, 0.12, 0.0
    for phase, seconds in HOP * hops:
        for _ in range(round(seconds / DT_S)):
            speed = climb = 0.0
            if phase == "driving":
                driven_s += DT_S
                beat = driven_s % 6.0
                speed = 0.0 if beat < 1.5 else 0.35 + 0.5 * abs(math.sin(driven_s / 3.0))
            elif phase == "lifting":
                climb = 0.4
            elif phase == "descending":
                climb = -0.4
            elif phase == "flying":
                climb = 0.2 * math.sin(t)
            rows.append((t, phase, speed, climb, z))
            z = z + climb * DT_S if phase != "settling" else 0.12
            t += DT_S
    return rows


def write_flight(folder, truth=None, *, seed=0, noise_w=6.0, hops=2, ground=True, air=True, air_gain=1.0):
    """A run folder with a flight.mcap."""
    truth, rng = truth or Truth(), np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    rows = profile(hops)
    lasting, last_phase, last_speed = 0.0, "", 0.0
    lengths = dict(HOP)
    scatter = {}
    with FlightLog(folder / "flight.mcap", metadata={"mission": "known"}) as log:
        for t, phase, speed, climb, z in rows:
            if phase != last_phase:
                log.mode(T0_S + t, "air" if phase == "flying" else "land", phase, "")
                scatter[phase] = 1.0 + 0.02 * rng.normal()
            gain = max(speed * (speed - last_speed) / DT_S, 0.0) if last_phase == phase else 0.0
            lasting = 0.8 * lasting + 0.6 * rng.normal()
            if phase in ("driving", "stopping"):
                watts = truth.land_w(speed) + 3.0 * gain if speed > 0.0 else truth.idle_w
                watts += 0.3 * noise_w * lasting
            elif phase == "flying":
                watts = truth.hover_w + truth.climb_w_per_mps * max(climb, 0.0) + noise_w * lasting
            else:
                share, joules = (UP, truth.take_off_j) if phase in UP else (DOWN, truth.landing_j)
                watts = scatter[phase] * share[phase] * joules / lengths[phase] + LIFT_J_PER_M * max(
                    climb, 0.0
                )
            last_phase, last_speed = phase, speed
            at = Pose(np.array([0.0, 0.0, z]), quaternion_from_rpy(0, 0, 0))
            velocity = np.array([speed, 0.0, climb])
            log.odometry(Odometry(T0_S + t, at, velocity, np.zeros(3), np.eye(6) * 1e-4))
            told = {"voltage_v": 19.0, "power_w": watts} if ground else {"voltage_v": 0.0, "power_w": 0.0}
            if air:
                told |= {"air_voltage_v": 19.0, "air_power_w": air_gain * watts}
            log.battery(T0_S + t, energy_land_j=0.0, energy_air_j=0.0, energy_transition_j=0.0, **told)
    return folder
