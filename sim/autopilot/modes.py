"""PX4's flight modes and how they look on the wire."""

from __future__ import annotations

import enum

_AUTO = 4


class FlightMode(enum.Enum):
    """PX4's main and sub mode (px4_custom_mode.h)."""

    MANUAL = (1, 0)
    ALTITUDE = (2, 0)
    POSITION = (3, 0)
    TAKEOFF = (_AUTO, 2)
    HOLD = (_AUTO, 3)
    MISSION = (_AUTO, 4)
    RETURN = (_AUTO, 5)
    LAND = (_AUTO, 6)
    ACRO = (5, 0)
    OFFBOARD = (6, 0)
    STABILIZED = (7, 0)

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode."""
        main, sub = self.value
        return (sub << 24) | (main << 16)

    @property
    def automatic(self) -> bool:
        """Whether PX4 counts it among the AUTO modes."""
        return bool(self.value[0] == _AUTO)


def find_mode(main: int, sub: int) -> FlightMode | None:
    """The mode of a DO_SET_MODE command, or None; a sub mode matters to AUTO only."""
    key = (main, sub if main == _AUTO else 0)
    return next((mode for mode in FlightMode if mode.value == key), None)
