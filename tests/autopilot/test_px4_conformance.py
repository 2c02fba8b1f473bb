"""The stand-in against the recorded PX4: the recorded clients are replayed to it, and it must answer alike.

`px4_facts.json` is distilled from two flights of a real PX4 1.18 without GPS by `extract_px4_facts.py`. The
replay runs on a simulated clock and leaves out stretches in which nothing changes.
"""

import json
import math
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import pytest
from autopilot_rig import Rig
from extract_px4_facts import COMMANDER_EVENTS
from pymavlink.dialects.v20 import development as mavlink

from sim.autopilot.modes import FlightMode
from sim.autopilot.telemetry import LEFT_OUT
from sim.quad import STEP_S

FACTS = json.loads(Path(__file__).with_name("px4_facts.json").read_text())
# Stretches of each recording that are replayed [s]; between them the robot only flies on.
STRETCHES = {
    "px4_ev_frd": [(0.0, 2.5), (4.0, 15.5), (51.7, 71.5)],
    "px4_pym_ev": [(0.0, 4.0), (10.5, 17.5), (65.0, 86.2)],
}
# Requests that the recorded PX4 grants and the stand-in cannot: COMPONENT_METADATA has no codec (LEFT_OUT).
NOT_GRANTED = {(512, 397.0)}
PERIOD_S = {"px4_ev_frd": 1.2, "px4_pym_ev": 1.2}  # of the heartbeat, with its jitter
ON_DEMAND = {"EVENT", "COMMAND_ACK", "COMMAND_LONG", "PARAM_VALUE", "PARAM_ERROR", "AUTOPILOT_VERSION"}
FLIGHTS = pytest.mark.parametrize("flight", sorted(FACTS))


class Replay:
    """One recorded client, replayed."""

    def __init__(self, name):
        self.facts = FACTS[name]
        self.rig = Rig()
        self.rig.vision = False
        self.modes = []  # (recorded time, mode) at each change, straight from the commander
        self._clock = []  # (rig time, recorded time) at the start of each stretch
        self._actions = list(self.facts["client"])
        for stretch in STRETCHES[name]:
            self._play(*stretch)

    def recorded_s(self, rig_s):
        """The recording's time of an instant of the replay."""
        start = max((c for c in self._clock if c[0] <= rig_s + 1e-9), default=self._clock[0])
        return start[1] + rig_s - start[0]

    def sent(self, name):
        return [(self.recorded_s(t), m) for t, m in self.rig.messages(name)]

    def _play(self, begin_s, end_s):
        rig, facts = self.rig, self.facts
        self._clock.append((rig.time_s, begin_s))
        self._actions = [a for a in self._actions if a[0] >= begin_s]
        for _ in range(round((end_s - begin_s) / STEP_S)):
            now_s = self.recorded_s(rig.time_s + STEP_S)
            while self._actions and self._actions[0][0] <= now_s:
                self._act(self._actions.pop(0))
            rig.vision = facts["vision_s"][0] <= now_s <= facts["vision_s"][1]
            first, last = facts["setpoint_stream_s"]
            silent = any(a < now_s < b for a, b in facts["setpoint_gaps_s"])
            streaming = first <= now_s <= last and not silent
            rig.setpoint = (lambda now_s=now_s: self._setpoint(now_s)) if streaming else None
            rig.tick()
            mode = rig.vehicle.commander.mode
            if not self.modes or self.modes[-1][1] is not mode:
                self.modes.append((now_s, mode))

    def _act(self, action):
        _, kind, *rest = action
        if kind == "command":
            p = [math.nan if v is None else v for v in rest[1:]] + [math.nan] * 4
            self.rig.send(mavlink.MAVLink_command_long_message(1, 1, rest[0], 0, *p))
        elif kind == "read":
            self.rig.send(mavlink.MAVLink_param_request_read_message(1, 1, rest[0].encode(), -1))
        else:
            self.rig.send(mavlink.MAVLink_param_set_message(1, 1, rest[0].encode(), rest[1], rest[2]))

    def _setpoint(self, now_s):
        rows = [r for r in self.facts["setpoints"] if r[0] <= now_s] or self.facts["setpoints"][:1]
        mask, x, y, z, vx, vy, vz = rows[-1][1:]
        return mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, mask, x, y, z, vx, vy, vz, 0.0, 0.0, 0.0, 0.0, 0.0
        )


@pytest.fixture(scope="module")
def replays():
    """Each recorded client replayed once, when first asked for."""
    made = {}

    def get(name):
        if name not in made:
            made[name] = Replay(name)
        return made[name]

    return get


def within(recorded, stretches):
    return [row for row in recorded if any(a <= row[0] <= b for a, b in stretches)]


def changes(rows):
    out = []
    for t, value in rows:
        if not out or out[-1][1] != value:
            out.append((t, value))
    return out


@pytest.mark.slow
@FLIGHTS
def test_commands_are_answered_alike(replays, flight):
    replay = replays(flight)
    asked = [(a[2], a[3]) for a in within(replay.facts["client"], STRETCHES[flight]) if a[1] == "command"]
    expected = [(command, result) for _, command, result in within(replay.facts["acks"], STRETCHES[flight])]
    got = [(m.command, m.result) for _, m in replay.sent("COMMAND_ACK")]
    assert len(asked) == len(expected) == len(got)
    for (command, first), want, have in zip(asked, expected, got, strict=True):
        assert want[0] == have[0] == command
        if (command, first) not in NOT_GRANTED:
            assert have == want, f"command {command} with param1 {first}"


@pytest.mark.slow
@FLIGHTS
def test_heartbeats_tell_the_same_story(replays, flight):
    replay = replays(flight)
    story = changes((t, (m.base_mode, m.custom_mode, m.system_status)) for t, m in replay.sent("HEARTBEAT"))
    recorded = [(row[0], tuple(row[1:])) for row in within(replay.facts["heartbeats"], STRETCHES[flight])]
    assert [value for _, value in story] == [value for _, value in recorded]
    for (have_s, value), (want_s, _) in zip(story, recorded, strict=True):
        # Landing takes as long as the height needs; everything else is tied to the client's clock.
        slack_s = 2.5 if not value[0] & 128 and want_s > 30.0 else PERIOD_S[flight]
        assert have_s == pytest.approx(want_s, abs=slack_s), f"heartbeat {value}"


@pytest.mark.slow
@FLIGHTS
def test_heartbeats_are_never_sent_early_to_tell_of_a_change(replays, flight):
    replay = replays(flight)
    times = [t for t, _ in replay.rig.messages("HEARTBEAT")]
    gaps = [b - a for a, b in pairwise(times)]
    assert min(replay.facts["heartbeat_gap_s"]) > 0.95
    assert 0.95 < min(gaps) <= max(gaps) < 1.25


@pytest.mark.slow
@FLIGHTS
def test_landed_states_tell_the_same_story(replays, flight):
    replay = replays(flight)
    story = changes((t, m.landed_state) for t, m in replay.sent("EXTENDED_SYS_STATE"))
    recorded = within(replay.facts["landed"], STRETCHES[flight])
    assert [value for _, value in story] == [value for _, value in recorded]
    for (have_s, value), (want_s, _) in zip(story, recorded, strict=True):
        assert have_s == pytest.approx(want_s, abs=2.0 if value == 1 else 1.2), f"landed state {value}"


def mode_changes(replay, mode, after_s):
    return next(t for t, m in replay.modes if m is mode and t >= after_s)


@pytest.mark.slow
@pytest.mark.parametrize(("flight", "lost_s"), [("px4_ev_frd", 58.998), ("px4_pym_ev", 67.578)])
def test_offboard_is_lost_as_late_as_recorded(replays, flight, lost_s):
    replay = replays(flight)
    recorded = next(t for t in replay.facts["events_s"] if t > lost_s) - lost_s
    measured = mode_changes(replay, FlightMode.LAND, lost_s) - lost_s
    assert measured == pytest.approx(recorded, abs=0.12)


@pytest.mark.slow
@FLIGHTS
def test_a_companion_is_told_the_same_by_events_and_nothing_by_text(replays, flight):
    replay = replays(flight)
    recorded = within(replay.facts["events"], STRETCHES[flight])
    known = {number for _, number in recorded}
    frames = [(t, bytes(m.get_msgbuf())) for t, m in replay.sent("UNKNOWN_410")]
    got = [(t, int.from_bytes(frame[10:14], "little")) for t, frame in frames]
    got = [(t, number) for t, number in got if number in known or number in COMMANDER_EVENTS]
    assert [number for _, number in got] == [number for _, number in recorded]
    for (have_s, number), (want_s, _) in zip(got, recorded, strict=True):
        slack_s = 2.5 if number in (0x19638AC, 0x1F46777) else 0.5  # a landing takes what the height needs
        assert have_s == pytest.approx(want_s, abs=slack_s), f"event {number:X}"
    assert not replay.sent("STATUSTEXT")


@pytest.mark.slow
def test_disarming_in_the_air_is_refused_and_changes_nothing(replays):
    replay = replays("px4_pym_ev")
    asked_s = next(a[0] for a in replay.facts["client"] if a[1] == "command" and a[2:4] == [400, 0.0])
    (ack,) = [m for t, m in replay.sent("COMMAND_ACK") if m.command == 400 and abs(t - asked_s) < 0.005]
    assert ack.result == 1  # temporarily rejected, as recorded
    beats = [m for t, m in replay.sent("HEARTBEAT") if asked_s < t < asked_s + 5.0]
    assert beats
    assert all(m.base_mode & 128 for m in beats)


@pytest.mark.slow
def test_offboard_comes_back_with_the_setpoints(replays):
    replay = replays("px4_pym_ev")
    ((_, back_s),) = replay.facts["setpoint_gaps_s"]
    recorded = next(t for t in replay.facts["events_s"] if t > back_s) - back_s
    assert recorded < 0.1
    assert mode_changes(replay, FlightMode.OFFBOARD, back_s) - back_s < 0.1


@pytest.mark.slow
@FLIGHTS
def test_px4s_own_commands_are_the_same(replays, flight):
    replay = replays(flight)
    recorded = within(replay.facts["px4_commands"], STRETCHES[flight])
    got = [(t, m.command, m.confirmation) for t, m in replay.sent("COMMAND_LONG")]
    assert [row[1:] for row in got] == [tuple(row[1:]) for row in recorded]


@pytest.mark.slow
def test_parameters_have_the_same_values_bit_for_bit(replays):
    replay = replays("px4_ev_frd")
    got = {}
    for _, m in replay.rig.messages("PARAM_VALUE"):
        got.setdefault(m.param_id, (SimpleNamespace(raw=m.get_msgbuf()[10:14].hex()), m.param_type))
    for name, parameter, wire, kind in replay.facts["parameters"]:
        if name == "PARAM_ERROR":
            errors = [m for _, m in replay.rig.messages("PARAM_ERROR")]
            assert [m.param_id for m in errors] == [parameter]
            assert errors[0].error == 1
        elif parameter in got:
            value, got_kind = got.pop(parameter)
            assert (value.raw, got_kind) == (wire, kind), parameter
    assert got == {}


@pytest.mark.slow
def test_every_recorded_message_is_sent_or_left_out_for_a_reason(replays):
    sent = {m.get_type() for name in FACTS for _, m in replays(name).rig.sent}
    sent = {"EVENT" if name == "UNKNOWN_410" else name for name in sent}
    recorded = {message for facts in FACTS.values() for message in facts["messages"]}
    assert recorded - sent - set(LEFT_OUT) == set()
    assert sent & set(LEFT_OUT) == set(), "left out, yet sent"
    assert set(LEFT_OUT) <= recorded, "a reason for a message that PX4 does not send"
    assert all(len(reason) > 20 for reason in LEFT_OUT.values())
    assert sent - recorded == set(), "PX4 sends no such thing"


@pytest.mark.slow
@FLIGHTS
def test_rates_are_within_a_fifth(flight):
    facts = FACTS[flight]
    rig = Rig(flying_body=False)
    rig.run(0.1)
    for _, kind, *rest in facts["client"]:
        if kind == "command" and rest[0] == 511:
            assert rig.command(511, rest[1], rest[2]) == 0
    rig.run(3.0)
    begin_s = rig.time_s
    rig.run(21.0)
    times = {}
    for t, m in rig.sent:
        if t > begin_s and not (m.get_type() == "TIMESYNC" and m.tc1 != 0):
            times.setdefault(m.get_type(), []).append(t)
    for name, (_, recorded_hz) in facts["messages"].items():
        if name in LEFT_OUT or name in ON_DEMAND or recorded_hz == 0.0:
            continue
        have = times[name]
        measured_hz = (len(have) - 1) / (have[-1] - have[0])
        assert measured_hz == pytest.approx(recorded_hz, rel=0.2), name


def test_the_parameter_list_is_complete_and_quick():
    rig = Rig(flying_body=False)
    rig.run(0.1)
    rig.send(mavlink.MAVLink_param_request_list_message(1, 1))
    rig.run(1.0)
    rows = [m for _, m in rig.messages("PARAM_VALUE")]
    assert (rows[0].param_id, rows[0].param_index) == ("_HASH_CHECK", 65535)
    assert [m.param_index for m in rows[1:]] == list(range(rows[1].param_count))
    names = [m.param_id for m in rows[1:]]
    assert names == sorted(names)


def test_the_fixture_is_small():
    assert Path(__file__).with_name("px4_facts.json").stat().st_size < 30_000
