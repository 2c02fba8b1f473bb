"""Missions on an autopilot that runs as a program of its own, with its own physics at a place of its own."""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as m
from sitl_rig import start_flight, write_mission

from labr_autonomy.record.summary import read_summary

pytestmark = [pytest.mark.sitl, pytest.mark.timeout(150)]
AP_LAND = 9
IN_AIR, ARDUPILOT = 2, 3
FROZEN_S = 1.8  # PX4 misses set-points after 1.0 s
YIELD_S = 0.1


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


@contextlib.contextmanager
def autopilot(kind, folder, *arguments):
    port = free_port()
    command = [sys.executable, "-m", "sim.autopilot.alone", "--kind", kind, "--yaw-deg", "200", *arguments]
    with (folder / "autopilot.log").open("w") as log:
        process = subprocess.Popen([*command, "--air", f"udpout://127.0.0.1:{port}"], stderr=log)
    try:
        yield f"udpin://127.0.0.1:{port}"
        assert process.poll() is None, "the autopilot ended by itself"
    finally:
        process.terminate()
        process.wait(timeout=10)


class Station:
    """A ground station at the window that `--watch` opens."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.2)
        self.url = f"udp://127.0.0.1:{self.socket.getsockname()[1]}"
        self._parser, self._own, self._peer = m.MAVLink(None), m.MAVLink(None, 255, 190), None
        self._parser.robust_parsing = True

    def wait_for_flight(self, process, hover_s) -> None:
        """Return `hover_s` after the autopilot has reported to be in the air."""
        flying_s, deadline_s = None, time.monotonic() + 100.0
        while flying_s is None or time.monotonic() - flying_s < hover_s:
            assert process.poll() is None, "the flight ended before it was in the air"
            assert time.monotonic() < deadline_s, "it did not take off"
            with contextlib.suppress(TimeoutError):
                data, self._peer = self.socket.recvfrom(2048)
                for message in self._parser.parse_buffer(data) or ():
                    if message.get_type() == "EXTENDED_SYS_STATE" and message.landed_state == IN_AIR:
                        flying_s = flying_s or time.monotonic()

    def say(self, message) -> None:
        self.socket.sendto(message.pack(self._own), self._peer)


def logged(path, *names):
    """Stamps and messages of the link's log."""
    link = mavutil.mavlink_connection(str(path), dialect="development")
    rows = []
    while (message := link.recv_match()) is not None:
        if message.get_type() in names:
            rows.append((message._timestamp, message))
    link.close()
    return rows


def finished(process, folder, code):
    process.wait(timeout=110)
    log = (folder / "fly.log").read_text()
    assert process.returncode == code, log
    run = next(p for p in folder.iterdir() if p.is_dir())
    return run, read_summary(run)


def test_a_mission_flies_on_px4_drives_on_our_wheels_and_survives_a_pause(tmp_path):
    items = ("goto: {x: -3.0, y: 0.6}", "goto: {x: -2.4, y: 1.4, z: 1.2}", "wait: {seconds: 4}")
    mission = write_mission(tmp_path, *items, "land: {}", "goto: {x: -3.2, y: 1.8}")
    truth, station = f"127.0.0.1:{free_port()}", Station()
    with autopilot("px4", tmp_path, "--truth", f"udpout://{truth}") as url:
        links = ("--air", url, "--truth", f"udpin://{truth}", "--watch", station.url)
        process = start_flight(mission, tmp_path, "--json", *links)
        station.wait_for_flight(process, 4.0)
        os.kill(process.pid, signal.SIGSTOP)  # the executive alone: set-points stop
        time.sleep(FROZEN_S)
        os.kill(process.pid, signal.SIGCONT)
        station.socket.close()
        run, summary = finished(process, tmp_path, 0)
    assert summary["outcome"] == "success"
    assert summary["contacts"] == 0
    assert summary["land_m"] >= 1.5
    assert summary["air_m"] >= 1.0
    assert max(summary["goal_errors_m"]) < 0.5  # by the true pose, which is rover and autopilot in turn
    assert min(summary["energy_land_j"], summary["energy_air_j"], summary["energy_transition_j"]) > 0.0
    with np.load(run / "truth.npz") as track:
        steps = np.linalg.norm(np.diff(track["position_m"], axis=0), axis=1)
        assert steps.max() < 0.15, "the hand-over between rover and autopilot moved the robot"
        assert track["mode"].max() == 1
    assert json.loads((run / "referee.json").read_text())["touchdown_mps"] < 0.6
    told = re.findall(r"INFO (\w+), armed", (tmp_path / "autopilot.log").read_text())
    assert told[:3] == ["offboard", "land", "offboard"], "it lost the set-points and came back with them"


def test_a_ground_station_takes_ardupilot_over_and_the_pilot_yields_at_once(tmp_path):
    items = ("goto: {x: -3.4, y: 0.3}", "goto: {x: -3.0, y: 0.9, z: 1.1}", "wait: {seconds: 60}")
    mission, station = write_mission(tmp_path, *items), Station()
    with autopilot("ardupilot", tmp_path) as url:
        window = ("--watch", station.url, "--watch-commands")
        process = start_flight(mission, tmp_path, "--json", "--air", url, *window)
        station.wait_for_flight(process, 5.0)
        station.say(m.MAVLink_command_long_message(1, 1, 21, 0, 0, 0, 0, 0, 0, 0, 0))
        station.socket.close()
        run, summary = finished(process, tmp_path, 6)
    assert summary["outcome"] == "failsafe"
    assert "somebody else took over: the autopilot is in land" in summary["reason"]
    assert summary["contacts"] == 0
    rows = logged(run / "air.tlog", "HEARTBEAT", "SET_POSITION_TARGET_LOCAL_NED")
    shown_s = next(
        t
        for t, x in rows
        if x.get_type() == "HEARTBEAT" and (x.autopilot, x.custom_mode) == (ARDUPILOT, AP_LAND)
    )
    last_s = max(t for t, x in rows if x.get_type() != "HEARTBEAT")
    late_s = summary["tick_late_ms"]["max"] * 1e-3  # of this machine
    assert last_s - shown_s < YIELD_S + late_s, "it fought"
