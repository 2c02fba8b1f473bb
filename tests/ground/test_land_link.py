from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.link import COMPUTER, CONTROLLER, Link, text_of

I16 = st.integers(-(2**15), 2**15 - 1)
U16 = st.integers(0, 2**16 - 1)
U32 = st.integers(0, 2**32 - 1)


@given(U32, U32, I16, I16, U16, st.integers(0, 3))
def test_velocity_round_trip(session, deadline, v, w, sequence, flags):
    sent = wire.MAVLink_land_velocity_message(session, deadline, v, w, sequence, flags)
    (got,) = Link(CONTROLLER).feed(Link(COMPUTER).encode(sent), 0.0)
    assert got.message.to_dict() == sent.to_dict()


def test_text_round_trip():
    sent = wire.MAVLink_land_log_message(3, wire.LAND_SEVERITY_ERROR, b"motor driver fault")
    (got,) = Link(COMPUTER).feed(Link(CONTROLLER).encode(sent), 0.0)
    assert text_of(got.message.text) == "motor driver fault"


def test_text_that_is_no_utf8_is_shown_all_the_same():
    assert text_of(b"a\xff\x00\x00") == "a\\xff"


def test_missing_frames_are_counted_by_sequence_over_the_wrap():
    here, there = Link(COMPUTER), Link(CONTROLLER)
    for k in range(600):
        frame = here.encode(wire.MAVLink_land_estop_message(k))
        if k not in (100, 255, 256, 257):
            there.feed(frame, 0.001 * k)
    assert (there.counters.good, there.counters.lost) == (596, 4)


def test_a_restarted_stream_counts_no_loss():
    here, there = Link(COMPUTER), Link(CONTROLLER)
    frames = [here.encode(wire.MAVLink_land_estop_message(k)) for k in range(5)]
    there.feed(frames[0], 0.0)
    there.restart()
    there.feed(frames[4], 1.0)
    assert there.counters.lost == 0


def test_frames_of_the_own_side_and_of_strangers_are_not_obeyed():
    echo = Link(CONTROLLER)
    assert echo.feed(Link(CONTROLLER).encode(wire.MAVLink_land_estop_message(1)), 0.0) == []
    assert echo.counters.foreign == 1


def test_raw_frame_is_kept_for_the_log():
    frame = Link(COMPUTER).encode(wire.MAVLink_land_estop_message(1))
    (got,) = Link(CONTROLLER).feed(b"\x01\x02" + frame, 0.0)
    assert got.raw == frame
