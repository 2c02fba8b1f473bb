"""What this room makes of the messages that a real PX4 1.18 sent, from the recordings themselves.

They are not part of the repository; without them these tests are skipped.
"""

from __future__ import annotations

import functools
import os
import struct
from itertools import groupby
from pathlib import Path

import pytest
from pymavlink import mavutil

from labr_autonomy.air.families import PX4
from labr_autonomy.air.parameters import wanted
from labr_autonomy.air.report import Report
from labr_autonomy.air.telemetry import Message, air_state
from labr_autonomy.air.vehicle import check_vehicle, release_of
from labr_autonomy.config import AirLimits
from labr_autonomy.guard import takeover

SHARED = Path(os.environ.get("LABR_SHARED") or Path(__file__).resolve().parents[2].parent / "shared")
FLIGHTS = SHARED / "data" / "px4_flights"
STATE = ("HEARTBEAT", "CURRENT_MODE", "EXTENDED_SYS_STATE", "BATTERY_STATUS")
KINDS = (*STATE, "AUTOPILOT_VERSION", "PARAM_VALUE")
EVENT = "UNKNOWN_410"
INT32 = 6

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FLIGHTS.is_dir(), reason=f"the recorded flights are not in {FLIGHTS}"),
]


@functools.cache
def recorded(flight):
    """Time since the first frame [s] and each message of the autopilot that is looked at here."""
    link = mavutil.mavlink_connection(str(FLIGHTS / f"{flight}.tlog"), dialect="development")
    start, rows = None, []
    while (m := link.recv_match()) is not None:
        start = m._timestamp if start is None else start
        if m.get_type() == EVENT or (m.get_type() in KINDS and m.get_srcComponent() == 1):
            rows.append((m._timestamp - start, m))
    link.close()
    return rows


def of(flight, name):
    return [m for _, m in recorded(flight) if m.get_type() == name]


def event_fields(m):
    payload = bytes(m.get_msgbuf())[10:]
    payload = payload[: bytes(m.get_msgbuf())[1]].ljust(53, b"\0")
    number, _, _, _, _, levels = struct.unpack("<IIHBBB", payload[:13])
    return {"id": number, "log_levels": levels, "arguments": list(payload[13:])}


def flown(flight):
    """Everything the channel would have known, message by message."""
    latest, watch, out = {}, takeover.State(), []
    report = Report()
    for t, m in recorded(flight):
        if m.get_type() == EVENT:
            said = report.take("EVENT", Message(t, event_fields(m)))
            out.append((t, "said", said))
            continue
        latest[m.get_type()] = Message(t, m.to_dict())
        if "HEARTBEAT" not in latest or m.get_type() not in STATE:
            continue
        s = air_state(latest, t, t)
        flying = s.armed and s.landed != "on_ground"
        inputs = takeover.Inputs(flying, s.mode, s.intended, s.failsafe, False, False, s.resumes)
        watch, verdict = takeover.step(watch, inputs, t)
        out.append((t, "mode", s.mode))
        out.append((t, "verdict", verdict))
        out.append((t, "reason", report.reason(t)))
    return out


def story(rows, kind):
    """Changes of one kind, with their times."""
    own = (row for row in rows if row[1] == kind)
    return [(value, next(group)[0]) for value, group in groupby(own, key=lambda row: row[2])]


@pytest.fixture(scope="module")
def flights():
    return {name: flown(name) for name in ("px4_ev_frd", "px4_pym_ev")}


def test_it_is_recognised_and_its_release_accepted():
    assert check_vehicle(1, of("px4_ev_frd", "HEARTBEAT")[0].to_dict(), "x", "LABR") is PX4
    assert release_of(of("px4_ev_frd", "AUTOPILOT_VERSION")[0].to_dict()).text == "1.18.0"


def test_modes_are_those_that_were_flown(flights):
    assert [mode for mode, _ in story(flights["px4_ev_frd"], "mode")] == [
        "hold",
        "offboard",
        "land",
        "offboard",
    ]


def test_a_refused_arming_has_its_reason(flights):
    said = [value for _, kind, value in flights["px4_ev_frd"] if kind == "said" and value]
    assert said[0] == "arming denied, its health checks fail"
    reasons = {value for t, kind, value in flights["px4_ev_frd"] if kind == "reason" and 7.4 < t < 7.8}
    assert reasons == {"arming denied, its health checks fail; set-points have stopped"}


def test_nobody_is_said_to_have_taken_over_while_it_followed(flights):
    verdicts = [v for t, kind, v in flights["px4_pym_ev"] if kind == "verdict" and t < 68.0]
    assert set(verdicts) == {""}, "a take-off command in the air, and back to offboard within a second"


def test_lost_set_points_are_waited_for_and_a_failsafe_that_lasts_is_followed(flights):
    rows = flights["px4_pym_ev"]
    first_s = next(t for t, kind, v in rows if kind == "mode" and v == "land" and t > 68.0)
    verdicts = [(t, v) for t, kind, v in rows if kind == "verdict" and 68.0 < t < 71.8]
    assert {v for t, v in verdicts if t < first_s + takeover.RESUME_S} == {""}
    assert {v for t, v in verdicts if t > first_s + takeover.RESUME_S + 0.1} == {
        "the autopilot's own failsafe went to land"
    }


def test_every_parameter_we_ask_for_is_there_and_of_the_kind_we_take_it_for():
    have = {}
    for m in of("px4_pym_ev", "PARAM_VALUE"):
        raw = bytes(m.get_msgbuf())[10:14]
        value = struct.unpack("<i", raw)[0] if m.param_type == INT32 else m.param_value
        have[m.param_id] = (m.param_type == INT32, value)
    for want in wanted(PX4, AirLimits()):
        whole, value = have[want.names[0]]
        assert whole is want.whole, want.names
        assert want.good(value) or not want.must, want.names
