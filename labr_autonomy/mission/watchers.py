"""Watches autopilot and wheels for what the pilot has to be told in words: who flies, what must rest."""

from __future__ import annotations

from labr_autonomy.air.telemetry import AirState
from labr_autonomy.guard import takeover, wheel_faults
from labr_autonomy.modes.transition import Phase

ROTORS_OURS = frozenset({Phase.LIFTING, Phase.FLYING, Phase.DESCENDING})  # entered following, as reported


class Watchers:
    """Remembers what it takes to tell."""

    def __init__(self) -> None:
        self._takeover = takeover.State()
        self._wheel_faults = wheel_faults.State()
        self._restarts_seen = 0  # of the autopilot, while it stood

    def taken_over(
        self, phase: Phase, landing_asked: bool, air: AirState, restarts: int, now_s: float
    ) -> str:
        """Why the autopilot no longer follows us, "" while it does.

        Args:
            phase: Of the hand-over.
            landing_asked: It was asked to land.
            air: The autopilot's word.
            restarts: How often it has restarted.
            now_s: The present.
        """
        flying, arming = phase in ROTORS_OURS, phase is Phase.ARMING
        if not (flying or arming):
            self._restarts_seen = restarts
        inputs = takeover.Inputs(
            flying=flying,
            mode=air.mode,
            intended=air.intended,
            critical=air.failsafe,
            landing_asked=landing_asked,
            restarted=restarts > self._restarts_seen,
            resumes=air.resumes,
            arming=arming,
        )
        self._takeover, sentence = takeover.step(self._takeover, inputs, now_s)
        return sentence

    @property
    def in_doubt(self) -> bool:
        """By the last call of `taken_over`, somebody else may be about to fly."""
        return self._takeover.in_doubt

    def wheel_fault(self, latched: tuple[str, ...], now_s: float) -> str:
        """Why the wheels have to rest, "" while they need not.

        Args:
            latched: Faults that the land controller keeps until it is told to let go, in words.
            now_s: The present.
        """
        self._wheel_faults, sentence = wheel_faults.step(self._wheel_faults, latched, now_s)
        return sentence
