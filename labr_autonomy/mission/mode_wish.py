"""Which mode, land or air, mission, operator and failsafe ask for now. No I/O, no clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from labr_autonomy.guard import failsafe
from labr_autonomy.guard.failsafe import Reaction
from labr_autonomy.mission import steps
from labr_autonomy.mission.pilot_io import Look, Order
from labr_autonomy.mission.steps import Kind, Policy, Status, Step
from labr_autonomy.modes import decision
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.modes.transition import Phase
from labr_autonomy.planner.messages import PlanResult
from labr_autonomy.types import Mode, Odometry

SLOW_MPS = 0.3  # a robot that flies faster than this does not begin to come down


@dataclass(frozen=True, slots=True)
class Situation:
    """Where robot and mission are."""

    phase: Phase
    mode: Mode
    status: Status
    reaction: Reaction
    progress: steps.Outputs
    plan: PlanResult | None  # the newest one of the present step
    short: str = ""  # why a flight from here to the goal cannot be afforded


class ModeWish:
    """Keeps what was wished last, so that a hand-over under way is not turned round by a pause.

    Args:
        energy: Of land and air.

    Attributes:
        mode: The last wish.
        seeks: It is to come down and flies on to where there is room.
        refused: Why the flight that is due is not begun, "" while there is none or it may.
    """

    def __init__(self, energy: EnergyModel) -> None:
        self.mode = Mode.LAND
        self.refused = ""
        self.seeks = False
        self._energy = energy
        self._decision = decision.State()

    def step(self, at: Situation, look: Look, now_s: float, events: list[str]) -> Mode:
        """The mode that is asked for now; `events` gets the reason of a new wish."""
        step, driving = at.progress.step, at.phase is Phase.DRIVING
        self.refused = ""
        sought, self.seeks = self.seeks, False
        if at.reaction >= Reaction.LAND or look.order is Order.LAND:
            return Mode.LAND
        if step is None and at.status is Status.HOLDING:
            return at.mode
        if step is None or step.kind is Kind.LAND or step.policy is Policy.GROUND:
            wanted = self._down(at, step, look)
            if self.seeks and not sought:
                events.append("no room to come down here: looking for a place")
            return wanted
        held = look.order is Order.HOLD or at.reaction is Reaction.HOLD
        late = look.health.ground_age_s > failsafe.GROUND_LATE_S
        if (held or look.health.estop or late) and at.phase in (Phase.STOPPING, Phase.ARMING):
            return Mode.LAND  # a take-off that has not left the floor is called off
        if step.kind is Kind.WAIT or held:
            return at.mode if at.phase in (Phase.DRIVING, Phase.FLYING) else self.mode
        if step.policy is Policy.AIR:
            if driving and not (at.plan and at.plan.take_off_clear):
                return Mode.LAND
            share = 1.0 if at.mode is Mode.LAND else 0.5  # come down well inside, then stay down
            over_goal = not step.in_air and at.progress.distance_m < share * step.accept_m
            over_goal &= at.mode is Mode.LAND or (at.plan is not None and at.plan.landing_clear)
            self.mode = self._afforded(Mode.LAND if over_goal else Mode.AIR, at)
            return self.mode
        assert look.odometry is not None
        facts = _facts(at, step, look.odometry)
        if facts is not None:
            self._decision, wanted = decision.step(self._decision, facts, self._energy, now_s)
            if step.in_air:
                wanted = self._afforded(wanted, at)
            if wanted is not facts.mode and wanted is not self.mode:
                where = f"lift-off {facts.lift_off_m:.1f} m ahead, goal {facts.goal_distance_xy_m:.1f} m off"
                events.append(f"{wanted.value} wanted: {where}")
            self.mode = wanted
        return self.mode

    def _down(self, at: Situation, step: Step | None, look: Look) -> Mode:
        """To land: at once where it may, else in the air until a plan has found room and led there.

        A robot that cannot tell, because something has failed, comes down where it is.
        """
        may_look = at.phase is Phase.FLYING and at.reaction is Reaction.NONE and look.order is Order.FLY
        if not may_look or (step is not None and step.here):
            return Mode.LAND
        assert look.odometry is not None
        clear = at.plan is not None and at.plan.landing_clear
        self.seeks = at.plan is not None and not clear
        slow = float(np.hypot(*look.odometry.velocity_mps[:2])) < SLOW_MPS
        return Mode.LAND if clear and slow else Mode.AIR

    def _afforded(self, wanted: Mode, at: Situation) -> Mode:
        """The mode, unless it is a flight that the battery does not last for."""
        if wanted is Mode.LAND or at.phase is not Phase.DRIVING or not at.short:
            return wanted
        self.refused = at.short
        return Mode.LAND


def _facts(at: Situation, step: Step, odometry: Odometry) -> decision.Facts | None:
    """What is decided upon; None where nothing is to be decided."""
    plan = at.plan
    if plan is None or at.phase not in (Phase.DRIVING, Phase.FLYING) or step.goal_m is None:
        return None
    return decision.Facts(
        mode=at.mode,
        goal_in_air=step.in_air,
        goal_distance_xy_m=float(np.hypot(*(step.goal_m[:2] - odometry.pose.position_m[:2]))),
        lift_off_m=plan.lift_off_m,
        land_path_ends=plan.land_path_ends,
        take_off_clear=plan.take_off_clear,
        landing_clear=plan.landing_clear,
        speed_mps=float(np.hypot(*odometry.velocity_mps[:2])),
        hop=plan.hop,
    )
