from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labr_autonomy.air.clock_offset import LATE_FOR_S, WINDOW_S, ClockOffset

LATENCIES = st.lists(st.floats(0.0, 0.2), min_size=2, max_size=200)


def test_nothing_is_known_before_the_first_message():
    assert ClockOffset().offset_s is None


def test_the_fastest_message_sets_the_offset():
    c = ClockOffset()
    for i, latency in enumerate([0.020, 0.005, 0.030]):
        remote = i * 0.02
        stamp = c.local_s(remote, remote + 100.0 + latency)
    assert c.offset_s == pytest.approx(100.005)
    assert stamp == pytest.approx(100.0 + 0.04 + 0.005)


@given(LATENCIES, st.floats(-1e6, 1e6))
def test_stamps_never_fall_and_never_lie_after_the_arrival(latencies, offset):
    c, last, arrival = ClockOffset(), -math.inf, -math.inf
    for i, latency in enumerate(latencies):
        remote = i * 0.02
        arrival = max(arrival, remote + offset + latency)  # a link keeps the order
        stamp = c.local_s(remote, arrival)
        assert stamp is not None
        assert last - 1e-9 <= stamp <= arrival + 1e-9
        last = stamp


def test_a_repeated_or_overtaken_message_gives_nothing():
    c = ClockOffset()
    c.local_s(1.00, 5.0)
    assert c.local_s(1.00, 5.01) is None
    assert c.local_s(0.98, 5.02) is None
    assert c.resets == 0


def test_drift_is_followed_within_two_windows():
    c, drift = ClockOffset(), 100e-6
    for i in range(int(60.0 / 0.02)):
        now = i * 0.02
        c.local_s(now * (1.0 - drift), now)
    assert 0.0 <= 60.0 * drift - c.offset_s <= 2 * WINDOW_S * drift + 1e-6


def test_a_reboot_starts_anew_at_once():
    c = ClockOffset()
    for i in range(100):
        c.local_s(50.0 + i * 0.02, 100.0 + i * 0.02)
    assert c.local_s(0.5, 110.0) == pytest.approx(110.0)
    assert c.resets == 1


def test_a_reboot_soon_after_the_first_boot_is_noticed_within_a_second():
    c = ClockOffset()
    for i in range(10):  # heard from 0.0 to 0.2 s of its clock
        c.local_s(i * 0.02, 100.0 + i * 0.02)
    stamps = [c.local_s(0.3 + i * 0.02, 105.0 + i * 0.02) for i in range(60)]
    assert c.resets == 1
    assert stamps[-1] == pytest.approx(105.0 + 59 * 0.02)


def test_a_stall_of_the_link_is_no_reboot():
    c = ClockOffset()
    for i in range(50):
        c.local_s(i * 0.02, 100.0 + i * 0.02)
    held = [c.local_s(1.0 + i * 0.02, 103.0) for i in range(100)]  # 2 s of messages in one burst
    assert None not in held
    assert c.resets == 0
    assert held[0] == pytest.approx(101.0)


def test_late_messages_reset_only_when_they_last():
    c = ClockOffset()
    c.local_s(0.0, 100.0)
    c.local_s(0.1, 101.2)
    assert c.local_s(0.2, 101.2 + 0.9 * LATE_FOR_S) == pytest.approx(100.2)
    assert c.resets == 0
