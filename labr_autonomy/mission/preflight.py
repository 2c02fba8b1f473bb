"""Every check before a start, each with its figure and its remedy. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from labr_autonomy.air.telemetry import AirState
from labr_autonomy.config import RobotConfig
from labr_autonomy.ground.state import GroundState
from labr_autonomy.mission.operator import LINK_LATE_S

BATTERY_MIN_V = 16.0  # 5 cells at 3.2 V: below it the pack is empty, or it is another pack
SIGMA_MAX_M = 0.3  # a pose less certain than the robot's own radius is none to drive by

_FIX = {
    "vio": "start the VIO and look at its output",
    "depth": "start the camera driver and look at its cable",
    "air": "look at the autopilot's cable and power",
    "stm32": "look at the land controller's cable, or press its reset",
    "plan": "wait a moment; restart the mission if it stays",
}
_NAME = {
    "vio": "pose from VIO",
    "depth": "depth image",
    "air": "autopilot",
    "stm32": "land controller",
    "plan": "planner",
}


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the list."""

    name: str
    passed: bool
    figure: str  # what was found, with its limit
    fix: str  # what to do; "" when it is passed


def preflight(
    config: RobotConfig,
    *,
    ages_s: Mapping[str, float],
    ground: GroundState,
    air: AirState,
    sigma_m: float,
    energy_left_j: float,
    energy_needed_j: float,
    logs_ok: bool,
) -> list[Check]:
    """All checks, failed or not.

    Args:
        config: The robot.
        ages_s: Age of each link's last datum [s].
        ground: The land controller's word.
        air: The autopilot's word.
        sigma_m: Standard deviation of the position estimate [m].
        energy_left_j: In the pack, above the reserve [J]; nan when it is not known.
        energy_needed_j: What the mission takes at least [J].
        logs_ok: Whether every log is being written.
    """
    checks = [
        _check(
            _NAME[name],
            age_s <= LINK_LATE_S[name],
            f"{_age(age_s)} old (limit {LINK_LATE_S[name]:g} s)",
            _FIX[name],
        )
        for name, age_s in ages_s.items()
        if name in _NAME
    ]
    left = air.battery_remaining
    reserve = config.energy.reserve
    has = f"{energy_left_j / 1e3:.1f} kJ" if math.isfinite(energy_left_j) else "an unknown charge"
    checks += [
        _check(
            "position",
            sigma_m <= SIGMA_MAX_M,
            f"known to {sigma_m:.2f} m (limit {SIGMA_MAX_M} m)",
            "look at more texture, or restart the VIO",
        ),
        _check(
            "battery",
            left is not None and left > reserve,
            "not reported" if left is None else f"{left * 100:.0f} % (reserve {reserve * 100:.0f} %)",
            "charge or change the pack",
        ),
        _check(
            "voltage",
            ground.battery_v >= BATTERY_MIN_V,
            f"{ground.battery_v:.1f} V (least {BATTERY_MIN_V:g} V)",
            "charge the pack, or look at its plug",
        ),
        _check(
            "energy",
            energy_needed_j <= energy_left_j,
            f"needs {energy_needed_j / 1e3:.1f} kJ, has {has} above the reserve",
            "charge the pack, or shorten the mission",
        ),
        _check(
            "emergency stop",
            not ground.estop,
            "latched" if ground.estop else "released",
            "release it on the land controller",
        ),
        _check(
            "land controller's faults",
            not ground.faults,
            "; ".join(ground.faults) or "none",
            "see what each fault says",
        ),
        _check(
            "autopilot's health",
            not air.failsafe and air.fault is None,
            air.fault or ("in failsafe" if air.failsafe else "good"),
            "see what the autopilot says",
        ),
        _check(
            "stands on its wheels",
            ground.wheel_load,
            "yes" if ground.wheel_load else "no load felt",
            "set it down on its wheels",
        ),
        _check("logs", logs_ok, "writing" if logs_ok else "one has stopped", "free space on the disk"),
    ]
    return checks


def _check(name: str, passed: bool, figure: str, fix: str) -> Check:
    return Check(name, passed, figure, "" if passed else fix)


def _age(age_s: float) -> str:
    if not math.isfinite(age_s):
        return "never seen, inf s"
    return f"{age_s * 1e3:.0f} ms" if age_s < 1.0 else f"{age_s:.1f} s"
