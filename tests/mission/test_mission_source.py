from __future__ import annotations

import pytest

from labr_autonomy.errors import BadInput
from labr_autonomy.mission.source import DEPTH_MAX, SIZE_MAX_BYTES, FileProblems, parse, read_source


def problems(text: str | bytes) -> list[tuple[int, int, str]]:
    raw = text if isinstance(text, bytes) else text.encode()
    return [(p.line, p.col, p.message) for p in sorted(parse(raw).problems)]


def only(text: str | bytes) -> tuple[int, int, str]:
    found = problems(text)
    assert len(found) == 1, found
    return found[0]


def test_words_are_yaml_1_2():
    tree = parse(b"a: [on, yes, 1:30, 012, 0x1F, 0o17, ~, true, -.5, 1e3, 2020-01-01]\n").tree
    assert tree == {"a": ["on", "yes", "1:30", 12, 31, 15, None, True, -0.5, 1000.0, "2020-01-01"]}


@pytest.mark.parametrize(
    ("text", "line", "col", "word"),
    [
        ("a: 1\nb: !!python/object/apply:os.system [ls]\n", 2, 4, "tags are refused"),
        ("a: !x 1\n", 1, 4, "tags are refused"),
        ("a: &k 1\n", 1, 4, "anchors"),
        ("%YAML 1.1\n---\na: on\n", 2, 1, "directives"),
        ("a: 1\nbb: 2\na: 3\n", 3, 1, "'a' is given twice, first in line 1"),
        ("a: {b: 1, b: 2}\n", 1, 11, "'b' is given twice"),
        ("a: .inf\n", 1, 4, "not a finite number"),
        ("a: [1, .nan]\n", 1, 8, "not a finite number"),
        ("a: 1e999\n", 1, 4, "not a finite number"),
        ("a: " + "9" * 5000, 1, 4, "not a finite number"),
        ("? [1, 2]\n: 3\n", 1, 3, "a key must be a plain word"),
        ("a:\n\t- 1\n", 2, 1, "not YAML"),
        ("a: [1, 2\nb: 3\n", 2, 2, "not YAML"),
        ("a: 1\n---\nb: 2\n", 2, 1, "single document"),
        ("a: 1\nb: \x07\n", 2, 4, "not YAML"),
        (b"a: 1\nb: \xff\n", 2, 4, "not UTF-8"),
        ('a: "\\ud800"\n', 1, 4, "control characters"),
        ('a: "\\x1b[2J"\n', 1, 4, "control characters"),
        ('a: "\\U00110000"\n', 1, 1, "not YAML"),
        ("[" * (DEPTH_MAX + 1) + "]" * (DEPTH_MAX + 1), 1, DEPTH_MAX + 1, "levels deep"),
        ("[" * 100_000, 1, DEPTH_MAX + 1, "levels deep"),
    ],
)
def test_what_is_refused_says_where(text, line, col, word):
    found_line, found_col, message = only(text)
    assert (found_line, found_col) == (line, col)
    assert word in message


def test_depth_at_the_limit_is_read():
    assert problems("[" * DEPTH_MAX + "]" * DEPTH_MAX) == []


def test_several_kinds_at_once():
    found = problems("a: &x 1\nb: *x\nc: !y 2\n")
    assert [(line, col) for line, col, _ in found] == [(1, 4), (2, 4), (3, 4)]


def test_aliases_are_never_expanded():
    bomb = "a: &a [x, x]\n" + "".join(
        f"{chr(98 + i)}: &{chr(98 + i)} [*{chr(97 + i)}, *{chr(97 + i)}]\n" for i in range(20)
    )
    source = parse(bomb.encode())
    assert source.tree is None
    assert any("aliases" in p.message for p in source.problems)


@pytest.mark.slow
def test_too_many_values_stop_the_reading():
    _, _, message = only("a: [" + "1," * 30_000 + "]")
    assert "more than 20000 values" in message


def test_size_limit(tmp_path):
    path = tmp_path / "big.yaml"
    path.write_bytes(b"a: 1 #" + b"x" * SIZE_MAX_BYTES)
    assert "larger than 256 kB" in read_source(path).problems[0].message
    path.write_bytes(b"a: 1 #" + b"x" * (SIZE_MAX_BYTES - 6))
    assert read_source(path).problems == []


@pytest.mark.parametrize("name", ["absent.yaml", "."])
def test_a_file_that_cannot_be_read_is_bad_input(tmp_path, name):
    with pytest.raises(BadInput, match="cannot be read") as caught:
        read_source(tmp_path / name)
    assert caught.value.exit_code == 2


def test_caret_underlines_the_value_and_long_lines_are_cut():
    text = "a: {" + ", ".join(f"k{i}: {i}" for i in range(100)) + ", k7: 1}\n"
    source = parse(text.encode(), "f.yaml")
    with pytest.raises(FileProblems) as caught:
        source.raise_problems()
    head, line, caret, _hint = str(caught.value).splitlines()
    assert head.startswith("f.yaml:1:")
    assert len(line) < 140
    assert line[caret.index("^") :].startswith("k7")


def test_terminal_escapes_of_the_file_are_not_printed():
    source = parse("a: 1\na: 2 # \x9b31m\n".encode(), "f.yaml")
    with pytest.raises(FileProblems) as caught:
        source.raise_problems()
    assert "\x9b" not in str(caught.value)
