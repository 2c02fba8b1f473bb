from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn import package
from labr_autonomy.gkpn.package import packaged_dir
from labr_autonomy.mission.load import FileProblems, load_mission, load_robot, parse_mission, parse_robot
from labr_autonomy.mission.schema import Goto, Land, OnFail, Point, Return, Wait, json_schema

MISSIONS = Path(__file__).resolve().parents[2] / "missions"
GOOD = """\
version: 1
name: good
places:
  desk: {x: 1, y: 2}
  shelf: {x: 1, y: 2, z: 1.2}
items:
  - goto: {x: 3, y: 4}
    accept: {radius_m: 0.5}
    timeout_s: 30
    on_fail: skip
  - goto: shelf
    mode: air
  - wait: {seconds: 2}
  - land: {}
  - return: {}
limits: {speed_mps: {ground: 0.5, air: 1}, height_max_m: 2, duration_s: 100}
fence:
  - {polygon: [[0, 0], [9, 0], [9, 9]], keep: in, z: [0, 3]}
  - {circle: {x: 5, y: 1, radius_m: 0.5}, keep: out}
energy: {reserve_pct: 20}
sim: {world: {family: hall, size_m: [14, 10]}, seed: 3, start: {x: 1, y: 1, yaw_deg: 90}}
expect: {outcome: success, contacts: 0, min_land_m: 3, min_air_m: 1}
"""


def problems(text: str) -> list[tuple[int, int, str, str]]:
    try:
        parse_mission(text.encode(), "m.yaml")
    except FileProblems as error:
        return [(p.line, p.col, p.message, p.hint) for p in error.problems]
    return []


def test_a_good_file_reads_as_written():
    m = parse_mission(GOOD.encode())
    assert [type(i) for i in m.items] == [Goto, Goto, Wait, Land, Return]
    first, second = m.items[:2]
    assert isinstance(first, Goto)
    assert isinstance(second, Goto)
    assert m.target(first) == Point(x=3, y=4)
    assert first.on_fail is OnFail.SKIP
    assert m.target(second).z == 1.2
    assert m.fence[0].polygon == [(0, 0), (9, 0), (9, 9)]
    assert m.sim is not None
    assert m.sim.world.spec() == {"family": "hall", "size_m": [14.0, 10.0]}


@pytest.mark.parametrize("path", sorted(MISSIONS.glob("*.yaml")), ids=lambda p: p.stem)
def test_the_missions_of_the_repository_are_good(path):
    assert load_mission(path).version == 1


@pytest.mark.parametrize(
    ("old", "new", "line", "col", "message", "hint"),
    [
        ("version: 1", "version: 2", 1, 10, "must be 1, not 2", ""),
        ("version: 1\n", "", 1, 1, "'version' is missing", ""),
        ("name: good", "name: 7", 2, 7, "needs text, not 7", ""),
        ("name: good", "nam: good", 2, 1, "unknown key 'nam'", "did you mean 'name'?"),
        ("{x: 3, y: 4}", "{x: 3}", 7, 5, "'y' is missing in 'goto'", ""),
        ("{x: 3, y: 4}", "{x: '3', y: 4}", 7, 15, "needs a number, not '3'", ""),
        ("{x: 3, y: 4}", "{x: true, y: 4}", 7, 15, "needs a number, not true", ""),
        ("{x: 3, y: 4}", "{x: 3, y: 4, z: 0.3}", 7, 27, "at least 0.4 m up (z is 0.3 m)", "leave z out"),
        ("{x: 3, y: 4}", "{x: 3, y: 4, zz: 1}", 7, 24, "unknown key 'zz'", "did you mean 'z'?"),
        ("{x: 3, y: 4}", "[3, 4]", 7, 11, "needs a block", ""),
        ("{x: 3, y: 4}", "{x: 3, y: 1e9}", 7, 21, "must be at most 10000", ""),
        ("- goto: shelf", "- goto: shelv", 11, 11, "no place is called 'shelv'", "did you mean 'shelf'?"),
        ("mode: air", "mode: flying", 12, 11, "must be 'auto', 'ground' or 'air', not 'flying'", ""),
        ("mode: air", "mode: ground", 11, 11, "mode 'ground' cannot reach 'shelf'", "leave z out"),
        ("on_fail: skip", "on_fail: skp", 10, 14, "must be 'stop', 'skip' or 'hold'", "did you mean 'skip'?"),
        ("radius_m: 0.5}\n", "radius_m: 0}\n", 8, 24, "must be more than 0 (is 0)", ""),
        ("timeout_s: 30", "timeout: 30", 9, 5, "unknown key 'timeout'", "did you mean 'timeout_s'?"),
        ("- wait: {seconds: 2}", "- wait: {seconds: -2}", 13, 21, "must be more than 0 (is -2)", ""),
        ("- wait: {seconds: 2}", "- wait: 2", 13, 11, "needs a block", ""),
        ("- wait: {seconds: 2}", "- wiat: {seconds: 2}", 13, 5, "unknown key 'wiat'", "did you mean 'wait'?"),
        ("- land: {}", "- land:", 14, 5, "needs a block", "write {}"),
        ("- land: {}", "- land: {fast: 1}", 14, 12, "unknown key 'fast'", "takes no keys"),
        ("- land: {}", "- {}", 14, 5, "an item needs one of", "for example"),
        ("- land: {}", "- {land: {}, wait: {seconds: 1}}", 14, 16, "one of 'goto', 'wait', 'land' or", "two"),
        ("- land: {}", "- hop", 14, 5, "an item needs one of", ""),
        ("- land: {}", "- {land: {}, mode: air}", 14, 16, "unknown key 'mode'", "known here"),
        ("keep: in,", "keep: inside,", 18, 47, "must be 'in' or 'out'", "did you mean 'in'?"),
        ("z: [0, 3]", "z: [3, 0]", 18, 54, "z is [lowest, highest]", ""),
        ("z: [0, 3]", "z: [3]", 18, 54, "needs at least 2 entries", ""),
        ("[[0, 0], [9, 0], [9, 9]]", "[[0, 0], [9, 0]]", 18, 15, "needs at least 3 entries (has 2)", ""),
        ("keep: out", "keep: out, polygon: [[0,0],[1,0],[1,1]]", 19, 5, "either a polygon or a circle", ""),
        ("reserve_pct: 20", "reserve_pct: 100", 20, 23, "must be less than 100 (is 100)", ""),
        ("{family: hall, size_m: [14, 10]}", "{}", 21, 14, "a world needs one of", ""),
        (
            "{family: hall, size_m: [14, 10]}",
            "{mesh: /etc/x.glb}",
            21,
            21,
            "below the worlds folder",
            "--worlds",
        ),
        (
            "{family: hall, size_m: [14, 10]}",
            "{file: ../x.yaml}",
            21,
            21,
            "below the worlds folder",
            "--worlds",
        ),
        ("{family: hall, size_m: [14, 10]}", "{file: x.glb}", 21, 21, "'x.glb' is not a .yaml file", ""),
        (
            "{family: hall, size_m: [14, 10]}",
            "{file: a.yaml, mesh: b}",
            21,
            29,
            "'family', 'mesh' or 'file'",
            "",
        ),
        (
            "{family: hall, size_m: [14, 10]}",
            "{mesh: a/../../x}",
            21,
            21,
            "below the worlds folder",
            "--worlds",
        ),
        ("seed: 3", "seed: 3.5", 21, 54, "needs a whole number, not 3.5", ""),
        ("seed: 3", "seed: .nan", 21, 54, "not a finite number", ""),
        ("outcome: success", "outcome: sucess", 22, 19, "must be 'success'", "did you mean 'success'?"),
        ("desk: {x: 1, y: 2}", "a b: {x: 1, y: 2}", 4, 3, "'a b' is not a plain name", "letters"),
    ],
)
def test_each_error_says_where_and_what(old, new, line, col, message, hint):
    assert old in GOOD
    found = problems(GOOD.replace(old, new, 1))
    assert len(found) == 1, found
    assert found[0][:2] == (line, col)
    assert message in found[0][2]
    assert hint in found[0][3]


def test_all_errors_at_once_in_the_order_of_the_file():
    bad = GOOD.replace("version: 1", "version: 9").replace("on_fail: skip", "on_fail: skp")
    bad = (
        bad.replace("goto: shelf", "goto: self")
        .replace("seconds: 2", "sekonds: 2")
        .replace("energy:", "name: again\nenergy:")
    )
    places = [(line, col) for line, col, _, _ in problems(bad)]
    assert places == [(1, 10), (10, 14), (11, 11), (13, 12), (20, 1)]


def test_the_text_of_an_error():
    text = GOOD.replace("ground: 0.5", "grond: 0.5")
    with pytest.raises(BadInput) as caught:
        parse_mission(text.encode(), "m.yaml")
    assert caught.value.exit_code == 2
    assert str(caught.value).splitlines() == [
        "m.yaml:16:22: unknown key 'grond'",
        "    16 | limits: {speed_mps: {grond: 0.5, air: 1}, height_max_m: 2, duration_s: 100}",
        "       |                      ^~~~~",
        "       = did you mean 'ground'?",
    ]


@pytest.mark.parametrize("text", ["", "# nothing\n", "~", "[]", "words", "3"])
def test_files_that_hold_no_mission(text):
    found = problems(text)
    assert len(found) == 1
    assert found[0][:2] == (1, 1)


def test_a_robot_files_network_is_found_beside_it_and_refused_where_it_is_damaged(tmp_path):
    for file in packaged_dir().iterdir():
        target = tmp_path / "net" / file.name
        target.parent.mkdir(exist_ok=True)
        shutil.copyfile(file, target)
    path = tmp_path / "robot.yaml"
    path.write_text("network: {weights: net}\n")
    assert load_robot(path).network.weights == tmp_path / "net"
    (tmp_path / "net" / "gkpn.onnx").write_bytes(b"nothing")
    with pytest.raises(BadInput, match=r"gkpn\.onnx are damaged") as refused:
        load_robot(path)
    assert "network.weights" in refused.value.do
    path.write_text("network: {weights: elsewhere}\n")
    with pytest.raises(BadInput, match=r"elsewhere/manifest\.json cannot be read"):
        load_robot(path)


def test_a_runtime_that_is_not_installed_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "robot.yaml"
    path.write_text("network: {runtime: openvino}\n")
    monkeypatch.setattr(package, "find_spec", lambda _: None)
    with pytest.raises(BadInput, match="openvino, which is not installed") as refused:
        load_robot(path)
    assert "pip install 'labr-autonomy[openvino]'" in refused.value.do
    monkeypatch.setattr(package, "find_spec", lambda _: True)
    assert load_robot(path).network.runtime == "openvino"


def test_robot_files_have_the_same_errors(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text("body: {mass_kg: 3.1, radius: 0.3}\nair: {speed_mps: fast}\nenergy: {reserve: true}\n")
    with pytest.raises(FileProblems) as caught:
        load_robot(path)
    assert [(p.line, p.col) for p in caught.value.problems] == [(1, 22), (2, 18), (3, 19)]
    assert caught.value.problems[0].hint == "did you mean 'radius_m'?"
    path.write_text("body: {mass_kg: 3.1}\nlinks: {air: 'udp://127.0.0.1:14540'}\n")
    assert load_robot(path).body.mass_kg == 3.1
    assert parse_robot(b"name: x").body.mass_kg == 3.4


LINES = GOOD.splitlines(keepends=True)
SCRAPS = [
    "{",
    "}",
    "[",
    "]",
    ":",
    "- ",
    "&a ",
    "*a",
    "!t ",
    "\t",
    "'",
    '"',
    "~",
    ".nan",
    "-1",
    "\x00",
    "é",
    "\n",
    "#",
    "? ",
]


def survives(raw: bytes) -> None:
    """Whatever the file holds, the answer is a mission or problems with places inside it."""
    caught = None
    try:
        parse_mission(raw, "m.yaml")
    except FileProblems as error:
        caught = error
    if caught is not None:
        assert caught.problems
        assert str(caught)
        assert all(p.line >= 1 and p.col >= 1 and p.message for p in caught.problems)


@pytest.mark.slow
@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.lists(
        st.tuples(st.integers(0, len(GOOD)), st.integers(0, 6), st.sampled_from([*SCRAPS, ""])),
        min_size=1,
        max_size=4,
    )
)
def test_mutants_never_escape_as_anything_but_problems(edits):
    text = GOOD
    for at, cut, scrap in edits:
        text = text[:at] + scrap + text[at + cut :]
    survives(text.encode())


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(st.sampled_from(LINES), max_size=12))
def test_shuffled_lines_never_escape(lines):
    survives("".join(lines).encode())


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.binary(max_size=60))
def test_noise_never_escapes(raw):
    survives(raw)


def test_schema_is_a_json_schema_that_describes_every_field():
    schema = json_schema()
    assert schema["$schema"].startswith("https://json-schema.org/")
    assert schema["required"] == ["version", "name", "items"]
    for name, node in schema["$defs"].items():
        if "properties" not in node:
            continue
        assert node["additionalProperties"] is False, name
        for ref in _refs(node):
            assert ref.startswith("#/$defs/")
            assert ref.removeprefix("#/$defs/") in schema["$defs"]
    kinds = {r.rpartition("/")[2] for r in _refs(schema["properties"]["items"])}
    assert kinds == {"Goto", "Wait", "Land", "Return"}
    assert "return" in schema["$defs"]["Return"]["properties"]
    assert "Leave it out" in schema["$defs"]["Point"]["properties"]["z"]["description"]


def _refs(node):
    if isinstance(node, dict):
        for key, value in node.items():
            if key == "$ref":
                yield value
            else:
                yield from _refs(value)
    elif isinstance(node, list):
        for value in node:
            yield from _refs(value)
