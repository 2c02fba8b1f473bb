"""Topics of `flight.mcap`: JSON messages, each with the schema that viewers read.

Stamps are seconds of CLOCK_MONOTONIC; the log time of a message is the same instant as UTC nanoseconds.
Positions are odom ENU metres, quaternions wxyz body to odom. A figure that is unknown is null.
"""

from __future__ import annotations

from typing import Any

Schema = dict[str, Any]

_NUMBER: Schema = {"type": ["number", "null"]}
_TEXT: Schema = {"type": "string"}
_VECTOR: Schema = {"type": "array", "items": _NUMBER}
_VECTORS: Schema = {"type": "array", "items": _VECTOR}
_FLAGS: Schema = {"type": "array", "items": {"type": "boolean"}}
_FIGURES: Schema = {"type": "object", "additionalProperties": _NUMBER}
_KEY_POINTS: Schema = {
    "type": ["object", "null"],
    "properties": {"points_m": _VECTORS, "air": _FLAGS, "mu": _NUMBER, "source": _TEXT},
}


def _message(**fields: Schema) -> Schema:
    return {"type": "object", "properties": {"stamp_s": _NUMBER, **fields}, "required": ["stamp_s"]}


TOPICS: dict[str, Schema] = {
    "/odometry": _message(
        position_m=_VECTOR,
        quaternion=_VECTOR,
        velocity_mps=_VECTOR,
        angular_velocity_rps=_VECTOR,
        sigma_m=_NUMBER,
    ),
    "/setpoint": _message(
        mode=_TEXT,
        position_m=_VECTOR,
        velocity_mps=_VECTOR,
        yaw_rad=_NUMBER,
        yaw_rate_rps=_NUMBER,
        speed_mps=_NUMBER,
    ),
    "/plan": _message(
        frame_stamp_s=_NUMBER,
        network=_KEY_POINTS,
        followed=_KEY_POINTS,
        path_m=_VECTORS,
        mode=_TEXT,
        source=_TEXT,
        clearance_m=_NUMBER,
        reason=_TEXT,
        timings_s=_FIGURES,
    ),
    "/mode": _message(mode=_TEXT, phase=_TEXT, why=_TEXT),
    "/event": _message(level=_TEXT, text=_TEXT, figures=_FIGURES),
    "/link_ages": _message(ages_s=_FIGURES),
    "/battery": _message(
        voltage_v=_NUMBER,
        power_w=_NUMBER,
        air_voltage_v=_NUMBER,
        air_power_w=_NUMBER,
        energy_land_j=_NUMBER,
        energy_air_j=_NUMBER,
        energy_transition_j=_NUMBER,
    ),
    "/depth": _message(
        sequence={"type": "integer"},
        width={"type": "integer"},
        height={"type": "integer"},
        intrinsics=_FIGURES,
        camera_in_body_m=_VECTOR,
        position_m=_VECTOR,
        quaternion=_VECTOR,
        format={"const": "png16"},
        scale_m={"const": 0.001},
        data={"type": "string", "contentEncoding": "base64"},
    ),
    # what the operator's page shows (`mission.portrait`), for replay
    "/console": {**_message(mode=_TEXT, why=_TEXT, stage=_TEXT, phase=_TEXT), "additionalProperties": True},
    "/facts": {**_message(mission=_TEXT, run=_TEXT), "additionalProperties": True},
    # the pilot's calls (`mission.recorded`), for replay --check
    "/pilot": {**_message(call=_TEXT), "additionalProperties": True},
    "/recorder": _message(dropped={"type": "integer"}, queued={"type": "integer"}),
}
