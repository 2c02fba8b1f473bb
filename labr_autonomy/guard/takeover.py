"""Who flies? Tells a takeover, a failsafe of the autopilot and lost set-points apart. Pure.

What was measured on PX4: when set-points stop it lands, calls its own state critical and keeps "offboard" as
the mode it was asked for; when they return it goes back to offboard by itself. When a pilot or a ground
station changes the mode, the mode asked for changes too. That it is critical stands in a heartbeat that may
come a second after the mode: where the mode asked for is told, it alone decides. ArduPilot tells no intention
and never comes back.
"""

from __future__ import annotations

from dataclasses import dataclass

FOLLOWING = frozenset({"offboard", "guided"})  # the modes in which an autopilot obeys our set-points
FAILSAFES = frozenset({"land", "return", "hold"})  # where an autopilot that tells no intention goes by itself
RESUME_S = 2.5  # PX4 is back within 0.1 s of the first set-point; its word of it comes up to 1.2 s later


@dataclass(frozen=True, slots=True)
class State:
    """Since when the autopilot has been in a failsafe of its own, None while it follows."""

    failsafe_since_s: float | None = None


@dataclass(frozen=True, slots=True)
class Inputs:
    """The autopilot's word."""

    flying: bool  # rotors are ours to command
    mode: str  # "unknown" while its link is silent: that is not somebody else
    intended: str  # mode that it was asked for; "" where the autopilot does not tell
    critical: bool  # it calls its own state critical; may lag the mode by a heartbeat
    landing_asked: bool  # we asked it to land
    restarted: bool  # its clock began anew since it took off
    resumes: bool = True  # it comes back by itself after lost set-points (PX4)


def step(state: State, i: Inputs, now_s: float) -> tuple[State, str]:
    """One look; the sentence says why we must yield, "" while we need not.

    A mode that somebody else chose is yielded to at once. A failsafe of the autopilot's own gets the time to
    end by itself, as it does when set-points were lost and have returned; then it is followed too.
    """
    if not i.flying:
        return State(), ""
    if i.restarted:
        return State(), "the autopilot restarted in flight"
    if i.mode == "unknown":
        return state, ""
    if i.mode in FOLLOWING or (i.landing_asked and i.mode == "land"):
        return State(), ""
    own = i.intended in FOLLOWING or (not i.intended and i.critical and i.mode in FAILSAFES)
    if not (i.resumes and own):
        return State(), f"somebody else took over: the autopilot is in {i.mode}"
    since_s = now_s if state.failsafe_since_s is None else state.failsafe_since_s
    if now_s - since_s <= RESUME_S:
        return State(since_s), ""
    return State(since_s), f"the autopilot's own failsafe went to {i.mode}"
