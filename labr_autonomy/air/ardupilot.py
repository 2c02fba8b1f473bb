"""Numbers of ArduCopter that this room needs, as words; pure tables."""

from __future__ import annotations

from typing import Final

AUTOPILOT_ARDUPILOT: Final = 3  # MAV_AUTOPILOT_ARDUPILOTMEGA

GUIDED: Final = 4  # custom_mode
_MODES: Final = {  # ArduCopter's custom_mode (Mode::Number)
    0: "stabilize",
    1: "acro",
    2: "alt_hold",
    3: "auto",
    GUIDED: "guided",
    5: "loiter",
    6: "return",
    7: "circle",
    9: "land",
    11: "drift",
    13: "sport",
    14: "flip",
    15: "autotune",
    16: "position",
    17: "brake",
    18: "throw",
    19: "avoid_adsb",
    20: "guided_no_gps",
    21: "smart_return",
    22: "flow_hold",
    23: "follow",
    24: "zigzag",
    27: "auto_return",
}

# message id, rate [Hz]; ODOMETRY (331) is not among what ArduPilot sends (recorded: DENIED)
STREAMS: Final = {
    "RAW_IMU": (27, 50.0),
    "LOCAL_POSITION_NED": (32, 50.0),
    "ATTITUDE_QUATERNION": (31, 50.0),
    "EXTENDED_SYS_STATE": (245, 5.0),
    "BATTERY_STATUS": (147, 2.0),
}


def mode_name(custom_mode: int) -> str:
    """ArduCopter's flight mode in a word; its number where the table has none (see `px4.mode_name`)."""
    return _MODES.get(custom_mode, f"mode {custom_mode}")
