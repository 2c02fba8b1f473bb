"""The tests on this computer reach every line and every branch of the C core."""

from __future__ import annotations

import pytest
from firmware_needs import need

from firmware_bridge.coverage import measure, read


def test_a_line_and_a_branch_that_were_missed_are_named():
    lines = [
        {"line_number": 3, "count": 2, "branches": [{"count": 1}, {"count": 0}]},
        {"line_number": 4, "count": 0, "branches": []},
    ]
    found = read({"lines": lines})
    assert found.missed == ["3 branch 1", "4"]
    assert (found.lines, found.lines_hit, found.branches, found.branches_hit) == (2, 1, 2, 1)


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_every_line_and_branch_of_the_core_is_reached():
    need("gcc")
    reports = measure()
    assert len(reports) >= 10
    assert {name: f.missed for name, f in reports.items() if f.missed} == {}
    assert sum(f.branches for f in reports.values()) > 250
