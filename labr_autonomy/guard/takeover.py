"""Who flies? Tells a takeover, a failsafe of the autopilot and lost set-points apart. Pure.

What was measured on PX4: when set-points stop it lands, calls its own state critical and keeps "offboard" as
the mode it was asked for; when they return it goes back to offboard by itself. When a pilot or a ground
station changes the mode, the mode asked for changes too. That it is critical stands in a heartbeat that may
come a second after the mode: where the mode asked for is told, it alone decides. ArduPilot tells no intention
and never comes back.

While arming, the autopilot is still on its way to the mode in which it follows. Somebody else is who asks for
a mode that is neither this one nor the one found at the start, or for any other mode once it has followed. A
message that overtook another on the link can look like that for a moment: it is believed after `SURE_S`, and
until then nothing is sent, so that nobody's choice is undone meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass

FOLLOWING = frozenset({"offboard", "guided"})  # the modes in which an autopilot obeys our set-points
FAILSAFES = frozenset({"land", "return", "hold"})  # where an autopilot that tells no intention goes by itself
RESUME_S = 2.5  # PX4 is back within 0.1 s of the first set-point; its word of it comes up to 1.2 s later
SURE_S = 0.3  # CURRENT_MODE comes every 0.05 s, and a link's jitter of 0.1 s may turn two of them round


@dataclass(frozen=True, slots=True)
class State:
    """Since when the autopilot has been in a failsafe of its own, and what it did while arming."""

    failsafe_since_s: float | None = None  # None while it follows
    found: str = ""  # the mode that was asked for when arming began
    followed: bool = False  # it has been asked to follow since
    other_since_s: float | None = None  # since when somebody seems to want another mode

    @property
    def in_doubt(self) -> bool:
        """Somebody else may be about to fly: nothing may be sent."""
        return self.other_since_s is not None


@dataclass(frozen=True, slots=True)
class Inputs:
    """The autopilot's word."""

    flying: bool  # rotors are ours to command
    mode: str  # "unknown" while its link is silent: that is not somebody else
    intended: str  # mode that it was asked for; "" where the autopilot does not tell
    critical: bool  # it calls its own state critical; may lag the mode by a heartbeat
    landing_asked: bool  # we asked it to land
    restarted: bool  # its clock began anew since it took off, or since arming began
    resumes: bool = True  # it comes back by itself after lost set-points (PX4)
    arming: bool = False  # on the floor, on the way to the first set-point that lifts


def step(state: State, i: Inputs, now_s: float) -> tuple[State, str]:
    """One look; the sentence says why we must yield, "" while we need not.

    A mode that somebody else chose is yielded to, in flight at once. A failsafe of the autopilot's own gets
    the time to end by itself, as when set-points were lost and have returned; then it is followed too.
    """
    if not (i.flying or i.arming):
        return State(), ""
    if i.restarted:
        return State(), f"the autopilot restarted {'in flight' if i.flying else 'while arming'}"
    if i.mode == "unknown":
        return state, ""
    if not i.flying:
        return _arming(state, i, now_s)
    if i.mode in FOLLOWING or (i.landing_asked and i.mode == "land"):
        return State(), ""
    if not (i.resumes and _own(i)):
        return State(), _somebody(i.mode)
    since_s = now_s if state.failsafe_since_s is None else state.failsafe_since_s
    if now_s - since_s <= RESUME_S:
        return State(since_s), ""
    return State(since_s), f"the autopilot's own failsafe went to {i.mode}"


def _arming(state: State, i: Inputs, now_s: float) -> tuple[State, str]:
    asked = i.intended or i.mode
    found = state.found or asked
    if asked in FOLLOWING or _own(i):  # a failsafe of its own on the floor: the arming runs out of time
        return State(found=found, followed=state.followed or asked in FOLLOWING), ""
    if asked == found and not state.followed:
        return State(found=found), ""
    since_s = now_s if state.other_since_s is None else state.other_since_s
    after = State(found=found, followed=state.followed, other_since_s=since_s)
    return after, _somebody(i.mode) if now_s - since_s >= SURE_S else ""


def _own(i: Inputs) -> bool:
    """Its own failsafe, not a mode that somebody asked for."""
    return i.intended in FOLLOWING or (not i.intended and i.critical and i.mode in FAILSAFES)


def _somebody(mode: str) -> str:
    return f"somebody else took over: the autopilot is in {mode}"
