"""The desk with a real pilot and real slots, on a robot that stands still."""

import json
import math
import os
from dataclasses import replace

import numpy as np
import pytest

from labr_autonomy.air.telemetry import AirState
from labr_autonomy.config import RobotConfig
from labr_autonomy.console import names
from labr_autonomy.console.requests import Kind, Request
from labr_autonomy.console.slot import JsonReader, JsonWriter
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.ground.state import GroundState
from labr_autonomy.guard.failsafe import Health, Reaction
from labr_autonomy.guard.fence import Zone
from labr_autonomy.mission.desk import PROBE_S, Desk
from labr_autonomy.mission.logbook import Logbook
from labr_autonomy.mission.operator import LINK_LATE_S, Stage
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.mission.pilot_io import Look, Order
from labr_autonomy.mission.portrait import facts_of
from labr_autonomy.mission.steps import Kind as StepKind
from labr_autonomy.mission.steps import Status, Step
from labr_autonomy.planner.messages import Motion, PlanRequest, PlanResult, Timings
from labr_autonomy.types import KeyPoints, Mode, Odometry, Pose, Source

CONFIG = RobotConfig()
FENCE = Zone(((-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0)), True, outset_m=0.3)
FIRST = Step(StepKind.GOTO, "goto first", np.array([3.0, 0.0, 0.0]))
SECOND = Step(StepKind.GOTO, "goto second", np.array([0.0, 3.0, 0.0]))
FRESH = dict.fromkeys(LINK_LATE_S, 0.02)
GROUND = GroundState(100.0, True, True, "drive", (), True, 20.5, 1.0, 0.0, 0.0, 0.02)
AIR = AirState(100.0, True, False, "hold", "on_ground", None, None, None, 20.5, 0.9, 1.0, 0.1, False)


def plan(sequence=1, probe=None):
    points = KeyPoints(np.array([[1.0, 0, 0.1], [2.0, 0, 1.0]]), np.array([False, True]), 0.2, Source.GKPN)
    return PlanResult(
        sequence, 99.9, None, points, None, Source.GKPN, math.nan, "", math.inf, False, True, True, Timings(),
        probe=probe,
    )  # fmt: skip


class Rig:
    def __init__(self, waits=True):
        self.now_s = 100.0
        self.said = []
        self.pilot = Pilot(CONFIG)
        self.pilot.load([FIRST, SECOND], [FENCE])
        self.record = Logbook(started_s=self.now_s)
        self.desk = Desk(CONFIG, self.pilot, self.record, self.said.append, waits=waits)
        known = facts_of(CONFIG, "m", "run", [FENCE], np.array([0, 0, 0.12]), 0.0, os.getpid())
        self.desk.open(os.getpid(), known, [FENCE], np.zeros(3), 0.0)
        self.console = self.make_console()
        self.sequence = 0
        self.ages = dict(FRESH)
        self.place = np.array([0.0, 0.0, CONFIG.body.below_m])
        self.actions = None
        self.tick()

    def make_console(self):
        return JsonWriter(names.request_slot(os.getpid()), {}, names.REQUEST_MAX, names.REQUEST_SLOTS)

    def close(self):
        self.desk.close()
        self.console.close()

    def odometry(self):
        pose = Pose(self.place.copy(), quaternion_from_rpy(0, 0, 0))
        return Odometry(self.now_s, pose, np.zeros(3), np.zeros(3), np.eye(6) * 1e-4)

    def tick(self, count=1):
        for _ in range(count):
            self.now_s += 0.02
            self.desk.poll(self.odometry(), self.ages, self.now_s)
            health = Health(self.pilot.mode, 0.05, 0.05, 0.02, 0.5, 0.1, 0, False, "", 0.9, 0.15)
            look = Look(self.odometry(), 0, 0, True, False, "hold", True, health, self.desk.order)
            self.actions = self.pilot.tick(look, self.now_s)
            self.desk.ticked(self.actions, self.odometry(), 0.001, self.now_s)

    def ask(self, kind, goal_m=None, page="A", age_s=0.05):
        self.sequence += 1
        request = Request(page, self.sequence, kind, self.now_s - age_s, goal_m)
        self.console.write(request.as_dict())
        self.tick()
        return self.answer()

    def answer(self):
        last = self.desk.lease.answers[-1]
        return last.verdict, last.reason

    def send_probe(self, sequence):
        motion = Motion(self.place, np.zeros(3), np.zeros(3), 0.0, 0.0, 0.0)
        pose = self.odometry().pose
        request = PlanRequest(sequence, 1, pose, pose, 0.0, motion, Mode.LAND, np.zeros(3), False, 0.0, 1.0)
        return self.desk.with_probe(request)

    def show(self):
        return self.desk.show(self.actions, self.odometry(), self.ages, GROUND, AIR, True, self.now_s)


@pytest.fixture
def rig():
    made = Rig()
    yield made
    made.close()


@pytest.fixture
def begun(rig):
    assert rig.ask(Kind.TAKE)[0] == "accepted"
    assert rig.ask(Kind.START)[0] == "accepted"
    return rig


def test_it_waits_for_start_and_start_needs_control(rig):
    assert rig.desk.order is Order.HOLD
    assert rig.ask(Kind.START) == ("refused", "nobody has control; take control first")
    rig.ask(Kind.TAKE)
    assert rig.ask(Kind.START)[0] == "accepted"
    assert rig.desk.order is Order.FLY
    assert rig.record.started_s == rig.now_s
    assert "operator: start" in rig.said


def test_waiting_does_not_use_up_the_missions_time(rig):
    rig.pilot._duration_s = 10.0
    rig.now_s += 1000.0
    rig.ask(Kind.TAKE)
    rig.ask(Kind.START)
    rig.tick(5)
    assert rig.pilot.steps.status is Status.RUNNING


def test_a_mission_without_a_console_begins_by_itself():
    made = Rig(waits=False)
    assert made.desk.order is Order.FLY
    made.close()


def test_nothing_begins_on_stale_links_and_the_refusal_has_figures(begun):
    begun.ask(Kind.PAUSE)
    begun.ages["depth"] = 1.5
    assert begun.ask(Kind.RESUME) == ("refused", "locked: depth 1.5 s old (limit 0.5 s)")
    assert begun.show()["locked"] == "depth 1.5 s old (limit 0.5 s)"
    assert begun.desk.order is Order.HOLD
    assert begun.ask(Kind.ABORT)[0] == "accepted"


def test_pause_and_resume(begun):
    assert begun.ask(Kind.PAUSE)[0] == "accepted"
    assert begun.desk.order is Order.HOLD
    assert begun.show()["mode"] == "HOLD"
    assert begun.ask(Kind.RESUME)[0] == "accepted"
    assert begun.desk.order is Order.FLY


def test_anybody_may_abort_and_twice_is_once(begun):
    assert begun.ask(Kind.ABORT, page="B")[0] == "accepted"
    assert begun.ask(Kind.ABORT, page="C")[0] == "accepted"
    assert begun.desk.order is Order.LAND
    assert begun.ask(Kind.RESUME)[1] == "the mission is coming to its end"


def test_skipping_goes_to_the_next_step_and_is_on_record(begun):
    assert begun.ask(Kind.SKIP)[0] == "accepted"
    assert begun.pilot.steps.index == 1
    assert [(leg.step.label, leg.outcome) for leg in begun.record.legs] == [("goto first", "skipped")]
    begun.ask(Kind.SKIP)
    begun.tick()
    assert begun.pilot.steps.status is Status.DONE


def test_return_drops_what_was_left(begun):
    assert begun.ask(Kind.RETURN)[0] == "accepted"
    assert [s.label for s in begun.pilot.steps_left()] == ["return (operator)"]


def test_land_now_lands_and_then_waits_for_resume(begun):
    assert begun.ask(Kind.LAND)[0] == "accepted"
    begun.tick(40)  # it stands on its wheels already: landed after the time at rest
    assert begun.desk.stage is Stage.PAUSED
    assert begun.ask(Kind.RESUME)[0] == "accepted"
    assert begun.actions.step is FIRST


def test_a_click_outside_the_fence_is_refused_with_the_distance(begun):
    verdict, reason = begun.ask(Kind.GOTO, (6.0, 0.0, None))
    assert verdict == "refused"
    assert reason == "(6.0, 0.0) puts the robot 1.30 m outside the fence"
    assert begun.actions.step is FIRST


def test_a_click_is_asked_of_the_planner_and_then_driven_to(begun):
    assert begun.ask(Kind.GOTO, (2.0, 1.0, None))[0] == "asked"
    assert begun.send_probe(1).probe_m[:2].tolist() == [2.0, 1.0]
    begun.desk.take_plan(plan(probe=""), begun.now_s)
    assert begun.answer()[0] == "accepted"
    begun.tick()
    assert begun.actions.step.label == "go to (2.0, 1.0) (operator)"
    assert begun.send_probe(2).probe_m is None
    begun.place[:2] = (2.0, 1.0)
    begun.tick(40)
    assert begun.desk.stage is Stage.PAUSED  # there it stays until the operator says so
    begun.ask(Kind.RESUME)
    assert begun.actions.step is FIRST


def test_a_click_without_a_way_is_refused_with_the_planners_reason(begun):
    begun.ask(Kind.GOTO, (2.0, 1.0, None))
    begun.send_probe(1)
    begun.desk.take_plan(plan(probe="the map shows no way there"), begun.now_s)
    assert begun.answer() == ("refused", "the map shows no way there")
    begun.tick()
    assert begun.actions.step is FIRST


@pytest.mark.parametrize(
    ("meanwhile", "stage"),
    [
        (lambda rig: rig.ask(Kind.PAUSE), Stage.PAUSED),
        (lambda rig: rig.ask(Kind.LAND), Stage.RUNNING),
        (lambda rig: rig.ask(Kind.RETURN), Stage.RUNNING),
        (lambda rig: rig.ask(Kind.ABORT, page="B"), Stage.ENDING),
        (lambda rig: rig.ask(Kind.TAKE, page="B"), Stage.RUNNING),
        (lambda rig: rig.ask(Kind.RELEASE), Stage.RUNNING),
        (lambda rig: rig.desk.interrupt(), Stage.PAUSED),
        (lambda rig: (rig.ages.update(vio=0.8), rig.tick()), Stage.RUNNING),
    ],
    ids=["pause", "land", "return", "abort", "taken over", "given back", "ctrl-c", "stale link"],
)
def test_what_happens_before_the_planner_answers_overrules_the_click(begun, meanwhile, stage):
    begun.ask(Kind.GOTO, (2.0, 1.0, None))
    asked = begun.sequence
    begun.send_probe(1)
    meanwhile(begun)
    begun.desk.take_plan(plan(probe=""), begun.now_s)
    assert begun.desk.stage is stage
    assert "go to (2.0, 1.0) (operator)" not in [s.label for s in begun.pilot.mission]
    (answer,) = (a for a in begun.desk.lease.answers if a.sequence == asked)
    assert answer.verdict == "refused"
    assert answer.reason


def test_the_answer_about_one_place_is_not_taken_for_another(begun):
    begun.ask(Kind.GOTO, (2.0, 1.0, None))
    begun.send_probe(7)
    begun.ask(Kind.GOTO, (2.0, -1.0, None))
    begun.desk.take_plan(plan(7, probe=""), begun.now_s)
    assert begun.answer()[0] == "asked"
    begun.send_probe(8)
    begun.desk.take_plan(plan(7, probe=""), begun.now_s)
    assert begun.answer()[0] == "asked"
    begun.desk.take_plan(plan(8, probe="the map shows no way there"), begun.now_s)
    assert begun.answer() == ("refused", "the map shows no way there")


@pytest.mark.parametrize("kind", [Kind.SKIP, Kind.RETURN, Kind.LAND, Kind.GOTO, Kind.PAUSE, Kind.RESUME])
@pytest.mark.parametrize("end", ["failed", "done", "failsafe"])
def test_nothing_revives_a_mission_that_is_over(begun, kind, end):
    """The executive ends soon; a robot that flew on would be left in the air."""
    pilot = begun.pilot
    if end == "failed":
        pilot.fail("the planner has died")
    elif end == "done":
        pilot.steps = replace(pilot.steps, status=Status.DONE)
    else:
        pilot.failsafe = replace(pilot.failsafe, reaction=Reaction.LAND)
    before = pilot.steps, pilot.mission
    goal = (2.0, 1.0, 1.2) if kind is Kind.GOTO else None
    assert begun.ask(kind, goal) == ("refused", "the mission is coming to its end")
    assert (pilot.steps.status, pilot.mission) == (before[0].status, before[1])
    assert begun.ask(Kind.ABORT)[0] == "accepted"


def test_a_planner_that_does_not_answer_is_not_waited_for(begun):
    begun.ask(Kind.GOTO, (2.0, 1.0, None))
    begun.tick(int(PROBE_S / 0.02) + 2)
    assert begun.answer()[0] == "refused"
    assert "did not answer within 1 s" in begun.answer()[1]


def test_a_height_above_the_ceiling_is_refused(begun):
    verdict, reason = begun.ask(Kind.GOTO, (2.0, 1.0, 9.0))
    assert verdict == "refused"
    assert "ceiling" in reason
    assert begun.ask(Kind.GOTO, (2.0, 1.0, 1.2))[0] == "accepted"
    assert begun.actions.step.in_air


def test_ctrl_c_holds_and_then_ends(begun):
    begun.desk.interrupt()
    assert begun.desk.order is Order.HOLD
    begun.desk.interrupt()
    assert begun.desk.order is Order.LAND


def test_the_shown_state_reaches_a_reader_and_is_small(begun):
    begun.desk.take_plan(plan(), begun.now_s)
    for i in range(100):
        begun.desk.noted(f"event {i} with some words", begun.now_s)
    state = begun.show()
    reader = JsonReader(names.state_slot(os.getpid()))
    assert reader.newest()[1] == json.loads(json.dumps(state))
    assert len(json.dumps(state)) < 16_000
    assert reader.meta["fences"][0]["outline_m"][0] == [-5.0, -5.0]
    assert state["plan"]["network"] == [[1.0, 0.0, 0.1, 0], [2.0, 0.0, 1.0, 1]]
    assert state["energy"]["left_j"] == pytest.approx(0.75 * CONFIG.energy.pack_j)
    assert state["energy"]["needed_j"] > 0
    reader.close()


def test_the_longest_mission_is_shown_around_the_present_step(begun):
    steps = [Step(StepKind.GOTO, f"goto (-12.25, {i}.125)", np.array([-12.253, i, 1.2])) for i in range(500)]
    begun.pilot.load(steps, [FENCE])
    for i in range(40):
        begun.desk.noted(f"event {i}: {'many words ' * 100}", begun.now_s)
    for index, first in ((0, 0), (30, 20), (499, 440)):
        begun.pilot.steps = replace(begun.pilot.steps, index=index)
        shown = begun.show()
        assert (shown["steps_first"], shown["steps_total"], len(shown["steps"])) == (first, 500, 60)
        assert [s["state"] for s in shown["steps"]].index("now") == index - first
    reader = JsonReader(names.state_slot(os.getpid()))
    assert reader.newest()[1]["leg"] == 499
    assert not any("not shown" in sentence for sentence in begun.said)
    reader.close()


def test_a_state_that_cannot_be_shown_is_said_once_and_ends_nothing(begun):
    for mode in ("x" * names.STATE_MAX, math.nan):
        begun.desk.ended(mode)
        begun.show()
    begun.tick()
    assert sum("not shown" in sentence for sentence in begun.said) == 1


def test_a_figure_that_is_not_one_becomes_null(begun):
    begun.ages["vio"] = math.inf
    assert begun.show()["links"]["vio"]["age_s"] is None


def test_a_charge_that_is_not_reported_is_unknown_and_not_full(rig):
    unreported = replace(AIR, battery_remaining=None)
    state = rig.desk.show(rig.actions, rig.odometry(), rig.ages, GROUND, unreported, True, rig.now_s)
    assert state["energy"]["left_j"] is None
    failed = {name: figure for name, passed, figure, _ in state["checks"] if not passed}
    assert failed["battery"] == "not reported"
    assert "an unknown charge" in failed["energy"]


def test_a_link_that_nobody_knows_is_shown_and_breaks_nothing(begun):
    begun.ages["radio"] = 0.1
    assert begun.show()["links"]["radio"]["age_s"] == 0.1
    assert begun.show()["locked"] == ""


def test_the_end_says_how_it_went(begun):
    begun.desk.ended("success: all items done")
    assert begun.show()["why"] == "success: all items done"


def test_garbage_in_the_slot_is_not_answered(rig):
    rig.console.write({"kind": "start"})
    rig.tick()
    assert rig.desk.lease.answers == ()
    assert rig.desk.stage is Stage.WAITING
