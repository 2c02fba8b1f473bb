"""What a comparison says, for people and for machines."""

import json

import numpy as np

from labr_autonomy.record.codec import differences, pack
from labr_autonomy.replay.verdict import Difference, Verdict


def test_its_json_is_json_also_when_a_figure_became_none():
    before, after = {"a": pack(np.array([1.0, 2.0]))}, {"a": pack(np.array([1.0, np.nan]))}
    found = [Difference("planner", "plan 3", *difference) for difference in differences(before, after)]
    verdict = Verdict(4, 200, found)
    said = json.loads(json.dumps(verdict.as_dict(), allow_nan=False))
    assert said["differences"] == [
        {"part": "planner", "where": "plan 3", "field": "a[1]", "recorded": 2.0, "now": {"float": "nan"}}
    ]
    assert "first: planner, plan 3: a[1] was 2, is nan" in verdict.sentence


def test_without_a_difference_it_says_how_much_was_compared():
    assert Verdict(4, 200).sentence == "4 plans and 200 ticks compared field by field: no difference"
