import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from labr_autonomy.console.requests import Kind, Request, parse
from labr_autonomy.errors import BadInput

GOOD = {"page": "A1", "sequence": 3, "kind": "goto", "stamp_s": 12.5, "goal_m": [1, 2.5, None]}


def test_a_request_survives_the_wire():
    request = Request("A1", 3, Kind.GOTO, 12.5, (1.0, 2.5, None))
    assert parse(request.as_dict()) == request == parse(GOOD)


@pytest.mark.parametrize(
    "change",
    [
        {"page": ""},
        {"page": "x" * 41},
        {"page": "a\nb"},
        {"page": 5},
        {"sequence": 0},
        {"sequence": True},
        {"sequence": 1.5},
        {"sequence": 2**60},
        {"kind": "explode"},
        {"kind": None},
        {"stamp_s": math.nan},
        {"stamp_s": "now"},
        {"stamp_s": 10**400},
        {"goal_m": [1, -(10**400)]},
        {"stamp_s": True},
        {"goal_m": None},
        {"goal_m": [1]},
        {"goal_m": [1, 2, 3, 4]},
        {"goal_m": [1, math.inf]},
        {"goal_m": ["1", 2]},
        {"goal_m": [1, 20_000]},
    ],
)
def test_what_is_no_request_is_refused(change):
    with pytest.raises(BadInput):
        parse({**GOOD, **change})


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=8,
)


@settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(st.dictionaries(st.sampled_from([*GOOD, "other"]), json_values))
def test_nothing_but_a_request_or_a_refusal_comes_out(message):
    try:
        request = parse(message)
    except BadInput:
        return
    assert math.isfinite(request.stamp_s)
    assert (request.goal_m is None) == (request.kind is not Kind.GOTO)
