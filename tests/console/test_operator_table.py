import math

import pytest

from labr_autonomy.console.requests import Kind
from labr_autonomy.mission.operator import LINK_LATE_S, MOVING, ORDERS, TABLE, Stage, stale, step
from labr_autonomy.mission.pilot_io import Order

ASKED = [kind for kind in Kind if kind not in (Kind.TAKE, Kind.RELEASE, Kind.KEEP)]
FRESH = dict.fromkeys(LINK_LATE_S, 0.02)


def test_the_table_has_every_stage_and_every_request():
    assert set(TABLE) == {(stage, kind) for stage in Stage for kind in ASKED}
    assert set(ORDERS) == set(Stage)


@pytest.mark.parametrize("stage", Stage)
@pytest.mark.parametrize("kind", ASKED)
@pytest.mark.parametrize("late", [None, *LINK_LATE_S])
def test_nothing_begins_to_move_on_stale_links_and_stopping_never_waits(stage, kind, late):
    ages = FRESH if late is None else {**FRESH, late: LINK_LATE_S[late] + 0.1}
    after, refusal = step(stage, kind, ages)
    assert bool(refusal) or isinstance(TABLE[stage, kind], Stage)
    if refusal:
        assert after is stage
    if late is not None and kind in MOVING:
        assert refusal
        assert ORDERS[after] is ORDERS[stage]
    if kind is Kind.ABORT:
        assert (after, refusal) == (Stage.ENDING, "")
    if kind is Kind.PAUSE and stage is Stage.RUNNING:
        assert ORDERS[after] is Order.HOLD
    if stage is Stage.ENDING:
        assert after is Stage.ENDING
    if stage is Stage.WAITING and kind not in (Kind.START, Kind.ABORT):
        assert refusal


def test_what_is_stale_is_named_with_its_figures():
    assert stale({**FRESH, "depth": 1.25}) == "depth 1.2 s old (limit 0.5 s)"
    assert "vio" in stale({**FRESH, "vio": math.nan})
    assert stale(FRESH) == ""
