"""Distil the recorded PX4 flights into `px4_facts.json`, the fixture of the conformance test.

Run by hand when the recordings change: `python tests/autopilot/extract_px4_facts.py`. It reads
`../shared/data/px4_flights` beside the repository, or LABR_SHARED.
"""

from __future__ import annotations

import json
import math
import os
import struct
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil

HERE = Path(__file__).resolve()
SHARED = Path(os.environ.get("LABR_SHARED", HERE.parents[2].parent / "shared"))
FLIGHTS = ("px4_ev_frd", "px4_pym_ev")
# Messages that pymavlink's dialects do not know, by MAVLink's common.xml.
NAMES = {
    8: "LINK_NODE_STATUS",
    290: "ESC_INFO",
    291: "ESC_STATUS",
    380: "TIME_ESTIMATE_TO_TARGET",
    397: "COMPONENT_METADATA",
    410: "EVENT",
    411: "CURRENT_EVENT_SEQUENCE",
    514: "ESTIMATOR_SENSOR_FUSION_STATUS",
}
# Events of the commander that say what the robot does: armed, disarmed, took off, landed, failsafe, denied.
COMMANDER_EVENTS = {0x190CAF3, 0x1F46777, 0x1414569, 0x19638AC, 0x1DEDBD0, 0x102089D, 0x18AB9B5}
HOME = 242.0
STEADY_S = 10.0  # the client has asked for its intervals by then


def number(value: float, digits: int = 4) -> float | None:
    return None if math.isnan(value) else round(value, digits)


def messages(path: Path) -> Iterator[tuple[float, str, int, object]]:
    """Time since the first frame [s], name, component, message."""
    link = mavutil.mavlink_connection(str(path), dialect="development")
    start = None
    while (message := link.recv_match()) is not None:
        start = message._timestamp if start is None else start
        name, component = message.get_type(), message.get_srcComponent()
        if name.startswith("UNKNOWN_"):
            name, component = NAMES[int(name.removeprefix("UNKNOWN_"))], 1
        yield message._timestamp - start, name, component, message


def message_payload(message: object) -> bytes:
    """Payload of a message that pymavlink cannot read, with the zeros that MAVLink 2 cuts."""
    frame = bytes(message.get_msgbuf())
    return frame[10 : 10 + frame[1]].ljust(53, b"\0")


def mean_rate(times: list[float]) -> float:
    """Messages a second over their own span; 0 for fewer than ten."""
    return round((len(times) - 1) / (times[-1] - times[0]), 3) if len(times) >= 10 else 0.0


def distil(path: Path) -> dict[str, object]:  # noqa: C901  one pass over the messages
    seen: dict[str, list[float]] = defaultdict(list)
    client: list[list[object]] = []
    setpoints: list[list[float | None]] = []
    acks: list[list[object]] = []
    heartbeats: list[list[object]] = []
    landed: list[list[object]] = []
    commands: list[list[object]] = []
    parameters: list[list[object]] = []
    vision: list[float] = []
    stream: list[float] = []
    events: list[float] = []
    told: list[list[object]] = []
    home = Counter[int]()
    down: list[tuple[float, float, float]] = []
    for t, name, component, m in messages(path):
        if component == 1:
            seen[name].append(t)
        if component != 1:
            match name:
                case "COMMAND_LONG" if m.command == 512 and m.param1 == HOME:
                    pass
                case "COMMAND_LONG":
                    p = [number(m.param1), number(m.param2), number(m.param3)]
                    client.append([round(t, 3), "command", m.command, *p])
                case "PARAM_REQUEST_READ":
                    client.append([round(t, 3), "read", m.param_id])
                case "PARAM_SET":
                    client.append([round(t, 3), "set", m.param_id, m.param_value, m.param_type])
                case "ODOMETRY":
                    vision.append(t)
                case "SET_POSITION_TARGET_LOCAL_NED":
                    if not stream or t - stream[-1] > 0.3 or not setpoints or t - setpoints[-1][0] >= 1.0:
                        values = (m.x, m.y, m.z, m.vx, m.vy, m.vz)
                        setpoints.append([round(t, 3), m.type_mask, *(number(v, 2) for v in values)])
                    stream.append(t)
            continue
        match name:
            case "COMMAND_ACK" if m.command == 512 and acks and m.result == 2:
                home[m.result] += 1
            case "COMMAND_ACK":
                acks.append([round(t, 3), m.command, m.result])
            case "HEARTBEAT":
                row = [m.base_mode, m.custom_mode, m.system_status]
                if not heartbeats or heartbeats[-1][1:] != row:
                    heartbeats.append([round(t, 2), *row])
            case "EXTENDED_SYS_STATE":
                if not landed or landed[-1][1] != m.landed_state:
                    landed.append([round(t, 2), m.landed_state])
            case "COMMAND_LONG":
                commands.append([round(t, 2), m.command, m.confirmation])
            case "PARAM_VALUE" | "PARAM_ERROR" if client:
                wire = struct.pack("<f", m.param_value).hex() if name == "PARAM_VALUE" else None
                kind = m.param_type if name == "PARAM_VALUE" else None
                parameters.append([name, m.param_id, wire, kind])
            case "EVENT":
                events.append(round(t, 3))
                told.append([round(t, 3), int.from_bytes(message_payload(m)[:4], "little")])
            case "LOCAL_POSITION_NED":
                down.append((t, m.z, m.vz))
    asked = {row[2] for row in client if row[1] == "read"} | {row[2] for row in client if row[1] == "set"}
    gaps = [[round(a, 3), round(b, 3)] for a, b in pairwise(stream) if b - a > 0.3]
    beats = seen["HEARTBEAT"]
    return {
        "duration_s": round(t, 2),
        "messages": {
            name: [len(times), mean_rate([x for x in times if x > STEADY_S])]
            for name, times in sorted(seen.items())
        },
        "heartbeat_gap_s": [round(f(b - a for a, b in pairwise(beats)), 3) for f in (min, max)],
        "client": client,
        "vision_s": [round(vision[0], 2), round(vision[-1], 2)],
        "setpoint_stream_s": [round(stream[0], 3), round(stream[-1], 3)],
        "setpoint_gaps_s": gaps,
        "setpoints": setpoints,
        "acks": acks,
        "home_denied": home[2],
        "heartbeats": heartbeats,
        "landed": landed,
        "px4_commands": commands,
        "parameters": [row for row in parameters if row[1] in asked],
        "events_s": sorted(set(events)),
        "events": [row for row in told if row[1] in COMMANDER_EVENTS],
        "descent": descent(down, heartbeats),
    }


def descent(down: list[tuple[float, float, float]], heartbeats: list[list[object]]) -> list[list[float]]:
    """Speed downwards over height above the lowest point, twice a second, in the last landing."""
    begin = max((row[0] for row in heartbeats if row[2] == 0x06040000), default=None)
    if begin is None:
        return []
    rows = [(t, z, v) for t, z, v in down if t > begin]
    floor = max(z for _, z, _ in rows)
    return [[round(floor - z, 2), round(v, 2)] for _, z, v in rows[::24] if floor - z > 0.05]


def main() -> int:
    facts = {}
    for flight in FLIGHTS:
        path = SHARED / "data" / "px4_flights" / f"{flight}.tlog"
        if not path.exists():
            sys.stderr.write(
                f"{path} is missing. Set LABR_SHARED to the folder that holds data/px4_flights.\n"
            )
            return 2
        facts[flight] = distil(path)
    target = HERE.with_name("px4_facts.json")
    text = json.dumps(facts, separators=(",", ":"), allow_nan=False)
    target.write_text(text.replace('],"', '],\n"').replace('},"', '},\n"') + "\n")
    sys.stdout.write(f"{target.name}: {target.stat().st_size} bytes\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
