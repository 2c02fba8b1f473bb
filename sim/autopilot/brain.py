"""What the autopilot stand-in believes, decides and flies, without a link: PX4's flight code in small."""

from __future__ import annotations

import math
from typing import Protocol

from sim.autopilot import commander, phase
from sim.autopilot.commander import CommanderInputs, CommanderState, Request, Result
from sim.autopilot.controller import Controller, Target, wanted_velocity
from sim.autopilot.estimator import Estimate, Estimator, Truth
from sim.autopilot.landing import landing_target
from sim.autopilot.modes import FlightMode
from sim.autopilot.parameters import Parameters
from sim.autopilot.phase import Phase, PhaseInputs, PhaseState
from sim.autopilot.vectors import Vector, ned_attitude
from sim.quad.state import QuadState

HOVER_N = 3.4 * 9.80665
DT_MAX_S = 0.02  # a pause of the simulation is no long step of the controller

Motors = tuple[float, ...]  # (4,) duty of front right, rear left, front left, rear right


class Pack(Protocol):
    """What the autopilot measures of the battery."""

    volts: float
    current_a: float

    @property
    def remaining(self) -> float:
        """Fraction left."""
        ...

    @property
    def used_j(self) -> float:
        """Energy given so far [J]."""
        ...


class Brain:
    """Estimator, commander and controller of one quad; its owner keeps the clock.

    A tick is `observe`, then whatever has arrived (`take_setpoint`, `estimator.fuse`, `ask`), then `decide`,
    then `fly`.

    Args:
        parameters: PX4's parameters by name.
    """

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self.estimator = Estimator()
        self.estimate = Estimate()
        self.commander = CommanderState()
        self.phase = PhaseState()
        self.controller = Controller()
        self.setpoint: Target | None = None
        self.target = Target()
        self.motors: Motors = (0.0, 0.0, 0.0, 0.0)
        self._now_s = 0.0
        self._setpoint_s = -math.inf
        self._landing_from: Vector | None = None  # where the descent began
        self._home_down_m = 0.0  # height it armed at
        self._truth: QuadState | None = None

    @property
    def armed(self) -> bool:
        """Whether the rotors may turn."""
        return self.commander.armed

    def observe(self, now_s: float, truth: QuadState) -> None:
        """Bring the estimate to `now_s` (time since boot)."""
        self._now_s, self._truth = now_s, truth
        self.estimate = self.estimator.step(truth_ned(now_s, truth))

    def take_setpoint(self, target: Target) -> None:
        """A set-point has come."""
        self.setpoint, self._setpoint_s = target, self._now_s

    def ask(self, asked: Request) -> Result:
        """Put one request to the commander."""
        was = self.commander
        self.commander, result = commander.request(was, asked, self.inputs(), self._now_s)
        if self.commander.armed and not was.armed:
            self._home_down_m = self.estimate.position_m[2]
        return result

    def decide(self) -> None:
        """Let the commander see the present."""
        self.commander = commander.step(self.commander, self.inputs(), self._now_s)

    def inputs(self) -> CommanderInputs:
        """What the commander sees."""
        setpoint = self.setpoint
        usable = False
        if setpoint is not None:
            needs_position = any(map(math.isfinite, setpoint.position_m))
            usable = self.estimate.position_valid if needs_position else self.estimate.velocity_valid
        body = self._truth.quaternion if self._truth is not None else (1.0, 0.0, 0.0, 0.0)
        upright = 1.0 - 2.0 * (float(body[1]) ** 2 + float(body[2]) ** 2)
        return CommanderInputs(
            setpoint_age_s=self._now_s - self._setpoint_s,
            loss_s=self.parameters["COM_OF_LOSS_T"],
            setpoint_usable=usable,
            landed=self.phase.landed(self._now_s),
            tilt_rad=math.acos(max(-1.0, min(1.0, upright))),
        )

    def fly(self, dt_s: float, truth: QuadState, pack: Pack) -> Motors | None:
        """Duties for the next `dt_s` [s]; None while disarmed."""
        self.target = self._wanted()
        climb = _climbs(self.estimate, self.target)
        self.phase = phase.step(
            self.phase,
            PhaseInputs(
                armed=self.armed,
                climb_wanted=climb < -0.05,
                descent_wanted=climb > 0.05 or self.controller.demand.thrust_n < 0.5 * HOVER_N,
                touching=truth.on_ground,
                speed_down_mps=-float(truth.velocity_mps[2]),
                lifted=not truth.on_ground or self.phase.thrust_share(self._now_s) > 1.5,
            ),
            self._now_s,
        )
        self.motors = self._duties(min(dt_s, DT_MAX_S), pack)
        return self.motors if self.armed else None

    def _duties(self, dt_s: float, pack: Pack) -> Motors:
        if self.phase.phase is Phase.DISARMED:
            self.controller.reset()
            return 0.0, 0.0, 0.0, 0.0
        share = self.phase.thrust_share(self._now_s)
        if share <= 0.0 or self.phase.cut(self._now_s):
            return tuple(self.controller.idle(pack.volts))
        return tuple(self.controller.step(dt_s, self.estimate, self.target, share=share, volts=pack.volts))

    def _wanted(self) -> Target:
        if self.commander.mode is FlightMode.LAND:
            if self._landing_from is None:
                self._landing_from = self.estimate.position_m
            return landing_target(self.estimate, self._landing_from, self._home_down_m, self.target)
        self._landing_from = None
        if self.commander.mode is FlightMode.OFFBOARD and self.setpoint is not None:
            return self.setpoint
        return Target()


def truth_ned(now_s: float, truth: QuadState) -> Truth:
    """True motion as the estimators of the stand-ins take it."""
    x, y, z = (float(v) for v in truth.position_m)
    vx, vy, vz = (float(v) for v in truth.velocity_mps)
    p, q, r = (float(v) for v in truth.angular_velocity_rps)
    return Truth(
        now_s, (y, x, -z), (vy, vx, -vz), ned_attitude(*(float(v) for v in truth.quaternion)), (p, -q, -r)
    )


def _climbs(now: Estimate, target: Target) -> float:
    """Speed downwards that the target asks for [m/s]; negative climbs."""
    down = wanted_velocity(now, target)[2]
    if math.isfinite(down):
        return down
    push = target.acceleration_mps2[2]
    return push if math.isfinite(push) else 0.0
