from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import summary

from labr_autonomy.errors import BadInput
from labr_autonomy.record.summary import percentiles, read_summary, versions, write_summary

REQUIRED = {
    *("outcome", "reason", "duration_s", "land_m", "air_m", "contacts", "min_clearance_m", "goal_errors_m"),
    *("energy_land_j", "energy_air_j", "energy_transition_j", "tick_late_ms", "plan_cycle_ms"),
    *("setpoint_age_ms", "seed", "versions"),
}


def test_every_key_of_the_contract_is_there(tmp_path):
    write_summary(replace(summary(), extra={"ticks": 3}), tmp_path)
    values = read_summary(tmp_path)
    assert set(values) >= REQUIRED
    assert set(values["tick_late_ms"]) == {"p50", "p99", "max"}
    assert values["ticks"] == 3
    assert values["legs"][1]["goal_m"] == [1.0, -2.1, 1.5]
    assert values["versions"]["labr_autonomy"] == versions()["labr_autonomy"]
    assert [f.name for f in tmp_path.iterdir()] == ["summary.json"]


def test_extra_figures_never_hide_the_contract():
    assert replace(summary(), extra={"outcome": "other"}).as_dict()["outcome"] == "success"


def test_figures_that_are_not_finite_become_null():
    odd = replace(summary(), min_clearance_m=math.inf, extra={"a": np.float32(1.5), "b": np.array([1, 2])})
    text = json.dumps(odd.as_dict(), allow_nan=False)
    values = json.loads(text)
    assert values["min_clearance_m"] is None
    assert (values["a"], values["b"]) == (1.5, [1, 2])


def test_percentiles():
    assert percentiles(range(101)) == {"p50": 50.0, "p99": 99.0, "max": 100.0}
    assert percentiles([2.0, math.nan, math.inf]) == {"p50": 2.0, "p99": 2.0, "max": 2.0}
    assert percentiles([]) == {"p50": None, "p99": None, "max": None}


@pytest.mark.parametrize("text", [None, "{", "[1]"])
def test_a_summary_that_cannot_be_read_is_bad_input(tmp_path, text):
    if text is not None:
        (tmp_path / "summary.json").write_text(text)
    with pytest.raises(BadInput):
        read_summary(tmp_path)
