"""A ground station takes the robot over in flight, through the window that `--watch` opens."""

import contextlib
import json
import socket
import time

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as m
from sitl_rig import start_flight, write_mission

from labr_autonomy.record.summary import read_summary

pytestmark = [pytest.mark.sitl, pytest.mark.timeout(120)]
LAND, IN_AIR, YIELD_S = 0x06040000, 2, 0.1


def test_the_pilot_yields_within_a_tenth_of_a_second_and_follows_to_the_floor(tmp_path):
    mission = write_mission(tmp_path, "goto: {x: -3.0, y: 0.5, z: 1.2}", "wait: {seconds: 60}")
    station = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    station.bind(("127.0.0.1", 0))
    station.settimeout(0.2)
    window = f"udp://127.0.0.1:{station.getsockname()[1]}"
    process = start_flight(mission, tmp_path, "--json", "--watch", window, "--watch-commands")
    parser, own = m.MAVLink(None), m.MAVLink(None, 255, 190)
    parser.robust_parsing = True
    flying_s = asked_s = None
    deadline = time.monotonic() + 100.0
    while process.poll() is None and time.monotonic() < deadline:
        with contextlib.suppress(TimeoutError):
            data, window_end = station.recvfrom(2048)
            for message in parser.parse_buffer(data) or ():
                if message.get_type() == "EXTENDED_SYS_STATE" and message.landed_state == IN_AIR:
                    flying_s = flying_s or time.monotonic()
        if flying_s is not None and asked_s is None and time.monotonic() - flying_s > 4.0:
            asked_s = time.monotonic()
            land = m.MAVLink_command_long_message(1, 1, 21, 0, 0, 0, 0, float("nan"), 0, 0, 0)
            station.sendto(land.pack(own), window_end)
    station.close()
    log = (tmp_path / "fly.log").read_text()
    assert asked_s is not None, log
    assert process.returncode == 6, log
    run = next(p for p in tmp_path.iterdir() if p.is_dir())
    summary = read_summary(run)
    assert summary["outcome"] == "failsafe"
    assert "somebody else took over: the autopilot is in land" in summary["reason"]
    assert json.loads((run / "referee.json").read_text())["contacts"] == 0
    late_s = summary["tick_late_ms"]["max"] * 1e-3  # of this machine
    assert seconds_of_setpoints_after_the_takeover(run / "air.tlog") < YIELD_S + late_s


def seconds_of_setpoints_after_the_takeover(path) -> float:
    """How long set-points went on once the autopilot's own word of the new mode was on the link [s]."""
    link = mavutil.mavlink_connection(str(path), dialect="development")
    shown_s = last_s = None
    while (message := link.recv_match()) is not None:
        name = message.get_type()
        if name == "CURRENT_MODE" and message.custom_mode == LAND and shown_s is None:
            shown_s = message._timestamp
        if name == "SET_POSITION_TARGET_LOCAL_NED":
            last_s = message._timestamp
    link.close()
    assert shown_s is not None, "the takeover is not in the log"
    assert last_s is not None
    return last_s - shown_s
