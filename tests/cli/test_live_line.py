from __future__ import annotations

import io
import math
from dataclasses import replace

from labr_autonomy.console.live import LIVE_PERIOD_S, PLAIN_PERIOD_S, LiveLine, LiveState, plain, render

STATE = LiveState(
    time_s=72.34,
    mode="land",
    phase="driving",
    leg=2,
    legs=5,
    goal="goto lookout",
    distance_m=3.456,
    energy_j=1234.0,
    link_ages_s={"px4": 0.012, "vio": 1.5, "depth": math.inf},
    note="round the table",
)


def at(time_s, **more):
    return replace(STATE, time_s=time_s, **more)


def test_the_words_of_a_line():
    expected = "01:12.3  land driving  2/5 goto lookout  3.5 m  1.2 kJ  "
    expected += "px4 12ms vio 1.5s depth none  round the table"
    assert plain(STATE) == expected
    assert "3.5 m" in render(STATE).plain


def test_unknown_distance_and_small_energy():
    text = plain(replace(STATE, distance_m=math.nan, energy_j=12.4, phase="land", note=""))
    assert "land  2/5 goto lookout  - m  12 J" in text


def test_stale_links_are_marked():
    styles = {span.style for span in render(STATE).spans}
    assert {"red", "dim"} <= styles


def test_without_a_terminal_a_line_comes_every_two_seconds_or_on_change():
    out = io.StringIO()
    with LiveLine(out, terminal=False) as line:
        shown = [line.update(at(i * 0.1)) for i in range(41)]
        assert [i for i, s in enumerate(shown) if s] == [0, 20, 40]
        assert line.update(at(4.1, mode="air", phase="taking off"))
        assert not line.update(at(4.2, mode="air", phase="taking off"))
        line.say("descending")
    lines = out.getvalue().splitlines()
    assert len(lines) == 5
    assert lines[-1] == "descending"
    assert "\x1b" not in out.getvalue()
    assert PLAIN_PERIOD_S == 2.0


def test_on_a_terminal_at_most_five_times_a_second():
    out = io.StringIO()
    with LiveLine(out, terminal=True) as line:
        shown = [line.update(at(i * 0.02)) for i in range(101)]  # two seconds at 50 Hz
    assert sum(shown) <= 2.0 / LIVE_PERIOD_S + 1
    assert sum(shown) >= 8
    assert "goto lookout" in out.getvalue()


def test_quiet_shows_nothing():
    out = io.StringIO()
    with LiveLine(out, quiet=True, terminal=True) as line:
        assert not line.update(STATE)
        line.say("x")
    assert out.getvalue() == ""


def test_markup_in_names_is_shown_as_it_is():
    out = io.StringIO()
    with LiveLine(out, terminal=False) as line:
        line.update(replace(STATE, goal="[bold]x[/bold]"))
    assert "[bold]x[/bold]" in out.getvalue()
