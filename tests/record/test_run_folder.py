from __future__ import annotations

import pytest

from labr_autonomy.errors import BadInput
from labr_autonomy.record.run_folder import make_run_folder, slug

NOON_S = 1_795_348_800.0  # 2026-11-22 12:00:00 UTC


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("First Flight", "first-flight"),
        ("../../etc", "etc"),
        ("***", "run"),
        ("a" * 90, "a" * 40),
        ("Ünïx 1", "n-x-1"),
    ],
)
def test_names_become_harmless(name, expected):
    assert slug(name) == expected


def test_two_runs_of_one_second_get_folders_of_their_own(tmp_path):
    first = make_run_folder("first flight", tmp_path / "runs", now_s=NOON_S)
    second = make_run_folder("first flight", tmp_path / "runs", now_s=NOON_S)
    assert [f.name for f in (first, second)] == [
        "20261122-120000-first-flight",
        "20261122-120000-first-flight-2",
    ]
    assert second.is_dir()


def test_a_file_in_the_way_is_bad_input(tmp_path):
    (tmp_path / "runs").write_text("")
    with pytest.raises(BadInput, match="runs"):
        make_run_folder("x", tmp_path / "runs", now_s=NOON_S)
