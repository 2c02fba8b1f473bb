"""Which autopilots may be flown, and what each of them is told."""

import pytest

from labr_autonomy.air import ardupilot, px4
from labr_autonomy.air.families import ARDUPILOT, FAMILIES, FOLLOW_MODES, PX4
from labr_autonomy.air.telemetry import Message, air_state
from labr_autonomy.air.vehicle import WrongVehicle, check_release, check_vehicle, release_of
from labr_autonomy.errors import ExitCode
from labr_autonomy.guard.takeover import FOLLOWING

BEAT = {"type": 2, "autopilot": 12, "base_mode": 0x91, "custom_mode": 0x00060000, "system_status": 4}
AP_BEAT = {"type": 2, "autopilot": 3, "base_mode": 0xD9, "custom_mode": 4, "system_status": 4}
# AUTOPILOT_VERSION as recorded from PX4 1.18 and ArduCopter 4.7
PX4_VERSION = {"flight_sw_version": 17956992, "capabilities": 59647}
AP_VERSION = {"flight_sw_version": 67567616, "capabilities": 64495}


@pytest.mark.parametrize(
    ("system", "change", "words"),
    [
        (2, {}, "system id 2"),
        (1, {"autopilot": 0}, "a generic autopilot answers .* only PX4 and ArduPilot"),
        (1, {"autopilot": 99}, "MAV_AUTOPILOT 99"),
        (1, {"type": 1}, "fixed-wing plane, not a multicopter"),
        (1, {"type": 10}, "ground rover"),
        (1, {"type": 77}, "MAV_TYPE 77"),
    ],
)
@pytest.mark.parametrize("beat", [BEAT, AP_BEAT])
def test_any_other_vehicle_is_refused_as_bad_input(beat, system, change, words):
    with pytest.raises(WrongVehicle, match=words) as caught:
        check_vehicle(system, {**beat, **change}, "udpin://x:1", "LABR")
    assert caught.value.exit_code is ExitCode.BAD_INPUT


@pytest.mark.parametrize("vehicle", sorted(px4.MULTICOPTERS))
@pytest.mark.parametrize(("beat", "family"), [(BEAT, PX4), (AP_BEAT, ARDUPILOT)])
def test_a_multicopter_of_either_family_is_accepted(beat, family, vehicle):
    assert check_vehicle(1, {**beat, "type": vehicle}, "udpin://x:1", "LABR") is family


def test_recorded_releases_are_accepted():
    assert release_of(PX4_VERSION).text == "1.18.0"
    assert release_of(AP_VERSION).text == "4.7.0"
    check_release(PX4, release_of(PX4_VERSION), "x")
    check_release(ARDUPILOT, release_of(AP_VERSION), "x")


@pytest.mark.parametrize(
    ("family", "fields", "words"),
    [
        (PX4, {"flight_sw_version": 0x010D0300}, r"PX4 1\.13\.3 .* too old: EKF2_EV_CTRL came with 1\.14"),
        (ARDUPILOT, {"flight_sw_version": 0x04000700}, r"ArduPilot 4\.0\.7 .* too old"),
        (PX4, {"capabilities": 59647 & ~128}, "takes no local set-points"),
    ],
)
def test_a_firmware_that_lacks_something_is_refused_with_a_sentence(family, fields, words):
    with pytest.raises(WrongVehicle, match=words):
        check_release(family, release_of({**PX4_VERSION, **fields}), "x")


def test_a_build_without_a_version_number_is_not_called_old():
    check_release(PX4, release_of({**PX4_VERSION, "flight_sw_version": 0}), "x")


def test_the_guard_knows_the_modes_in_which_the_families_follow():
    assert FOLLOWING == FOLLOW_MODES
    for family in FAMILIES.values():
        assert family.imu in family.streams


# custom_mode values of the recorded ArduPilot flight
@pytest.mark.parametrize(
    ("number", "word"),
    [(0, "stabilize"), (4, "guided"), (9, "land"), (17, "brake"), (16, "position"), (99, "mode 99")],
)
def test_ardupilots_mode_numbers_have_words(number, word):
    assert ardupilot.mode_name(number) == word


def test_the_state_speaks_the_language_of_its_autopilot():
    state = air_state({"HEARTBEAT": Message(10.0, AP_BEAT)}, 10.0, 10.1)
    assert (state.mode, state.armed, state.lifts_by_command) == ("guided", True, True)
    state = air_state({"HEARTBEAT": Message(10.0, BEAT)}, 10.0, 10.1)
    assert (state.mode, state.armed, state.lifts_by_command) == ("offboard", True, False)
