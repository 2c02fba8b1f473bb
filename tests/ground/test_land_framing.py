"""Each parser guard earns its place: without it more frames are lost."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.framing import Framer, Guards
from firmware_bridge.link import CONTROLLER, Link

ALL = Guards()
NONE = Guards(ignore_v1=False, idle_gap_s=None, check_header=False, search_again=False)
TRIALS = 250
FRAMES = 12


def velocity(rng: random.Random, k: int) -> wire.MAVLink_land_velocity_message:
    return wire.MAVLink_land_velocity_message(
        rng.getrandbits(32), rng.getrandbits(32), rng.randint(-800, 800), rng.randint(-800, 800), k, 1
    )


def losses(guards: Guards, period_s: float) -> list[int]:
    """Frames of 12 that did not come out on arrival after 16 random bytes, one figure a trial."""
    rng = random.Random(5)
    link = Link(CONTROLLER)
    out = []
    for _ in range(TRIALS):
        framer = Framer(guards)
        framer.feed(rng.randbytes(16), 0.0)
        lost = 0
        for k in range(FRAMES):
            raw = link.encode(velocity(rng, k))
            arrived = framer.feed(raw, 0.001 + k * period_s)
            lost += raw not in [f.raw for f in arrived]
        out.append(lost)
    return out


def test_nothing_is_lost_with_all_guards():
    assert max(losses(ALL, 0.05)) <= 1
    assert max(losses(ALL, 0.015)) <= 1


def test_plain_parser_loses_runs_of_frames():
    runs = sum(lost >= 4 for lost in losses(NONE, 0.05))
    assert runs / TRIALS > 0.03


def test_ignoring_the_old_start_byte_matters():
    assert sum(losses(replace(NONE, ignore_v1=True), 0.05)) < 0.7 * sum(losses(NONE, 0.05))
    assert sum(losses(replace(ALL, ignore_v1=False), 0.015)) > 10 * max(1, sum(losses(ALL, 0.015)))


def test_reset_on_an_idle_gap_bounds_the_loss_to_one_frame():
    assert max(losses(replace(NONE, idle_gap_s=0.020), 0.05)) == 1
    assert max(losses(NONE, 0.05)) >= 4


def test_header_check_matters_where_frames_come_too_fast_for_the_idle_gap():
    assert max(losses(replace(ALL, check_header=False), 0.015)) >= 4
    assert max(losses(ALL, 0.015)) <= 1


def cut_then_whole(guards: Guards, gap_s: float, cut: bytes, whole: bytes) -> list[bytes]:
    framer = Framer(guards)
    framer.feed(cut, 0.0)
    return [f.raw for f in framer.feed(whole, gap_s)]


def test_a_frame_after_a_truncated_one_is_found_again():
    link = Link(CONTROLLER)
    cut = link.encode(velocity(random.Random(1), 1))[:-4]
    whole = link.encode(velocity(random.Random(2), 2))
    assert cut_then_whole(ALL, 0.005, cut, whole) == [whole]
    assert cut_then_whole(replace(ALL, search_again=False), 0.005, cut, whole) == []


def test_a_short_frame_does_not_wait_for_the_rest_of_a_long_one():
    link = Link(CONTROLLER)
    cut = link.encode(wire.MAVLink_land_log_message(1, 0, b"x" * 50))[:12]
    estop = link.encode(wire.MAVLink_land_estop_message(7))
    assert cut_then_whole(ALL, 0.05, cut, estop) == [estop]
    assert cut_then_whole(replace(ALL, idle_gap_s=None), 0.05, cut, estop) == []


@given(st.binary(max_size=2000), st.integers(1, 97))
@settings(max_examples=150, deadline=None)
def test_random_bytes_make_no_frame(data, step):
    framer = Framer()
    frames = []
    for i in range(0, len(data), step):
        frames += framer.feed(data[i : i + step], i * 1e-4)
    assert frames == []


@pytest.mark.slow
@given(st.data())
@settings(max_examples=60, deadline=None)
def test_at_most_one_good_frame_is_lost_after_a_burst(data):
    """Frames at 50 Hz; a burst of any bytes, start bytes among them, falls before one of them."""
    nasty = st.sampled_from([0xFD, 0xFE, 0x00, 0xF3, 0xD2])
    burst = bytes(data.draw(st.lists(nasty | st.integers(0, 255), max_size=120)))
    link, framer = Link(CONTROLLER), Framer()
    rng = random.Random(len(burst))
    lost = 0
    for k in range(20):
        raw = link.encode(velocity(rng, k))
        noise = burst if k == 10 else b""
        lost += raw not in [f.raw for f in framer.feed(noise + raw, 0.02 * k * 0.95)]
    assert lost <= 1


@given(st.integers(0, 26), st.integers(1, 255))
@settings(max_examples=200, deadline=None)
def test_a_changed_byte_is_never_accepted(position, change):
    raw = bytearray(Link(CONTROLLER).encode(velocity(random.Random(3), 3)))
    raw[position % len(raw)] ^= change
    framer = Framer()
    assert framer.feed(bytes(raw), 0.0) + framer.feed(b"\x00" * 80, 0.001) == []


@given(st.lists(st.integers(1, 40), min_size=1, max_size=60))
@settings(max_examples=50, deadline=None)
def test_the_cut_of_the_stream_into_reads_does_not_matter(cuts):
    link, framer = Link(CONTROLLER), Framer()
    sent = [link.encode(velocity(random.Random(k), k)) for k in range(20)]
    stream, got, i, k = b"".join(sent), [], 0, 0
    while i < len(stream):
        n = cuts[k % len(cuts)]
        got += framer.feed(stream[i : i + n], 1e-4 * k)
        i, k = i + n, k + 1
    assert [f.raw for f in got] == sent
    assert (framer.bad_crc, framer.skipped_bytes) == (0, 0)


@pytest.mark.slow
def test_bit_errors_lose_frames_but_forge_none():
    """Bit error rate 1e-3: a frame of 27 bytes survives with (1 - 1e-3)^216 = 81 %."""
    rng, link, framer = random.Random(9), Link(CONTROLLER), Framer()
    good, total = 0, 4000
    for k in range(total):
        raw = link.encode(velocity(rng, k % 65536))
        damaged = bytearray(raw)
        bit = -1
        while (bit := bit + 1 + int(rng.expovariate(1e-3))) < 8 * len(raw):
            damaged[bit // 8] ^= 1 << bit % 8
        frames = framer.feed(bytes(damaged), 0.02 * k)
        assert all(f.raw == raw for f in frames)
        good += len(frames)
    assert good / total > 0.78
