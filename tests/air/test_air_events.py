"""PX4's events: numbers as recorded from PX4 1.18, sentences for the operator."""

import pytest

from labr_autonomy.air.events import event_id, event_of
from labr_autonomy.air.report import Report
from labr_autonomy.air.telemetry import Message

# seen in px4_ev_frd and px4_pym_ev, at the moments that the names tell of
RECORDED = {
    "commander_armed_by": 0x190CAF3,
    "commander_disarmed_by": 0x1F46777,
    "commander_takeoff_detected": 0x1414569,
    "commander_landing_detected": 0x19638AC,
    "commander_failsafe_enter_generic": 0x1DEDBD0,
    "commander_arm_denied_resolve_failures": 0x102089D,
    "commander_disarm_denied_not_landed": 0x18AB9B5,
    "check_modes_global_pos": 0x198C273,
    "check_modes_offboard_signal_lost": 0x1AEEF7E,
    "check_modes_home_position": 0x1013630,
    "check_modes_mission": 0x105C2D9,
    "check_modes_manual_control": 0x106ED29,
    "check_rc_dl_no_dllink": 0x167C97B,
}
SUMMARY, LOST, GLOBAL, DENIED, ARMED, FAILSAFE = (
    (0x1A893E0, 0x88, "000000100180"),
    (0x1AEEF7E, 0x33, "0040000014"),
    (0x198C273, 0x33, "3800000018"),
    (0x102089D, 0x62, ""),
    (0x190CAF3, 0x66, "04"),
    (0x1DEDBD0, 0x42, "0000060007"),
)


def message(event, stamp_s=5.0):
    number, levels, arguments = event
    listed = list(bytes.fromhex(arguments).ljust(40, b"\0"))
    return Message(stamp_s, {"id": number, "log_levels": levels, "arguments": listed})


@pytest.mark.parametrize(("name", "number"), RECORDED.items())
def test_numbers_are_those_that_px4_sent(name, number):
    assert event_id(name) == number
    event = event_of(message((number, 0x33, "")).fields)
    assert event.name == name
    assert "event" not in event.text


def test_a_refused_arming_names_what_hinders_offboard_and_nothing_else():
    report = Report()
    said = [report.take("EVENT", message(e)) for e in (SUMMARY, LOST, GLOBAL, DENIED)]
    assert said == ["", "", "", "arming denied, its health checks fail"]
    assert report.reason(5.0) == "arming denied, its health checks fail; set-points have stopped"


def test_checks_that_pass_again_are_forgotten():
    report = Report()
    for event in (SUMMARY, LOST, SUMMARY, DENIED):
        report.take("EVENT", message(event))
    assert report.reason(5.0) == "arming denied, its health checks fail"


def test_a_failsafe_is_said_and_an_arming_is_not():
    report = Report()
    assert report.take("EVENT", message(FAILSAFE)) == "failsafe"
    assert report.take("EVENT", message(ARMED)) == ""


def test_an_unknown_event_is_named_by_its_number():
    assert Report().take("EVENT", message((0x1ABCDEF, 0x42, ""))) == "event 01ABCDEF"


def test_texts_of_ardupilot_count_from_warnings_on_and_grow_old():
    report = Report()
    assert report.take("STATUSTEXT", Message(1.0, {"severity": 6, "text": "EKF3 active"})) == ""
    assert report.take("STATUSTEXT", Message(2.0, {"severity": 2, "text": "Arm: Gyros inconsistent"}))
    assert report.reason(2.0) == "Arm: Gyros inconsistent"
    assert report.reason(5.5) == ""
