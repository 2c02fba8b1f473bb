"""What the operator sees while it flies: one live line on a terminal, plain log lines elsewhere.

The caller hands in a `LiveState` as often as it likes; the drawing is limited here, and costs under a
millisecond, so it can run on the executive's own loop.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType, TracebackType
from typing import Self, TextIO

from rich.console import Console
from rich.live import Live
from rich.text import Text

LIVE_PERIOD_S = 0.2
PLAIN_PERIOD_S = 2.0
AGE_WARN_S = 0.25  # a link older than this is shown in yellow
AGE_BAD_S = 1.0  # and in red
_STYLES = {"land": "bold dark_orange", "air": "bold dodger_blue1"}


@dataclass(frozen=True, slots=True)
class LiveState:
    """One look at the flight."""

    time_s: float  # since the run began
    mode: str  # "land", "air"
    phase: str  # "driving", "taking off", ...
    leg: int  # 1-based
    legs: int
    goal: str  # what the leg is called
    distance_m: float  # to the goal; nan when there is none
    energy_j: float
    link_ages_s: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    note: str = ""  # what the robot last said


class _Console(Console):
    """Does not end the program when its pipe breaks."""

    def on_broken_pipe(self) -> None:
        """Called by rich where it would raise SystemExit."""
        raise BrokenPipeError("the terminal is gone")


class LiveLine:
    """Shows the flight; use as a context manager.

    Args:
        stream: Where to write; standard error by default, so that stdout stays free for JSON.
        quiet: Show nothing at all.
        terminal: Whether `stream` is a terminal; found out by default.
    """

    def __init__(
        self, stream: TextIO | None = None, *, quiet: bool = False, terminal: bool | None = None
    ) -> None:
        self._console = _Console(file=stream or sys.stderr, force_terminal=terminal, highlight=False)
        self._quiet = quiet
        self._live: Live | None = None
        self._last: LiveState | None = None
        self._shown_s = -math.inf

    def __enter__(self) -> Self:
        """Open the line."""
        if not self._quiet and self._console.is_terminal:
            # no refresh thread: drawing happens in update() only
            self._live = Live(console=self._console, auto_refresh=False, transient=False)
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the last line standing."""
        if self._live is not None:
            if self._last is not None:
                self._live.update(render(self._last), refresh=True)
            self._live.stop()
            self._live = None

    def update(self, state: LiveState) -> bool:
        """Show a state if it is time to; True when something was drawn."""
        changed = self._last is None or _headline(state) != _headline(self._last)
        since_s = state.time_s - self._shown_s
        self._last = state
        if self._quiet:
            return False
        if self._live is not None:
            if since_s < LIVE_PERIOD_S:
                return False
            live = self._live
            self._draw(lambda: live.update(render(state), refresh=True))
        else:
            if not changed and since_s < PLAIN_PERIOD_S:
                return False
            self._plain(plain(state))
        self._shown_s = state.time_s
        return True

    def say(self, sentence: str, *, always: bool = False) -> None:
        """A line that stays, above the live line; also a quiet one says what must `always` be said."""
        if always or not self._quiet:
            self._plain(sentence)

    def _plain(self, sentence: str) -> None:
        self._draw(lambda: self._console.print(Text(sentence), soft_wrap=True))

    def _draw(self, draw: Callable[[], None]) -> None:
        """Draw; a terminal or pipe that is gone ends the drawing, never the flight."""
        try:
            draw()
        except OSError:
            self._quiet = True


def plain(state: LiveState) -> str:
    """One log line."""
    return "  ".join(part for part in (*_parts(state), _ages(state), state.note) if part)


def render(state: LiveState) -> Text:
    """The live line; colours only repeat what the words say."""
    clock, mode, leg, distance, energy = _parts(state)
    line = Text(overflow="ellipsis", no_wrap=True)
    line.append(clock, "dim").append("  ").append(mode, _STYLES.get(state.mode, "bold")).append("  ")
    line.append(leg).append("  ").append(distance, "bold").append("  ").append(energy, "yellow").append("  ")
    for name, age_s in state.link_ages_s.items():
        style = "red" if not age_s <= AGE_BAD_S else "yellow" if age_s > AGE_WARN_S else "dim"
        line.append(f"{name} {_age(age_s)} ", style)
    if state.note:
        line.append(" ").append(state.note, "italic")
    return line


def _parts(state: LiveState) -> tuple[str, str, str, str, str]:
    minutes, seconds = divmod(max(0.0, state.time_s), 60.0)
    mode = state.mode if state.phase in ("", state.mode) else f"{state.mode} {state.phase}"
    distance = f"{state.distance_m:.1f} m" if math.isfinite(state.distance_m) else "- m"
    energy = f"{state.energy_j / 1000.0:.1f} kJ" if state.energy_j >= 1000.0 else f"{state.energy_j:.0f} J"
    return (
        f"{int(minutes):02d}:{seconds:04.1f}",
        mode,
        f"{state.leg}/{state.legs} {state.goal}",
        distance,
        energy,
    )


def _headline(state: LiveState) -> tuple[str, str, int, str]:
    """What is worth a line of its own when it changes."""
    return state.mode, state.phase, state.leg, state.note


def _ages(state: LiveState) -> str:
    return " ".join(f"{name} {_age(age_s)}" for name, age_s in state.link_ages_s.items())


def _age(age_s: float) -> str:
    if not math.isfinite(age_s):
        return "none"
    return f"{age_s * 1000.0:.0f}ms" if age_s < 1.0 else f"{age_s:.1f}s"
