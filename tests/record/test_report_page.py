from __future__ import annotations

import base64
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from conftest import T0_S, summary, write_log

from labr_autonomy.config import Camera
from labr_autonomy.errors import BadInput
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.record.pictures import project
from labr_autonomy.record.report import write_report
from labr_autonomy.record.run_data import read_run
from labr_autonomy.record.summary import write_summary

pytestmark = pytest.mark.slow  # each page draws its pictures anew


class Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.links, self.images, self.heads, self.words = [], [], [], []
        self._head = False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self._head = tag == "h2"
        if tag == "img":
            self.images.append(values["src"])
        self.links += [values[k] for k in ("href", "src", "srcset", "action") if k in values]
        assert tag not in ("script", "link", "iframe", "object")

    def handle_data(self, data):
        self.words.append(data)
        if self._head:
            self.heads.append(data)
            self._head = False


@pytest.fixture(scope="module")
def page(whole_run):
    return Page(write_report(whole_run).read_text())


def test_the_report_holds_every_part(page):
    parts = [
        "Top view",
        "Side view",
        "Energy",
        "Battery",
        "Legs",
        "Depth frames",
        "Loops",
        "What happened",
        "Made with",
    ]
    assert page.heads == parts
    text = " ".join(page.words)
    for words in (
        "Mission accomplished",
        "All 3 items are done.",
        "goto far_corner",
        "0.81, not used",
        "seed 1",
        "gkpn\u00a067\u00a0%, search\u00a033\u00a0%",
        "land + air",
    ):
        assert words in text
    assert len(page.images) == 5 + 6


def test_the_report_opens_offline(page):
    assert page.links
    assert all(link.startswith("data:image/") for link in page.links)


def test_pictures_are_pictures(page):
    for source in page.images:
        kind, data = re.fullmatch(r"data:image/([a-z+]+);base64,(.*)", source).groups()
        raw = base64.b64decode(data, validate=True)
        assert raw.startswith(b"\x89PNG" if kind == "png" else b"<?xml")


def test_the_page_is_small(whole_run):
    assert (whole_run / "report.html").stat().st_size < 3_000_000


def test_text_of_the_run_is_escaped(tmp_path):
    write_summary(replace(summary(), reason="<script>alert(1)</script>", mission="<b>x"), tmp_path)
    text = write_report(tmp_path).read_text()
    assert "<script>" not in text
    assert "&lt;script&gt;" in text


@pytest.mark.parametrize(
    "kept", [("summary.json",), ("flight.mcap",), ("flight.mcap", "map.npz"), ("summary.json", "truth.npz")]
)
def test_missing_files_leave_their_part_out(whole_run, tmp_path, kept):
    for name in kept:
        shutil.copy(whole_run / name, tmp_path)
    page = Page(write_report(tmp_path).read_text())
    assert ("Energy" in page.heads) == ("flight.mcap" in kept)
    assert ("Legs" in page.heads) == ("summary.json" in kept)
    assert "Top view" in page.heads


@pytest.mark.parametrize("name", ["flight.mcap", "truth.npz", "map.npz", "summary.json"])
def test_a_broken_file_is_named_and_the_rest_is_shown(whole_run, tmp_path, name):
    for other in ("flight.mcap", "summary.json", "truth.npz", "map.npz"):
        shutil.copy(whole_run / other, tmp_path)
    (tmp_path / name).write_bytes(b"\x00broken")
    text = " ".join(Page(write_report(tmp_path).read_text()).words)
    assert name in text


def test_a_refused_run_has_a_report(tmp_path):
    write_summary(
        replace(summary(), outcome="refused", reason="goal outside the fence", legs=[], start_m=None),
        tmp_path,
    )
    assert "Refused before it began" in write_report(tmp_path).read_text()


def test_missed_expectations_stand_on_top(tmp_path):
    write_summary(replace(summary(), expect_missed=["0.4 m in the air, expected at least 1"]), tmp_path)
    assert "Expectation missed: 0.4 m in the air" in write_report(tmp_path).read_text()


def test_a_folder_without_a_run_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match="no run folder"):
        write_report(tmp_path)


def test_a_killed_run_still_has_a_report(whole_run, tmp_path):
    raw = (whole_run / "flight.mcap").read_bytes()
    (tmp_path / "flight.mcap").write_bytes(raw[: len(raw) * 2 // 3])
    page = Page(write_report(tmp_path).read_text())
    assert "Top view" in page.heads
    assert "Outcome unknown" in page.words


def test_modes_follow_the_mode_messages(tmp_path):
    write_log(tmp_path / "flight.mcap", length_s=50, rate_hz=4, frames=0)
    estimate = read_run(tmp_path).estimate
    seconds = estimate.stamp_s - T0_S
    np.testing.assert_array_equal(estimate.air, (seconds >= 20) & (seconds < 42))


def test_truth_modes_may_be_words_or_numbers(tmp_path):
    for mode in (np.array(["land", "air"]), np.array([0, 1], dtype=np.int8), np.array([False, True])):
        np.savez(tmp_path / "truth.npz", stamp_s=[0.0, 1.0], position_m=np.zeros((2, 3)), mode=mode)
        write_summary(summary(), tmp_path)
        assert read_run(tmp_path).truth.air.tolist() == [False, True]


def test_pickles_in_a_run_folder_are_not_opened(tmp_path):
    write_summary(summary(), tmp_path)
    np.savez(tmp_path / "map.npz", occupied_xy=np.array([{"a": 1}], dtype=object))
    data = read_run(tmp_path)
    assert data.occupied_xy_m is None
    assert data.notes == ["flight.mcap is missing", "map.npz cannot be read"]


def test_points_are_projected_as_the_camera_sees_them():
    camera = Camera()
    message = {
        "position_m": [1.0, 2.0, 0.5],
        "quaternion": list(quaternion_from_rpy(0, 0, np.pi / 2)),  # looking along odom y
        "camera_in_body_m": [camera.x_m, 0.0, camera.z_m],
        "intrinsics": {"fx": 200.0, "fy": 200.0, "cx": 100.0, "cy": 50.0},
    }
    ahead = np.array([1.0, 2.0 + camera.x_m + 2.0, 0.5 + camera.z_m])
    east_is_right, below = ahead + np.array([0.5, 0, 0]), ahead - np.array([0, 0, 0.2])
    pixels, before = project(message, np.array([ahead, east_is_right, below, [1.0, -3.0, 0.5]]))
    assert before.tolist() == [True, True, True, False]
    np.testing.assert_allclose(pixels[:3], [[100, 50], [150, 50], [100, 70]], atol=1e-9)
