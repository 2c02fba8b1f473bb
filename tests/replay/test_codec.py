import json
import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from labr_autonomy.errors import BadInput
from labr_autonomy.guard.fence import Zone
from labr_autonomy.mission.pilot_io import Order
from labr_autonomy.mission.steps import Kind, OnFail, Step
from labr_autonomy.record.codec import differences, pack, unpack
from labr_autonomy.types import KeyPoints, Mode, SetPoint, Source

quick = settings(suppress_health_check=[HealthCheck.too_slow], deadline=None, max_examples=40)


def over_the_wire(value):
    return json.loads(json.dumps(pack(value), allow_nan=False))


def same(value):
    return pack(unpack(type(value), over_the_wire(value))) == pack(value)


@quick
@given(st.floats(), st.lists(st.floats(width=64), min_size=3, max_size=3))
def test_every_number_comes_back_to_the_last_bit(number, vector):
    array = np.array(vector)
    value = SetPoint(number, Mode.AIR, array, array, array, number, 0.1 + 0.2, -0.0)
    back = unpack(SetPoint, over_the_wire(value))
    assert np.float64(back.stamp_s).tobytes() == np.float64(number).tobytes() or math.isnan(number)
    assert back.position_m.tobytes() == array.tobytes()
    assert back.yaw_rate_rps == 0.1 + 0.2
    assert back.mode is Mode.AIR


def test_nested_values_enums_tuples_and_what_is_left_out():
    assert same(Step(Kind.GOTO, "a", np.array([1.0, 2, 3]), True, on_fail=OnFail.HOLD))
    assert same(Step(Kind.WAIT, "b"))
    assert same(Zone(((0.0, 0.1), (1.0, math.inf)), True))
    points = KeyPoints(np.zeros((5, 3)), np.array([True, False, True, True, False]), 0.3, Source.SEARCH)
    assert same(points)
    assert unpack(KeyPoints, over_the_wire(points)).air.dtype == np.bool_
    assert pack(Order.LAND) == 2


@dataclass
class Unknown:
    value: object


def test_what_nobody_knows_how_to_record_is_an_error_at_once():
    with pytest.raises(TypeError, match="recorded"):
        pack(Unknown(object()))


@pytest.mark.parametrize("damage", [{"kind": "fly"}, {"label": 5}, {"new_field": 1}, {"accept_m": "near"}])
def test_a_recording_of_another_version_is_refused_in_one_sentence(damage):
    packed = {**over_the_wire(Step(Kind.LAND, "land")), **damage}
    with pytest.raises(BadInput, match="Replay it with the version that recorded it"):
        unpack(Step, packed)


def test_differences_are_named_to_the_element():
    before = Step(Kind.GOTO, "a", np.array([1.0, 2, 3]))
    after = Step(Kind.GOTO, "b", np.array([1.0, 2, 3 + 1e-15]), accept_m=0.3)
    named = [path for path, _, _ in differences(pack(before), pack(after))]
    assert named == [
        "label",
        "goal_m[2]",
        "accept_m",
    ]
    assert list(differences(pack(before), over_the_wire(before))) == []
    nan = np.array([math.nan])
    assert list(differences(pack(nan), pack(nan.copy()))) == []
    assert next(differences(pack(np.zeros(2)), pack(np.zeros(3))))[0] == ".shape"
    assert list(differences([1], [1, 2]))
