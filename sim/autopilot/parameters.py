"""The parameters that a client of this robot asks for, with PX4's names, types and bytewise integers.

The recorded PX4 has 932 of them; the stand-in has those that its behaviour or the pre-flight checks of a
VIO-only robot depend on.
"""

from __future__ import annotations

import struct

from pymavlink.dialects.v20 import development as mavlink

INT32 = mavlink.MAV_PARAM_TYPE_INT32
REAL32 = mavlink.MAV_PARAM_TYPE_REAL32
HASH_NAME = "_HASH_CHECK"

DEFAULTS: dict[str, int | float] = {
    "BAT1_N_CELLS": 5,
    "BAT1_V_CHARGED": 4.05,
    "BAT1_V_EMPTY": 3.6,
    "BAT_CRIT_THR": 0.07,
    "BAT_EMERGEN_THR": 0.05,
    "BAT_LOW_THR": 0.15,
    "COM_ARM_WO_GPS": 1,
    "COM_DISARM_LAND": 2.0,
    "COM_DISARM_PRFLT": 10.0,
    "COM_LOW_BAT_ACT": 0,
    "COM_OBL_RC_ACT": 0,
    "COM_OF_LOSS_T": 1.0,
    "COM_RCL_EXCEPT": 0,
    "COM_RC_IN_MODE": 1,
    "COM_SPOOLUP_TIME": 1.0,
    "EKF2_EV_CTRL": 15,
    "EKF2_EV_DELAY": 0.0,
    "EKF2_GPS_CTRL": 0,
    "EKF2_HGT_REF": 3,
    "EKF2_MAG_TYPE": 5,
    "EKF2_NOAID_TOUT": 5000000,
    "FD_FAIL_P": 60,
    "FD_FAIL_R": 60,
    "MAV_SYS_ID": 1,
    "MAV_TYPE": 2,
    "MIS_TAKEOFF_ALT": 2.5,
    "MPC_LAND_CRWL": 0.35,
    "MPC_LAND_SPEED": 0.7,
    "MPC_THR_HOVER": 0.5,
    "MPC_TILTMAX_AIR": 35.0,
    "MPC_XY_P": 0.95,
    "MPC_XY_VEL_MAX": 12.0,
    "MPC_Z_P": 1.0,
    "MPC_Z_VEL_MAX_DN": 1.5,
    "MPC_Z_VEL_MAX_UP": 3.0,
    "NAV_DLL_ACT": 0,
    "NAV_RCL_ACT": 2,
    "SDLOG_MODE": -1,
    "SYS_AUTOSTART": 10040,
    "SYS_HAS_GPS": 0,
    "SYS_HAS_MAG": 0,
}


class Parameters:
    """The table, and its three MAVLink requests."""

    def __init__(self) -> None:
        self._values = dict(sorted(DEFAULTS.items()))
        self._names = list(self._values)

    def __getitem__(self, name: str) -> float:
        return float(self._values[name])

    def read(self, name: str, index: int) -> mavlink.MAVLink_message | None:
        """Answer to PARAM_REQUEST_READ by name or, with an index from 0, by index; None when unknown."""
        if index >= 0:
            return self._message(self._names[index]) if index < len(self._names) else None
        if name == HASH_NAME:
            return self._hash()
        return self._message(name) if name in self._values else None

    def write(self, name: str, value: float, kind: int) -> mavlink.MAVLink_message | None:
        """Answer to PARAM_SET; a value of the wrong type changes nothing; None when unknown."""
        if name not in self._values:
            return None
        old = self._values[name]
        if isinstance(old, int) and kind == INT32:
            self._values[name] = struct.unpack("<i", struct.pack("<f", value))[0]
        elif isinstance(old, float) and kind == REAL32:
            self._values[name] = float(value)
        return self._message(name)

    def everything(self) -> list[mavlink.MAVLink_message]:
        """Answer to PARAM_REQUEST_LIST: the hash first, then the table in order."""
        return [self._hash(), *(self._message(name) for name in self._names)]

    def _message(self, name: str) -> mavlink.MAVLink_message:
        value = self._values[name]
        kind = INT32 if isinstance(value, int) else REAL32
        wire = struct.unpack("<f", struct.pack("<i", value))[0] if isinstance(value, int) else value
        return mavlink.MAVLink_param_value_message(
            name.encode(), wire, kind, len(self._names), self._names.index(name)
        )

    def _hash(self) -> mavlink.MAVLink_message:
        kind = mavlink.MAV_PARAM_TYPE_UINT32
        return mavlink.MAVLink_param_value_message(HASH_NAME.encode(), 0.0, kind, len(self._names), 65535)
