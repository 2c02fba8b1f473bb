"""The operator's desk in the executive: shows the flight to the console and carries out what it asks.

It never waits: the state goes into a slot in shared memory whether or not anybody looks, requests are looked
for in every tick, and a console that hangs or dies costs nothing.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from labr_autonomy.air.telemetry import AirState
from labr_autonomy.config import RobotConfig
from labr_autonomy.console import admission, names
from labr_autonomy.console.map_slot import TRAIL_MAX, MapWriter
from labr_autonomy.console.requests import Kind, Request, parse
from labr_autonomy.console.slot import JsonReader, JsonWriter, exists
from labr_autonomy.errors import BadInput, LinkError
from labr_autonomy.ground.state import GroundState
from labr_autonomy.guard.failsafe import Reaction
from labr_autonomy.guard.fence import Zone, margin_m
from labr_autonomy.mission import operator
from labr_autonomy.mission.budget import joules_to_finish
from labr_autonomy.mission.logbook import Logbook
from labr_autonomy.mission.operator import ORDERS, Stage
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.mission.pilot_io import Actions, Order
from labr_autonomy.mission.portrait import Body, Joules, portrait
from labr_autonomy.mission.preflight import Check, preflight
from labr_autonomy.mission.steps import Kind as StepKind
from labr_autonomy.mission.steps import OnFail, Status, Step
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.planner.messages import PlanRequest, PlanResult
from labr_autonomy.types import Array, Mode, Odometry

SHOW_S = 0.05
LOOK_FOR_CONSOLE_S = 0.3
PROBE_S = 1.0  # the planner answers within one cycle; after this it does not
TRAIL_STEP_M = 0.05
EVENTS_KEPT = 40
LATE_KEPT = 500  # ticks, 10 s

_CARRIED = {Kind.START, Kind.PAUSE, Kind.RESUME, Kind.SKIP, Kind.RETURN, Kind.LAND, Kind.GOTO, Kind.ABORT}


class Desk:
    """Stage of the mission, lease, and the slots.

    Args:
        config: The robot.
        pilot: Carries out what is asked.
        record: Learns of steps that are left.
        say: Puts a sentence on the events.
        waits: Begin only when the operator says so.
    """

    def __init__(
        self, config: RobotConfig, pilot: Pilot, record: Logbook, say: Callable[[str], None], *, waits: bool
    ) -> None:
        self._config, self._pilot, self._record, self._say = config, pilot, record, say
        self._energy = EnergyModel.of(config)
        self.stage = Stage.WAITING if waits else Stage.RUNNING
        self.lease = admission.State()
        self._zones: tuple[Zone, ...] = ()
        self._home_m: Array = np.zeros(3)
        self._floor_z_m = 0.0
        self._state: JsonWriter | None = None
        self._map: MapWriter | None = None
        self._asked: JsonReader | None = None
        self._asked_name = ""
        self._looked_s = -math.inf
        self._pause_after: Step | None = None
        self._probe: tuple[Request, Step, float] | None = None
        self._probe_sent: int | None = None  # the plan request that first carried it
        self._ages_s: Mapping[str, float] = {}
        self._events: deque[tuple[int, float, str]] = deque(maxlen=EVENTS_KEPT)
        self._said = 0
        self._trail: deque[tuple[float, float, float, float]] = deque(maxlen=TRAIL_MAX)
        self._late_ms: deque[float] = deque(maxlen=LATE_KEPT)
        self._cells = np.zeros((0, 2), np.float32)
        self._plan: PlanResult | None = None
        self._checks: list[Check] = []
        self._outcome = ""
        self._unshown = False
        self.note = ""

    # ------------------------------------------------------------------ opening and closing
    def open(self, pid: int, facts: Body, zones: Sequence[Zone], home_m: Array, floor_z_m: float) -> None:
        """Make the slots.

        Args:
            pid: Of this process.
            facts: What holds for the whole flight (`portrait.facts`).
            zones: Fences, which also bound what may be clicked.
            home_m: (3,) odom, where `return` goes.
            floor_z_m: Floor at home, odom.
        """
        self._zones, self._home_m, self._floor_z_m = tuple(zones), np.asarray(home_m), floor_z_m
        self._asked_name = names.request_slot(pid)
        self._map = MapWriter(names.map_slot(pid))
        self._state = JsonWriter(names.state_slot(pid), facts, names.STATE_MAX, names.STATE_SLOTS)

    def close(self) -> None:
        """Remove the slots."""
        for slot in (self._state, self._map, self._asked):
            if slot is not None:
                slot.close()
        self._state = self._map = self._asked = None

    @property
    def order(self) -> Order:
        """What the pilot is told."""
        return ORDERS[self.stage]

    def interrupt(self) -> None:
        """Ctrl-C: once holds, twice comes down and ends."""
        if self.stage is Stage.RUNNING:
            self.stage = Stage.PAUSED
            self._say("operator: hold (again to land and stop)")
            self._forget_probe("the operator said hold at the terminal")
        else:
            self.end()

    def end(self) -> None:
        """Come down and end."""
        if self.stage is not Stage.ENDING:
            self.stage = Stage.ENDING
            self._say("operator: land and stop")

    # ------------------------------------------------------------------ requests
    def poll(self, estimate: Odometry | None, ages_s: Mapping[str, float], now_s: float) -> bool:
        """Carry out what was asked since the last tick; True when anything was."""
        self._ages_s = ages_s
        self.lease, said = admission.expire(self.lease, now_s)
        if said:
            self._say(said)
        if self._probe is not None and now_s - self._probe[2] > PROBE_S:
            self._forget_probe(f"the planner did not answer within {PROBE_S:g} s; try again")
        asked = self._new_requests(now_s)
        for message in asked:
            try:
                request = parse(message)
            except BadInput:
                continue  # it is our own console that writes; whatever else gets there is not answered
            self.lease, outcome = admission.admit(self.lease, request, now_s)
            if outcome.say:
                self._say(outcome.say)
            if outcome.act is not None:
                self._carry_out(outcome.act, estimate, ages_s, now_s)
        if self._probe is not None and self._probe[0].page != self.lease.holder:
            self._forget_probe("the page that asked has lost control")
        return bool(asked)

    def _new_requests(self, now_s: float) -> list[Body]:
        if self._asked is None:
            if now_s - self._looked_s < LOOK_FOR_CONSOLE_S or not exists(self._asked_name):
                return []
            self._looked_s = now_s
            try:
                self._asked = JsonReader(self._asked_name)
            except LinkError:
                return []  # just being made, or not ours
        try:
            return self._asked.since()
        except BadInput:
            return []

    def _settle(self, request: Request, refusal: str = "", *, asked: bool = False) -> None:
        self.lease = admission.settle(self.lease, request, refusal, asked=asked)
        if not asked and request.kind in _CARRIED:
            what = f"operator: {request.kind.value}"
            self._say(f"{what} refused, {refusal}" if refusal else what)

    def _carry_out(
        self, request: Request, estimate: Odometry | None, ages_s: Mapping[str, float], now_s: float
    ) -> None:
        stage, refusal = operator.step(self._stage_now(), request.kind, ages_s)
        if refusal:
            self._settle(request, refusal)
            return
        self._forget_probe(f"{request.kind.value} came before the planner's answer")
        if request.kind is Kind.GOTO:
            self._go_to(request, now_s)
            return
        match request.kind:
            case Kind.START if self.stage is Stage.WAITING:
                self._record.begin(now_s)
                self._pilot.begin(now_s)
            case Kind.SKIP | Kind.RETURN | Kind.LAND:
                self._change_steps(request.kind, estimate, now_s)
            case _:
                pass
        self.stage = stage
        self._settle(request)

    def _stage_now(self) -> Stage:
        """The stage, which is the last one also when the mission itself is over: nothing revives it then."""
        over = self._pilot.steps.status in (Status.DONE, Status.FAILED)
        return Stage.ENDING if over or self._pilot.failsafe.reaction >= Reaction.LAND else self.stage

    def _change_steps(self, kind: Kind, estimate: Odometry | None, now_s: float) -> None:
        self._pause_after = None
        left = self._pilot.steps_left()
        if kind is Kind.SKIP:
            if left and estimate is not None:
                self._record.leave(left[0], estimate, now_s)
            self._pilot.skip(now_s)
        elif kind is Kind.RETURN:
            home = Step(StepKind.GOTO, "return (operator)", self._home_m.copy())
            self._pilot.insert([home], now_s, keep=False)
        else:
            here = Step(StepKind.LAND, "land now (operator)", on_fail=OnFail.HOLD, here=True)
            self._pause_after = here
            self._pilot.insert([here], now_s)

    # ------------------------------------------------------------------ go to a clicked place
    def _go_to(self, request: Request, now_s: float) -> None:
        assert request.goal_m is not None, "parse() gives every go-to its place"
        x, y, z = request.goal_m
        drive_z_m = self._pilot.floor_z_m + self._config.body.below_m
        body_z_m = drive_z_m if z is None else self._pilot.floor_z_m + z
        ceiling_m = self._config.air.height_max_m
        room_m = margin_m(self._zones, x, y, body_z_m)
        if room_m < 0.0:
            self._settle(request, f"({x:.1f}, {y:.1f}) puts the robot {-room_m:.2f} m outside the fence")
            return
        if z is not None and not self._config.body.below_m < z <= ceiling_m:
            self._settle(request, f"{z:.1f} m is not between the floor and the ceiling of {ceiling_m:g} m")
            return
        goal = np.array([x, y, self._pilot.floor_z_m + (z or 0.0)])
        words = f"go to ({x:.1f}, {y:.1f}{'' if z is None else f', {z:.1f}'}) (operator)"
        step = Step(StepKind.GOTO, words, goal, in_air=z is not None, on_fail=OnFail.SKIP)
        if z is not None:  # the map's ways are on the floor; in the air the planner finds out
            self._begin_going(request, step, now_s)
            return
        self._probe, self._probe_sent = (request, step, now_s), None
        self._settle(request, asked=True)

    def _forget_probe(self, why: str) -> None:
        """A place that is still being asked about is not gone to any more: what came since counts."""
        if self._probe is not None:
            request, self._probe = self._probe[0], None
            self._settle(request, why)

    def _begin_going(self, request: Request, step: Step, now_s: float) -> None:
        self._pilot.insert([step], now_s)
        self._pause_after = step
        self.stage = Stage.RUNNING
        self._settle(request)

    def with_probe(self, request: PlanRequest) -> PlanRequest:
        """The planner's next request, with the place that the operator asks about."""
        if self._probe is None:
            return request
        if self._probe_sent is None:
            self._probe_sent = request.sequence
        return replace(request, probe_m=self._probe[1].goal_m)

    def take_plan(self, result: PlanResult, now_s: float) -> None:
        """A plan came back, perhaps with the answer about a place."""
        self._plan = result
        if result.map_xy_m is not None:
            self._cells = result.map_xy_m
        if result.probe is None or self._probe is None:
            return
        if self._probe_sent is None or result.sequence < self._probe_sent:
            return  # the answer about a place that was asked for before
        request, step, _ = self._probe
        self._probe = None
        _, refusal = operator.step(self._stage_now(), request.kind, self._ages_s)  # as things stand now
        if refusal or result.probe:
            self._settle(request, refusal or result.probe)
        else:
            self._begin_going(request, step, now_s)

    # ------------------------------------------------------------------ after each tick
    def ticked(self, actions: Actions, estimate: Odometry, late_s: float, now_s: float) -> None:
        """Notice when the operator's own step is over, and remember the way."""
        self._late_ms.append(late_s * 1e3)
        ended = actions.reached or actions.failed
        if ended is not None and ended is self._pause_after:
            self._pause_after = None
            if self.stage is Stage.RUNNING:
                self.stage = Stage.PAUSED
                self._say("paused at the operator's place; resume goes on with the mission")
        x, y, z = (float(v) for v in estimate.pose.position_m)
        if not self._trail or math.dist(self._trail[-1][:3], (x, y, z)) > TRAIL_STEP_M:
            self._trail.append((x, y, z, float(actions.mode is Mode.AIR)))

    def ended(self, outcome: str) -> None:
        """The mission is over; the last state that is shown says how it went."""
        self._outcome = outcome

    def noted(self, sentence: str, now_s: float) -> None:
        """A sentence for the timeline."""
        self._said += 1
        self._events.append((self._said, now_s, sentence))
        self.note = sentence

    # ------------------------------------------------------------------ showing
    def show(
        self,
        actions: Actions,
        estimate: Odometry | None,
        ages_s: Mapping[str, float],
        ground: GroundState,
        air: AirState,
        logs_ok: bool,
        now_s: float,
    ) -> Body:
        """Publish the state; returns it as it went out."""
        joules = self._joules(estimate, ground, air)
        if self.stage is Stage.WAITING or not self._checks:  # afterwards they stand as they were at the start
            self._checks = preflight(
                self._config,
                ages_s=ages_s,
                ground=ground,
                air=air,
                sigma_m=math.inf if estimate is None else _sigma_m(estimate),
                energy_left_j=joules.left,
                energy_needed_j=joules.needed,
                logs_ok=logs_ok,
            )
        state = portrait(
            stamp_s=now_s,
            started_s=self._record.started_s,
            actions=actions,
            pilot=self._pilot,
            stage=self.stage,
            lease=self.lease,
            note=self.note,
            estimate=estimate,
            ages_s=ages_s,
            joules=joules,
            steps=self._pilot.mission,
            plan=self._plan,
            events=self._events,
            checks=self._checks,
            tick_late_ms=float(np.percentile(self._late_ms, 99)) if self._late_ms else 0.0,
            outcome=self._outcome,
        )
        if self._state is not None:
            try:
                self._state.write(state)
            except BadInput as error:  # the page's links turn red, and the flight goes on
                if not self._unshown:
                    self._say(f"the console is not shown the newest state: {error.what}")
                self._unshown = True
        return state

    def show_map(self) -> None:
        """Publish map and trail."""
        if self._map is not None:
            self._map.write(self._cells, np.array(self._trail, np.float32).reshape(-1, 4))

    def _joules(self, estimate: Odometry | None, ground: GroundState, air: AirState) -> Joules:
        left = math.nan if air.battery_remaining is None else air.battery_remaining
        above = np.maximum(0.0, left - self._config.energy.reserve) * self._config.energy.pack_j
        here = self._home_m if estimate is None else estimate.pose.position_m
        needed = joules_to_finish(self._pilot.steps_left(), here, self._pilot.mode, self._energy)
        power_w = ground.battery_v * ground.current_a
        return Joules(self._record.meter.energy_j, float(above), needed, ground.battery_v, power_w)


def _sigma_m(estimate: Odometry) -> float:
    """Standard deviation of the position, of all axes together."""
    return math.sqrt(max(0.0, float(np.trace(estimate.covariance[:3, :3])) / 3.0))
