"""A recorded flight on the page: playing, stepping, seeking, and what a page gets of it."""

import sys

import pytest
from browser_rig import Tab, chromium, needs_chromium, served
from click.testing import CliRunner

from labr_autonomy.cli import main
from labr_autonomy.console.feed import Seen
from labr_autonomy.console.recording import RecordedFeed
from labr_autonomy.errors import BadInput
from labr_autonomy.record.flight_log import FlightLog


class HandClock:
    def __init__(self):
        self.at_s = 50.0

    def now_s(self):
        return self.at_s


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of the desk of `test_desk`, recorded for 4 s at 5 Hz."""
    from test_desk import CONFIG, FENCE, Rig, facts_of, np, plan

    folder = tmp_path_factory.mktemp("runs") / "recorded"
    folder.mkdir()
    rig = Rig(waits=False)
    try:
        with FlightLog(folder / "flight.mcap") as log:
            log.facts(rig.now_s, facts_of(CONFIG, "m", "run", [FENCE], np.array([0, 0, 0.12]), 0.0, 1))
            log.map(rig.now_s, np.array([[1.0, 2.0]]), 0.0)
            for i in range(20):
                rig.place[0] = 0.1 * i
                rig.tick(10)
                rig.desk.take_plan(plan(), rig.now_s)
                log.console(rig.now_s, rig.show())
    finally:
        rig.close()
    return folder


@pytest.fixture
def feed(run):
    clock = HandClock()
    made = RecordedFeed(run, clock)
    made.clock = clock
    return made


def at_x(feed, seen=None):
    feed.poll()
    return feed.news(seen or Seen())["state"]["pose"]["position_m"][0]


def test_it_plays_at_the_speed_that_is_set(feed):
    assert feed.length_s == pytest.approx(3.8)
    assert at_x(feed) == 0.0
    feed.clock.at_s += 1.0
    assert at_x(feed) == pytest.approx(0.5)
    feed.replay("speed", 2.0)
    feed.clock.at_s += 1.0
    assert at_x(feed) == pytest.approx(1.5)
    feed.clock.at_s += 100.0
    assert at_x(feed) == pytest.approx(1.9)
    feed.replay("play", None)  # at the end: from the beginning
    feed.clock.at_s += 0.01
    assert at_x(feed) == 0.0


def test_stepping_pauses_and_moves_by_one_state(feed):
    feed.replay("seek", 1.0)
    feed.replay("step", 1.0)
    first = at_x(feed)
    feed.clock.at_s += 5.0
    assert at_x(feed) == first
    feed.replay("step", -1.0)
    assert at_x(feed) == pytest.approx(first - 0.1)
    feed.replay("seek", -5.0)
    feed.replay("step", -1.0)
    assert at_x(feed) == 0.0


def test_a_page_gets_what_it_has_not_got(feed):
    seen = Seen()
    feed.replay("pause", None)
    first = feed.news(seen)
    assert {"facts", "state", "map", "replay"} <= set(first)
    assert first["facts"]["replay"] is True
    assert feed.news(seen) is None
    feed.replay("step", 1.0)
    assert "facts" not in feed.news(seen)


def test_a_run_without_states_is_refused(tmp_path):
    FlightLog(tmp_path / "flight.mcap").close()
    with pytest.raises(BadInput, match="holds no states"):
        RecordedFeed(tmp_path, HandClock())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], "is not there"),
        (["."], "has no flight.mcap"),
        ([".", "--check", "--repair"], "two things"),
        ([".", "--weights", "x"], "Add --check"),
        ([".", "--check"], "has no flight.mcap"),
        ([".", "--repair"], "no MCAP file"),
    ],
)
def test_bad_arguments_get_one_sentence(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, ["replay", *arguments])
    assert done.exit_code == 2
    assert words in done.stderr


@pytest.mark.slow
@pytest.mark.timeout(90)
@needs_chromium
def test_the_page_plays_scrubs_and_steps(run, tmp_path):
    with served(tmp_path, "replay", str(run)) as replay, chromium() as browser:
        replay.wait_for("Ctrl-C ends it", 30)
        tab = Tab(browser, replay.url).live()
        tab.until("labr.replay.playing && labr.replay.at_s > 0.2 || !labr.replay.playing")
        if tab.page.evaluate("labr.replay.playing"):
            tab.button("Pause").click()
        tab.until("!labr.replay.playing")
        tab.page.get_by_label("place in the recording").fill("2")
        tab.until("Math.abs(labr.replay.at_s - 2) < 0.01")
        tab.until("Math.abs(labr.state.pose.position_m[0] - 1.0) < 0.01")  # of that place, not of before
        before = tab.page.evaluate("labr.state.stamp_s")
        tab.button("one step on").click()
        tab.until(f"labr.state.stamp_s > {before}")
        tab.button("10x").click()
        tab.button("Play").click()
        tab.until("!labr.replay.playing && labr.replay.at_s > 3.7")
        assert tab.button("abort").count() == 0
        assert tab.errors == []
    assert replay.process.returncode == 0


def test_the_executive_does_not_import_the_web():
    import subprocess

    code = (
        "import sys, labr_autonomy.mission.executive, labr_autonomy.commands.operate\n"
        "print([m for m in sys.modules if m.split('.')[0] in ('nicegui', 'fastapi', 'starlette', 'uvicorn')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
