"""What is tried, in which order, and that it ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from labr_autonomy.modes import recovery
from labr_autonomy.modes.recovery import Action, Facts, State

HERE = np.array([1.0, 2.0])
TICK_S = 0.1


def facts(**changes):
    base = Facts(HERE, 0.3, way=False, tight_way=False, gap_m=None, ahead_m=None, trail=True, may_hop=False)
    return replace(base, **changes)


class Run:
    """A robot that obeys or not."""

    def __init__(self, **known):
        self.state, self.now_s, self.seen = State(), 0.0, []
        self.place, self.yaw, self.known = HERE.copy(), 0.3, known

    def go(self, seconds, *, turns=True, drives=False, **known):
        self.known |= known
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            if turns and self.state.action is Action.LOOK:
                self.yaw = self.state.heading_rad
            if drives and self.state.action in (Action.SQUEEZE, Action.BACK, Action.FOLLOW):
                self.place = self.place + np.array([0.05, 0.0])
            self.state = recovery.step(
                self.state, facts(place_m=self.place.copy(), yaw_rad=self.yaw, **self.known), self.now_s
            )
            if not self.seen or self.seen[-1] is not self.state.action:
                self.seen.append(self.state.action)
        return self


def test_a_robot_that_moves_or_stands_for_a_moment_is_left_alone():
    run = Run(way=True).go(30.0, drives=True)
    assert run.seen == [Action.FOLLOW]
    assert Run(way=True).go(recovery.STANDS_S - 0.5).seen == [Action.FOLLOW]


def test_a_robot_that_turns_towards_its_way_is_left_alone_for_longer_but_not_for_ever():
    run = Run(way=True)
    for _ in range(round((recovery.TURNS_S - 0.5) / 0.5)):
        run.yaw += 0.5
        run.go(0.5)
    assert run.seen == [Action.FOLLOW]
    for _ in range(4):
        run.yaw += 0.5
        run.go(0.5)
    assert Action.LOOK in run.seen


def test_without_a_way_it_looks_all_round_and_follows_what_it_then_sees():
    run = Run().go(recovery.NO_WAY_S + 0.3)
    assert run.state.action is Action.LOOK
    run.go(0.2, way=True)
    assert run.state.action is Action.LOOK  # to its end, even so
    run.go(2.0)
    assert run.seen == [Action.FOLLOW, Action.LOOK, Action.FOLLOW]


def test_a_look_that_cannot_turn_ends_by_time():
    run = Run().go(recovery.NO_WAY_S + 0.2).go(recovery.LOOKS * recovery.LOOK_S + 1.0, turns=False)
    assert run.state.action is not Action.LOOK


def test_after_a_look_it_takes_a_tight_gap_and_goes_on_behind_it():
    run = Run(tight_way=True, gap_m=HERE + 0.5).go(2.0)
    assert run.state.action is Action.SQUEEZE
    run.go(2.5, drives=True, way=True)
    assert run.seen == [Action.FOLLOW, Action.LOOK, Action.SQUEEZE, Action.FOLLOW]
    assert run.state.tries == 0


def test_a_gap_that_does_not_let_it_through_is_closed_for_a_while_and_it_backs_off():
    gap = HERE + 0.5
    run = Run(tight_way=True, gap_m=gap).go(2.0 + recovery.STANDS_S + 0.5)
    assert run.state.action is Action.BACK
    assert run.state.closed[0].place_m == pytest.approx(gap)
    assert run.state.closed[0].until_s > run.now_s
    run.go(2.5, drives=True)
    assert run.state.action is not Action.BACK
    run.go(recovery.CLOSED_S + 1.0, drives=True, way=True)
    assert run.state.closed == ()


def test_it_hops_where_there_is_no_gap_at_all_and_room_above():
    run = Run(may_hop=True).go(3.0)
    assert run.seen == [Action.FOLLOW, Action.LOOK, Action.HOP]


def test_it_hops_after_two_gaps_in_vain():
    run = Run(tight_way=True, gap_m=HERE + 0.5, may_hop=True).go(60.0)
    assert Action.HOP in run.seen
    assert run.seen.index(Action.HOP) > run.seen.index(Action.SQUEEZE)


@pytest.mark.parametrize("tight", [False, True])
@pytest.mark.parametrize("trail", [False, True])
@pytest.mark.parametrize("hop", [False, True])
def test_it_gives_up_at_last_whatever_it_has(tight, trail, hop):
    gap = HERE + 0.5 if tight else None
    run = Run(tight_way=tight, gap_m=gap, trail=trail, may_hop=hop)
    run.go(recovery.SPENT_MAX_S + 60.0)
    assert run.state.action is Action.GIVE_UP
    assert run.state.tries <= recovery.TRIES_MAX + 1


def test_trouble_far_behind_is_forgotten():
    run = Run(tight_way=True, gap_m=HERE + 0.5).go(2.0 + recovery.STANDS_S + 0.5)
    assert run.state.tries == 1
    run.place = run.place + np.array([recovery.AWAY_M + 0.5, 0.0])
    run.go(0.5, way=True)
    assert run.state.tries == 0
    assert run.state.trouble_m is None


@pytest.mark.parametrize(("away_m", "shut"), [(1.0, True), (2.5, False)])
def test_who_stands_before_a_gap_that_proves_too_narrow_takes_another_way(away_m, shut):
    gap = HERE + np.array([away_m, 0.0])
    state = State()
    for k in range(60):
        state = recovery.step(state, facts(way=True, ahead_m=gap), 100.0 + 0.1 * k)
        if state.action is not Action.FOLLOW:
            break
    assert state.action is Action.LOOK
    assert bool(state.closed) is shut
    if shut:
        assert np.allclose(state.closed[0].place_m, gap)
