"""What the autopilot's parameters must be for this robot, and how they are compared; pure.

The robot has no GPS: position, height, velocity and heading of the autopilot come from our poses alone.
Values as flown in the reference flights (PX4 1.18, ArduCopter 4.7).
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass

from labr_autonomy.air.families import Family
from labr_autonomy.config import AirLimits
from labr_autonomy.errors import Refused

Read = Callable[[str, bool], Awaitable[float | None]]
"""Reads a parameter by name; `whole` says that it is an integer. None when there is none of that name."""

EPSILON = 1e-4


@dataclass(frozen=True, slots=True)
class Wanted:
    """One parameter."""

    names: tuple[str, ...]  # the first is today's; others are what earlier releases called it
    low: float
    high: float
    set_to: float  # what `--apply` writes
    why: str
    whole: bool = True
    must: bool = True  # False: advice, no reason to stay on the floor

    @property
    def text(self) -> str:
        """What is wanted, for the table."""
        if self.low == self.high:
            return f"{self.low:g}"
        if math.isinf(self.high):
            return f"at least {self.low:g}"
        return f"{self.low:g} to {self.high:g}"

    def good(self, have: float) -> bool:
        """Whether a value will do."""
        return self.low - EPSILON <= have <= self.high + EPSILON


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table."""

    name: str
    have: float | None  # None: there is no such parameter
    want: str
    why: str
    state: str  # "good", "wrong", "missing", "advice"
    wanted: Wanted

    @property
    def refuses(self) -> bool:
        """Whether it keeps the robot on the floor."""
        return self.state in ("wrong", "missing")

    def as_dict(self) -> dict[str, object]:
        """For machines."""
        return {
            "name": self.name,
            "have": self.have,
            "want": self.want,
            "why": self.why,
            "state": self.state,
        }


def wanted(family: Family, limits: AirLimits, system: int = 1) -> tuple[Wanted, ...]:
    """What this robot wants of an autopilot.

    Args:
        family: Which one.
        limits: What the robot may fly; the autopilot's own limits must not be tighter.
        system: The robot's system id.
    """
    return _ardupilot(system) if family.lifts_by_command else _px4(limits, system)


def _is(name: str, value: float, why: str, *older: str, must: bool = True) -> Wanted:
    return Wanted((name, *older), value, value, value, why, must=must)


def _px4(limits: AirLimits, system: int) -> tuple[Wanted, ...]:
    def at_least(name: str, value_mps: float, what: str) -> Wanted:
        why = f"our {what} is up to {value_mps:g} m/s"
        return Wanted((name,), value_mps, math.inf, math.ceil(value_mps), why, whole=False, must=False)

    return (
        _is("MAV_SYS_ID", system, "commands and set-points are addressed to it"),
        _is("SYS_HAS_GPS", 0, "with one it waits for a fix before it arms"),
        _is("EKF2_GPS_CTRL", 0, "our poses are the only position"),
        _is("EKF2_EV_CTRL", 15, "position, height, velocity and heading come from our poses"),
        _is("EKF2_HGT_REF", 3, "the height comes from our poses"),
        _is("SYS_HAS_MAG", 0, "with one it waits for a compass before it arms"),
        _is("EKF2_MAG_TYPE", 5, "indoors a compass turns its frame away from ours"),
        Wanted(
            ("COM_OF_LOSS_T",),
            0.2,
            1.0,
            1.0,
            "set-points that stop must bring it down within 1 s",
            whole=False,
        ),
        Wanted(
            ("EKF2_EV_DELAY",), 0.0, 50.0, 0.0, "our poses are of the present [ms]", whole=False, must=False
        ),
        _is("COM_OBL_RC_ACT", 4, "without set-points it lands, a radio or not", must=False),
        _is("NAV_DLL_ACT", 0, "no ground station is needed in flight", must=False),
        Wanted(
            ("COM_DISARM_LAND",),
            0.1,
            10.0,
            2.0,
            "it disarms by itself once landed [s]",
            whole=False,
            must=False,
        ),
        at_least("MPC_XY_VEL_MAX", limits.speed_mps, "speed"),
        at_least("MPC_Z_VEL_MAX_UP", limits.climb_mps, "climb"),
        at_least("MPC_Z_VEL_MAX_DN", limits.descend_mps, "descent"),
    )


def _ardupilot(system: int) -> tuple[Wanted, ...]:
    axes = {"POSXY": "position", "POSZ": "height", "VELXY": "velocity", "VELZ": "climb", "YAW": "heading"}
    sources = (_is(f"EK3_SRC1_{axis}", 6, f"the {what} comes from our poses") for axis, what in axes.items())
    return (
        _is("MAV_SYSID", system, "commands and set-points are addressed to it", "SYSID_THISMAV"),
        _is("AHRS_EKF_TYPE", 3, "EKF3 fuses our poses"),
        _is("VISO_TYPE", 1, "it takes poses over MAVLink"),
        *sources,
        _is("GPS1_TYPE", 0, "our poses are the only position", "GPS_TYPE"),
        _is("COMPASS_ENABLE", 0, "indoors a compass turns its frame away from ours"),
        Wanted(("GUID_TIMEOUT",), 0.1, 3.0, 1.0, "set-points that stop must stop it soon [s]", whole=False),
        _is("FS_EKF_ACTION", 1, "lost poses must bring it down", must=False),
        _is("ARMING_CHECK", 1, "all of its own checks before it arms", must=False),
    )


async def compare(table: Sequence[Wanted], read: Read) -> list[Row]:
    """Read each parameter and judge it."""
    return [await _row(want, read) for want in table]


async def _row(want: Wanted, read: Read) -> Row:
    for name in want.names:
        have = await read(name, want.whole)
        if have is not None:
            bad = "wrong" if want.must else "advice"
            return Row(name, have, want.text, want.why, "good" if want.good(have) else bad, want)
    return Row(want.names[0], None, want.text, want.why, "missing" if want.must else "advice", want)


def refuse(rows: Sequence[Row]) -> None:
    """Stay on the floor when a parameter is wrong.

    Raises:
        Refused: Naming each with its value.
    """
    wrong = [row for row in rows if row.refuses]
    if not wrong:
        return
    named = "; ".join(
        f"{row.name} is {'not there' if row.have is None else f'{row.have:g}'}, wanted {row.want} ({row.why})"
        for row in wrong
    )
    raise Refused(
        f"the autopilot's parameters do not fit this robot: {named}",
        "Set them with labr-mission params --apply, then restart the autopilot.",
    )
