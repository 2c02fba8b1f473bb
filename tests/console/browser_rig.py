"""A flight with its console in a process of its own, and a headless Chromium that looks at it."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

LABR = [sys.executable, "-m", "labr_autonomy"]
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader"]  # WebGL without a graphics card
LAG = """
window.lag_s = 0; window.last_s = performance.now() / 1000;
setInterval(() => { const now = performance.now() / 1000;
  window.lag_s = Math.max(window.lag_s, now - window.last_s - 0.02); window.last_s = now; }, 20);
"""

needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (see .ci/run)")


def artefacts(tmp_path: Path) -> Path:
    """Where screenshots are kept: what LABR_ARTEFACTS names, else with the test's files."""
    folder = Path(os.environ.get("LABR_ARTEFACTS", tmp_path)) / "console"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


class Served:
    """A command that serves the page."""

    def __init__(self, process, log: Path) -> None:
        self.process = process
        self.log = log

    def text(self) -> str:
        return self.log.read_text()

    def wait_for(self, words: str, timeout_s: float) -> None:
        deadline = time.monotonic() + timeout_s
        while words not in self.text():
            assert self.process.poll() is None, self.text()
            assert time.monotonic() < deadline, f"{words!r} was not said within {timeout_s:.0f} s"
            time.sleep(0.1)

    @property
    def url(self) -> str:
        return re.search(r"with control: (\S+)", self.text())[1]

    @property
    def viewer_url(self) -> str:
        return re.search(r"watching only: (\S+)", self.text())[1]

    def console_pid(self) -> int:
        """The process that serves the page."""
        for entry in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if b"labr_autonomy.console.server" in (entry / "cmdline").read_bytes():
                    parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
                    if parent == self.process.pid:
                        return int(entry.name)
        raise AssertionError("no console process was found")


@contextlib.contextmanager
def served(folder: Path, *arguments: str):
    """Run a labr-mission command that serves the page on a free port."""
    path = folder / "served.log"
    with path.open("w") as stream:
        process = subprocess.Popen(
            [*LABR, *arguments, "--port", "0"], stdout=stream, stderr=subprocess.STDOUT, cwd=folder
        )
    try:
        yield Served(process, path)
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(timeout=60)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@contextlib.contextmanager
def chromium():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        try:
            yield browser
        finally:
            browser.close()


class Tab:
    """One page, and whatever went wrong on it."""

    def __init__(self, browser, url: str, size=(1280, 800), scheme="light") -> None:
        self.context = browser.new_context(
            viewport={"width": size[0], "height": size[1]}, color_scheme=scheme
        )
        self.errors = []
        self.page = self.context.new_page()
        self.page.set_default_timeout(20_000)
        self.page.add_init_script(LAG)
        self.page.on("console", lambda m: self.errors.append(m.text) if m.type == "error" else None)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.requests = []
        self.page.on("request", lambda r: self.requests.append(r.url))
        self.page.goto(url)

    def live(self):
        self.page.wait_for_selector(".cockpit.is-live")
        return self

    def button(self, words: str, *, exact: bool = False):
        return self.page.get_by_role("button", name=words, exact=exact)

    def says(self, words: str, timeout_s: float = 20.0) -> None:
        self.page.get_by_text(words).first.wait_for(timeout=timeout_s * 1000)

    def until(self, condition: str, timeout_s: float = 20.0) -> None:
        """Wait for a condition on the page's own state, `labr`."""
        self.page.wait_for_function(condition, timeout=timeout_s * 1000, polling=50)

    def press(self, words: str, until: str, *, exact: bool = False) -> None:
        """Press a button until its effect is seen."""
        from playwright.sync_api import TimeoutError as Late

        def pressed(_: str) -> None:
            with contextlib.suppress(Late):  # locked for the moment
                self.button(words, exact=exact).click(timeout=3000)

        self._repeat(pressed, until)

    def hold(self, words: str, until: str) -> None:
        """Hold a button until its effect is seen."""

        def held(effect: str) -> None:
            box = self.button(words).bounding_box()
            self.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
            self.page.mouse.down()
            self.saw(effect, 3.0)
            self.page.mouse.up()

        self._repeat(held, until)

    def saw(self, condition: str, timeout_s: float) -> bool:
        """Whether a condition on the page's own state came true in time."""
        from playwright.sync_api import TimeoutError as Late

        try:
            self.until(condition, timeout_s)
        except Late:
            return False
        return True

    def _repeat(self, act, until: str, timeout_s: float = 40.0) -> None:
        """On a slow machine a request may come too late, or be locked; one sees that, and repeats it."""
        deadline = time.monotonic() + timeout_s
        while True:
            asked = self.page.evaluate("labr.sequence")
            effect = f"({until}) || labr.sequence > {asked} && labr.answer?.verdict === 'refused'"
            act(effect)
            self.saw(effect, 5.0)
            if self.page.evaluate(until):
                return
            reason = self.page.evaluate("labr.answer?.reason || labr.lock || 'no answer'")
            assert time.monotonic() < deadline, f"asked for {timeout_s:.0f} s in vain: {reason}"

    def close(self) -> None:
        self.context.close()
