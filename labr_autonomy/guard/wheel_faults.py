"""What follows when the land controller stops the wheels by itself: rest, try again, in the end stay. Pure.

The controller latches a stalled or racing wheel, too high a current and a driver's fault until it is told to
let go. Whoever lets go at once and drives on burns a motor in short bursts.
"""

from __future__ import annotations

from dataclasses import dataclass

REST_S = 2.0  # between a fault and the next try
TRIES, WITHIN_S = 3, 60.0  # so many faults in so long a time are not chance


@dataclass(frozen=True, slots=True)
class State:
    """The faults of late."""

    latched: bool = False  # by the controller's newest word
    stamps_s: tuple[float, ...] = ()
    words: str = ""  # of the last one


def step(state: State, faults: tuple[str, ...], now_s: float) -> tuple[State, str]:
    """One look; the sentence says why the wheels have to rest, "" while they need not.

    Args:
        state: Of the last look.
        faults: Those that the controller has latched, in words.
        now_s: The present.
    """
    if len(state.stamps_s) < TRIES:  # after the last try nothing is forgotten
        recent = tuple(stamp for stamp in state.stamps_s if now_s - stamp < WITHIN_S)
        if faults and not state.latched:
            recent += (now_s,)
        state = State(bool(faults), recent, "; ".join(faults) or state.words)
    count = len(state.stamps_s)
    if count >= TRIES:
        return state, f"{state.words}, for the {count}rd time within {WITHIN_S:.0f} s: look at the wheels"
    if count and now_s - state.stamps_s[-1] < REST_S:
        return state, f"{state.words}; resting {REST_S:.0f} s before try {count + 1} of {TRIES}"
    return state, ""
