"""The air channel's latencies against a stand-in in a process of its own; figures are not judged here."""

import pytest

from sim.bench.air_latency import air_latency_rows

pytestmark = pytest.mark.sitl


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_both_figures_are_measured_and_nothing_is_counted_twice(kind):
    done = []
    rows = await air_latency_rows(kind, 1.0, done.append)
    assert [row["figure"] for row in rows] == ["round trip", "set-point to socket"]
    for row in rows:
        assert (row["channel"], row["endpoint"]) == ("air", kind)
        assert row["n"] + row["lost"] <= 51
        assert row["n"] > 5
        assert row["lost"] <= 5
        assert 0.0 < row["p50_ms"] <= row["p99_ms"] <= row["max_ms"]
    assert max(done) > 1.5
