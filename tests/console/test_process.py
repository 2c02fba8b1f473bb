"""The console's process: what is said when it does not come up, and how the command that serves it ends."""

import os
import signal
import subprocess
import sys
import tempfile
import urllib.request

import pytest
from click.testing import CliRunner

from labr_autonomy.cli import main
from labr_autonomy.console import process
from labr_autonomy.console.process import ConsoleOptions, ConsoleProcess
from labr_autonomy.errors import BadInput, LinkError


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("echo one >&2; echo 'no module of that name' >&2", "no module of that name"),
        ("exit 1", "without a word"),
    ],
)
def test_a_console_that_ends_at_once_is_an_error_with_its_own_last_words(
    tmp_path, monkeypatch, script, words
):
    python = tmp_path / "python"
    python.write_text(f"#!/bin/sh\n{script}\n")
    python.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(python))
    with pytest.raises(LinkError, match=f"ended before it was ready: {words}"):
        ConsoleProcess(ConsoleOptions(), pid=1, log_path=tmp_path / "log").__enter__()


def test_a_console_that_ends_later_is_an_error_too(tmp_path, monkeypatch):
    python = tmp_path / "python"
    ready = '{"event": "ready", "urls": ["a", "b"]}'
    python.write_text(f"#!/bin/sh\necho '{ready}'\necho 'out of memory' >&2\nexit 1\n")
    python.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(python))
    page = ConsoleProcess(ConsoleOptions(), pid=1, log_path=tmp_path / "log")
    with page, pytest.raises(LinkError, match="has ended: out of memory"):
        page.wait()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("place", ["__enter__", "wait"])
def test_a_command_that_is_told_to_end_cleans_up(tmp_path, monkeypatch, number, place):
    """Also while the page is still being started, and when the terminal goes."""
    ended = []

    class Stub(ConsoleProcess):
        def __enter__(self):
            self.urls = ("operator's", "viewer's")
            return self

        def wait(self):
            """Returns at once."""

    def told_to_end(_):
        os.kill(os.getpid(), number)
        ended.append("not")

    monkeypatch.setattr(process, "ConsoleProcess", Stub)
    monkeypatch.setattr(Stub, place, told_to_end)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "scratch"))
    (tmp_path / "scratch").mkdir()
    (tmp_path / "flight.mcap").touch()
    before = signal.signal(number, lambda *_: ended.append("by pytest's handler"))
    try:
        done = CliRunner().invoke(main, ["replay", str(tmp_path)])
    finally:
        signal.signal(number, before)
    assert ended == []
    assert done.exit_code == 0
    assert not list((tmp_path / "scratch").iterdir())


@pytest.mark.timeout(60)
def test_an_address_that_is_none_is_refused_before_anything_listens(tmp_path):
    page = ConsoleProcess(ConsoleOptions("foo", 0), pid=os.getpid(), log_path=tmp_path / "log")
    with pytest.raises(BadInput, match="'foo' is no IP address"):
        page.__enter__()


@pytest.mark.timeout(60)
def test_ctrl_c_at_the_terminal_leaves_the_page_alone(tmp_path):
    """The whole process group gets it; for the executive it means hold, and then the page is needed most."""
    with ConsoleProcess(ConsoleOptions(port=0), pid=os.getpid(), log_path=tmp_path / "log") as page:
        shown = page.urls[0].partition("#")[0]
        assert b"LABR console" in urllib.request.urlopen(shown, timeout=20).read()  # it serves
        os.kill(page.pid, signal.SIGINT)
        with pytest.raises(subprocess.TimeoutExpired):
            page._process.wait(timeout=2.0)
        assert b"LABR console" in urllib.request.urlopen(shown, timeout=10).read()
