from __future__ import annotations

import numpy as np
import pytest

from sim.bench import statistics


def test_mean_and_share_by_hand():
    assert statistics.mean([1.0, 2.0, 6.0]) == 3.0
    assert statistics.mean([]) is None
    assert statistics.share_pct([True, False, True, True]) == 75.0
    assert statistics.share_pct([]) is None


def test_spl_by_hand():
    """Detour of a third, a failure, a way shorter than the shortest (body origin against outline), no way."""
    values = statistics.path_efficiency(
        [True, False, True, True], [9.0, 9.0, 9.0, 0.0], [12.0, 9.0, 8.0, 0.0]
    )
    assert values.tolist() == [0.75, 0.0, 1.0, 1.0]


def test_wilson_by_the_textbook():
    """Newcombe, Statistics in Medicine 17 (1998), table I, method 3."""
    assert statistics.wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert statistics.wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)
    assert statistics.wilson(1, 29) == pytest.approx((0.0061, 0.1718), abs=5e-5)


def test_bootstrap_of_little_is_nothing_and_of_equals_is_a_point():
    assert statistics.bootstrap_mean([], 0) is None
    assert statistics.bootstrap_mean([3.0], 0) is None
    assert statistics.bootstrap_mean([3.0, 3.0, 3.0], 0) == (3.0, 3.0)


def test_bootstrap_follows_from_its_seed():
    values = np.random.default_rng([1]).normal(size=40)
    assert statistics.bootstrap_mean(values, 7) == statistics.bootstrap_mean(values, 7)
    assert statistics.bootstrap_mean(values, 7) != statistics.bootstrap_mean(values, 8)


def test_bootstrap_is_the_same_in_pieces(monkeypatch):
    values = np.arange(10.0)
    whole = statistics.bootstrap_mean(values, 3)
    monkeypatch.setattr(statistics, "_CELLS_MAX", 95)
    assert statistics.bootstrap_mean(values, 3) == whole


def test_all_or_none_still_has_an_interval():
    low, high = statistics.share_interval_pct([True] * 20, 0)
    assert high == 100.0
    assert low == pytest.approx(100.0 - 16.11, abs=0.01)
    low, high = statistics.share_interval_pct([False] * 20, 0)
    assert (low, high) == (0.0, pytest.approx(16.11, abs=0.01))
    assert statistics.share_interval_pct([], 0) is None


def test_the_interval_covers_the_true_mean_about_as_often_as_it_says(monkeypatch):
    """400 samples of 30 from an exponential law: percentile intervals cover about 92 to 95 %."""
    monkeypatch.setattr(statistics, "RESAMPLES", 400)
    rng = np.random.default_rng([11])
    hits = 0
    for k in range(400):
        low, high = statistics.bootstrap_mean(rng.exponential(2.0, 30), k)
        hits += low <= 2.0 <= high
    assert 0.88 <= hits / 400 <= 0.975


def test_a_share_is_covered_too(monkeypatch):
    monkeypatch.setattr(statistics, "RESAMPLES", 400)
    rng = np.random.default_rng([12])
    hits = 0
    for k in range(400):
        low, high = statistics.share_interval_pct(rng.random(50) < 0.9, k)
        hits += low <= 90.0 <= high
    assert 0.86 <= hits / 400 <= 0.99
