"""Parameters as ArduPilot sends them: every value as a plain float; an unknown name gets no answer."""

from __future__ import annotations

from pymavlink.dialects.v20 import development as mavlink

COUNT = 1349  # of the recorded ArduCopter 4.7
_INT8, _INT32, _REAL = (
    mavlink.MAV_PARAM_TYPE_INT8,
    mavlink.MAV_PARAM_TYPE_INT32,
    mavlink.MAV_PARAM_TYPE_REAL32,
)

DEFAULTS: dict[str, tuple[float, int]] = {
    "AHRS_EKF_TYPE": (3, _INT8),
    "ARMING_CHECK": (1, _INT32),
    "COMPASS_ENABLE": (0, _INT8),
    "EK3_SRC1_POSXY": (6, _INT8),
    "EK3_SRC1_POSZ": (6, _INT8),
    "EK3_SRC1_VELXY": (6, _INT8),
    "EK3_SRC1_VELZ": (6, _INT8),
    "EK3_SRC1_YAW": (6, _INT8),
    "FS_EKF_ACTION": (1, _INT8),
    "GPS1_TYPE": (0, _INT8),
    "GUID_OPTIONS": (0, _INT32),
    "GUID_TIMEOUT": (3.0, _REAL),
    "MAV_SYSID": (1, mavlink.MAV_PARAM_TYPE_INT16),
    "VISO_TYPE": (1, _INT8),
}


class Parameters:
    """The table."""

    def __init__(self) -> None:
        self._values = dict(DEFAULTS)

    def __getitem__(self, name: str) -> float:
        return self._values[name][0]

    def read(self, name: str) -> mavlink.MAVLink_message | None:
        """Answer to PARAM_REQUEST_READ; None, and silence, when there is no such parameter."""
        if name not in self._values:
            return None
        value, kind = self._values[name]
        return mavlink.MAVLink_param_value_message(name.encode(), float(value), kind, COUNT, 65535)

    def write(self, name: str, value: float) -> mavlink.MAVLink_message | None:
        """Answer to PARAM_SET."""
        if name in self._values:
            self._values[name] = (value, self._values[name][1])
        return self.read(name)

    def everything(self) -> list[mavlink.MAVLink_message]:
        """Answer to PARAM_REQUEST_LIST, with indices."""
        names = sorted(self._values)
        return [
            mavlink.MAVLink_param_value_message(
                n.encode(), float(self._values[n][0]), self._values[n][1], len(names), i
            )
            for i, n in enumerate(names)
        ]
