"""The stand-in of ArduCopter against the recorded one: its client is replayed, and it must answer alike.

`ap_facts.json` is distilled from the transcript of a flight of ArduCopter 4.7 on VIO alone by
`extract_ap_facts.py`. The replay runs on a simulated clock.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from autopilot_rig import parked, setpoint_message, vision_message
from pymavlink.dialects.v20 import development as mavlink

from sim.autopilot.copter import Copter
from sim.autopilot.copter.telemetry import LEFT_OUT
from sim.battery import Battery
from sim.quad import STEP_S, Quad

FACTS = json.loads(Path(__file__).with_name("ap_facts.json").read_text())
ORIGIN_S, VISION_S, SETPOINTS_S, END_S = 6.531, (9.599, 84.2), (32.932, 72.9), 85.2
HOVER_M, LANDING_S = 2.0, 76.0
pytestmark = pytest.mark.slow


RECORDED = sorted(
    [(t, "command", number, p) for t, number, p in FACTS["client"]]
    + [(3.05 + 0.1 * k, "read", name, None) for k, name in enumerate(FACTS["asked"])]
    + [(ORIGIN_S, "origin", None, None)],
    key=lambda row: row[0],
)


class Replay:
    """A client's requests at their times, poses and set-points; by default the recorded client's."""

    def __init__(self, todo=RECORDED, *, boot_s=0.0, end_s=END_S, vision_s=VISION_S, setpoints_s=SETPOINTS_S):
        self.sent = []
        self.now_s = 0.0
        self._parser = mavlink.MAVLink(None)
        self.copter = Copter(self._capture, seed=1, boot_s=boot_s)
        self.client = mavlink.MAVLink(None, 1, 195)
        self.quad, self.battery = Quad(), Battery()
        self.quad.reset(np.array([0.0, 0.0, 0.1221]), math.pi / 2)
        self.truth = self.quad.state
        self._todo, self._vision_s, self._setpoints_s = list(todo), vision_s, setpoints_s
        for k in range(int(end_s / STEP_S)):
            self._step(k)

    def _capture(self, data):
        self.sent += [(self.now_s, m) for m in self._parser.parse_buffer(data)]

    def _send(self, message):
        self.copter.receive(message.pack(self.client))

    def _step(self, k):
        self.now_s = k * STEP_S
        while self._todo and self._todo[0][0] <= self.now_s:
            _, kind, what, p = self._todo.pop(0)
            if kind == "command":
                values = [math.nan if v is None else v for v in p]
                self._send(mavlink.MAVLink_command_long_message(1, 1, what, 0, *values))
            elif kind == "read":
                self._send(mavlink.MAVLink_param_request_read_message(1, 1, what.encode(), -1))
            else:
                self._send(mavlink.MAVLink_set_gps_global_origin_message(1, 473977420, 85455940, 489400))
        if self._vision_s[0] <= self.now_s <= self._vision_s[1] and k % 8 == 0:
            self._send(vision_message(self.truth, int(self.now_s * 1e6)))
        if self._setpoints_s[0] <= self.now_s <= self._setpoints_s[1] and k % 10 == 0:
            self._send(setpoint_message(2552, 0.0, 0.0, -0.12 - HOVER_M))
        motors = self.copter.step(100.0 + self.now_s, self.truth, self.battery)
        if motors is not None or not self.truth.on_ground:
            self.quad.set_volts(self.battery.step(STEP_S))
            self.truth = self.quad.step(np.zeros(4) if motors is None else np.array(motors))

    def of(self, name):
        return [(t, m) for t, m in self.sent if m.get_type() == name]


@pytest.fixture(scope="module")
def replay():
    return Replay()


def changes(rows):
    out = []
    for t, value in rows:
        if not out or out[-1][1] != value:
            out.append((t, value))
    return out


def same_story(got, recorded):
    assert [value for _, value in got] == [value for _, value in recorded]
    for (have_s, value), (want_s, _) in zip(got, recorded, strict=True):
        # a landing takes what the height needs, and the transcript does not tell the height
        slack_s = 1.6 if want_s < LANDING_S else 2.6
        assert have_s == pytest.approx(want_s, abs=slack_s), value


def test_commands_are_answered_alike(replay):
    asked = [number for _, number, _ in FACTS["client"]]
    got = [(m.command, m.result) for _, m in replay.of("COMMAND_ACK")]
    recorded = [(command, result) for _, command, result in FACTS["acks"]]
    # MAVSDK's own requests of HOME_POSITION are not in the transcript; their answers are
    while len(recorded) > len(asked):
        extra = next(i for i, (command, _) in enumerate(recorded) if asked[i : i + 1] != [command])
        assert recorded.pop(extra) == (512, 0)
    assert got == recorded


def test_heartbeats_tell_the_same_story_and_a_new_mode_at_once(replay):
    got = changes((t, (m.base_mode, m.custom_mode, m.system_status)) for t, m in replay.of("HEARTBEAT"))
    same_story(got, [(row[0], tuple(row[1:])) for row in FACTS["heartbeats"]])
    asked = [t for t, number, _ in FACTS["client"] if number in (176, 21) and t != 32.932]
    beats = [t for t, _ in replay.of("HEARTBEAT")]
    for t in asked:
        assert any(0.0 <= b - t <= 2 * STEP_S for b in beats), f"no heartbeat with the mode of {t}"


def test_landed_states_tell_the_same_story(replay):
    got = changes((t, m.landed_state) for t, m in replay.of("EXTENDED_SYS_STATE"))
    same_story(got, [tuple(row) for row in FACTS["landed"]])


def test_words_are_the_same_and_come_after_the_acknowledgement(replay):
    got = [(m.severity, m.text) for _, m in replay.of("STATUSTEXT")]
    recorded = [(severity, text) for _, severity, text in FACTS["texts"]]
    kept = [row for row in recorded if row in got or not row[1].startswith(tuple(LEFT_OUT))]
    assert got == kept
    assert all(any(text.startswith(start) for _, text in recorded) for start in LEFT_OUT if start[0] != "H")
    refused = [i for i, (_, m) in enumerate(replay.sent) if m.get_type() == "COMMAND_ACK" and m.result == 4]
    for i in refused:
        assert replay.sent[i + 1][1].get_type() == "STATUSTEXT"


def test_parameters_are_plain_floats_and_an_unknown_name_gets_no_answer(replay):
    got = {m.param_id: (m.param_value, m.param_type, m.param_index) for _, m in replay.of("PARAM_VALUE")}
    assert got == {name: (value, kind, 65535) for _, name, value, kind in FACTS["parameters"]}
    assert "NO_SUCH_PARAM" in FACTS["asked"]
    assert not replay.of("PARAM_ERROR")


def test_what_is_asked_for_comes_at_its_rate_and_nothing_else_does(replay):
    seen = {}
    for t, m in replay.sent:
        seen.setdefault(m.get_type(), []).append(t)
    assert seen.keys() == FACTS["rates_hz"].keys() - LEFT_OUT.keys()
    for name in ("ATTITUDE_QUATERNION", "SIM_STATE", "LOCAL_POSITION_NED", "EXTENDED_SYS_STATE"):
        times = seen[name]
        assert (len(times) - 1) / (times[-1] - times[0]) == pytest.approx(FACTS["rates_hz"][name], rel=0.05)


def test_it_takes_off_to_the_height_asked_for_holds_it_and_lands(replay):
    heights = [(t, m.alt) for t, m in replay.of("SIM_STATE")]
    floor = heights[0][1]
    assert max(h for t, h in heights if t < SETPOINTS_S[0]) - floor == pytest.approx(HOVER_M, abs=0.25)
    assert min(h for t, h in heights if 40.0 < t < 72.0) - floor == pytest.approx(HOVER_M, abs=0.15)
    assert heights[-1][1] - floor == pytest.approx(0.0, abs=0.02)


def test_other_frames_of_a_pose_and_poses_without_an_origin_are_not_fused():
    copter = Copter(lambda _: None, boot_s=30.0)
    client, truth = mavlink.MAVLink(None, 1, 195), parked()

    def feed(frame, begin_s):
        for k in range(50):
            copter.receive(vision_message(truth, 0, frame=frame).pack(client))
            copter.step(begin_s + k * STEP_S, truth, Battery())
        return copter.estimate.position_valid

    assert not feed(20, 100.0)
    copter.receive(mavlink.MAVLink_set_gps_global_origin_message(1, 1, 2, 3).pack(client))
    assert not feed(14, 101.0)
    assert not feed(1, 102.0)
    assert feed(20, 103.0)


def test_without_set_points_it_stops_and_stays_up():
    """GUID_TIMEOUT: it does not land by itself, unlike PX4."""
    todo = [
        (0.0, "origin", None, None),
        (1.0, "command", 176, [1.0, 4.0, 0, 0, 0, 0, 0]),
        (1.1, "command", 400, [1.0, 0, 0, 0, 0, 0, 0]),
        (1.2, "command", 22, [0, 0, 0, 0, 0, 0, 1.5]),
    ]
    made = Replay(todo, boot_s=30.0, end_s=20.0, vision_s=(0.0, 20.0), setpoints_s=(8.0, 11.0))
    assert made.copter.armed
    assert float(made.truth.position_m[2]) == pytest.approx(0.12 + HOVER_M, abs=0.2)
    assert float(np.linalg.norm(made.truth.velocity_mps)) < 0.15
