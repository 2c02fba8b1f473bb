"""Numbers of MAVLink and PX4 that this room needs, as words; pure tables."""

from __future__ import annotations

from typing import Final

AUTOPILOT_COMPONENT: Final = 1  # MAV_COMP_ID_AUTOPILOT1
VEHICLE_SYSTEM: Final = 1  # LABR's autopilot and its companion share system id 1
AUTOPILOT_PX4: Final = 12  # MAV_AUTOPILOT_PX4

AUTOPILOTS: Final = {0: "a generic autopilot", 3: "ArduPilot", 8: "no autopilot", 12: "PX4"}  # MAV_AUTOPILOT
MULTICOPTERS: Final = frozenset({2, 13, 14, 15, 29, 35})  # MAV_TYPE: quad, hexa, octo, tri, dodeca, deca
VEHICLES: Final = {  # MAV_TYPE
    0: "generic vehicle",
    1: "fixed-wing plane",
    2: "quadrotor",
    3: "coaxial helicopter",
    4: "helicopter",
    6: "ground station",
    10: "ground rover",
    11: "boat",
    12: "submarine",
}

ARMED_FLAG: Final = 128  # MAV_MODE_FLAG_SAFETY_ARMED
CUSTOM_MODE_FLAG: Final = 1  # MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
CRITICAL: Final = frozenset({5, 6})  # MAV_STATE_CRITICAL, MAV_STATE_EMERGENCY

CMD_NAV_LAND: Final = 21
CMD_NAV_TAKEOFF: Final = 22
CMD_DO_SET_MODE: Final = 176
CMD_ARM_DISARM: Final = 400
CMD_SET_MESSAGE_INTERVAL: Final = 511
CMD_REQUEST_MESSAGE: Final = 512

MAIN_OFFBOARD: Final = 6
_MAIN: Final = {  # PX4_CUSTOM_MAIN_MODE
    1: "manual",
    2: "altitude",
    3: "position",
    5: "acro",
    MAIN_OFFBOARD: "offboard",
    7: "stabilized",
    8: "rattitude",
    9: "simple",
    10: "termination",
}
_AUTO: Final = {  # PX4_CUSTOM_SUB_MODE_AUTO
    1: "ready",
    2: "takeoff",
    3: "hold",
    4: "mission",
    5: "return",
    6: "land",
    8: "follow",
    9: "precision_land",
}
_LANDED: Final = {1: "on_ground", 2: "in_air", 3: "takeoff", 4: "landing"}  # MAV_LANDED_STATE

ACCEPTED: Final = 0
IN_PROGRESS: Final = 5
_RESULTS: Final = {  # MAV_RESULT
    1: "temporarily rejected",
    2: "denied",
    3: "unsupported",
    4: "failed",
    6: "cancelled",
    7: "wants COMMAND_LONG",
    8: "wants COMMAND_INT",
    9: "wrong frame",
}

MSG_GPS_GLOBAL_ORIGIN: Final = 49
MSG_AUTOPILOT_VERSION: Final = 148
CAPABILITY_LOCAL_SETPOINTS: Final = 128  # MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED

# message id, rate [Hz]: what the executive reads and how often
STREAMS: Final = {
    "CURRENT_MODE": (436, 20.0),  # heartbeats come at 1 Hz, and a takeover must show within 100 ms
    "HIGHRES_IMU": (105, 50.0),
    "LOCAL_POSITION_NED": (32, 50.0),
    "ATTITUDE_QUATERNION": (31, 50.0),
    "EXTENDED_SYS_STATE": (245, 5.0),
    "BATTERY_STATUS": (147, 2.0),
}


def mode_name(custom_mode: int) -> str:
    """PX4's flight mode in a word; its numbers where this table does not have it.

    Never "unknown": that is the word for a silent autopilot, whom nobody has taken over.
    """
    main, sub = (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF
    if main == 4:
        return _AUTO.get(sub, f"mode {main}.{sub}")
    return _MAIN.get(main, f"mode {main}")


def landed_name(landed_state: int) -> str:
    """EXTENDED_SYS_STATE.landed_state in a word."""
    return _LANDED.get(landed_state, "unknown")


def result_name(result: int) -> str:
    """MAV_RESULT in words, with its number."""
    return f"{_RESULTS.get(result, 'unknown result')} (MAV_RESULT {result})"
