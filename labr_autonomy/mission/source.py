"""Guarded reading of YAML: bytes to a plain tree in which every value and key knows its line and column.

The dialect is small on purpose: YAML 1.2 words, one document, no tags, anchors or aliases, no duplicate
keys, no numbers that are not finite, at most 256 kB and 12 levels. Everything found wrong is returned at
once, together with the part of the tree that could still be read.
"""

from __future__ import annotations

import math
import unicodedata
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, StringMark, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    MappingStartEvent,
    NodeEvent,
    SequenceStartEvent,
)
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from labr_autonomy.errors import BadInput

SIZE_MAX_BYTES = 256 * 1024
DEPTH_MAX = 12
NODES_MAX = 20_000
INTEGER_MAX = 2**53  # beyond it a double cannot tell neighbours apart

Path_ = tuple[str | int, ...]  # where a value hangs in the tree: keys and list indices from the root


@dataclass(frozen=True, slots=True, order=True)
class Problem:
    """One thing wrong in a file, with its place (1-based)."""

    line: int
    col: int
    message: str
    hint: str = ""
    width: int = 1  # characters to underline


class FileProblems(BadInput):
    """Everything wrong in one file."""

    def __init__(self, file: str, problems: list[Problem], lines: list[str]) -> None:
        count = len(problems)
        super().__init__(f"{file} has {count} error{'s' if count != 1 else ''}", "Correct and try again")
        self.file = file
        self.problems = problems
        self._lines = lines

    def __str__(self) -> str:
        """Each problem as `file:line:col: message`, the line, a caret and the hint."""
        return "\n".join(self._render(problem) for problem in self.problems)

    def _render(self, problem: Problem) -> str:
        out = [f"{self.file}:{problem.line}:{problem.col}: {problem.message}"]
        if problem.line <= len(self._lines):
            text = printable(self._lines[problem.line - 1])
            cut = max(0, problem.col - 80)  # long lines: keep the caret on the screen
            text = text[cut : cut + 120]
            column = problem.col - 1 - cut
            underline = "^" + "~" * max(0, min(problem.width, len(text) - column) - 1)
            out += [f"{problem.line:6d} | {text}", f"       | {' ' * column}{underline}"]
        if problem.hint:
            out.append(f"       = {problem.hint}")
        return "\n".join(out)

    def as_list(self) -> list[dict[str, object]]:
        """The same for machines."""
        return [
            {"file": self.file, "line": p.line, "col": p.col, "message": p.message, "hint": p.hint}
            for p in self.problems
        ]


@dataclass(slots=True)
class Source:
    """A file as read: the plain tree, and where its parts stand."""

    file: str
    lines: list[str]
    tree: Any = None
    problems: list[Problem] = field(default_factory=list)
    values: dict[Path_, tuple[int, int, int]] = field(default_factory=dict)  # line, col, width
    keys: dict[Path_, tuple[int, int, int]] = field(default_factory=dict)
    spoilt: set[Path_] = field(default_factory=set)  # values replaced because they could not be read

    def add(self, path: Path_, message: str, hint: str = "", *, at_key: bool = False) -> None:
        """Note a problem at the value (or the key) that `path` leads to, or at its nearest parent."""
        place = None
        if at_key:
            place = self.keys.get(path)
        while place is None:
            place = self.values.get(path)
            if place is None and not path:
                place = (1, 1, 1)
            path = path[:-1]
        line, col, width = place
        self.problems.append(Problem(line, col, message, hint, width))

    def raise_problems(self) -> None:
        """Raise everything noted, in the order of the file."""
        if self.problems:
            raise FileProblems(self.file, sorted(set(self.problems)), self.lines)


def printable(text: str) -> str:
    """Text without characters that steer a terminal."""
    return "".join(c if c == " " or c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


def read_source(path: Path) -> Source:
    """Read one YAML file.

    Raises:
        BadInput: when the file cannot be read at all.
    """
    file = printable(str(path))
    try:
        with path.open("rb") as stream:
            raw = stream.read(SIZE_MAX_BYTES + 1)
    except OSError as error:
        raise BadInput(f"{file} cannot be read: {error.strerror}", "Check the path") from None
    return parse(raw, file)


def parse(raw: bytes, file: str = "<text>") -> Source:
    """Turn bytes into a tree with places; problems are collected in the result, not raised."""
    if len(raw) > SIZE_MAX_BYTES:
        source = Source(file, [])
        source.add((), f"the file is larger than {SIZE_MAX_BYTES // 1024} kB", "a mission is a page or two")
        return source
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        source = Source(file, [])
        line = raw.count(b"\n", 0, error.start) + 1
        col = error.start - raw.rfind(b"\n", 0, error.start)
        source.problems.append(Problem(line, col, f"byte 0x{raw[error.start]:02x} is not UTF-8 text"))
        return source
    source = Source(file, text.splitlines())
    try:
        if _safe_events(text, source):
            node = _yaml().compose(text)
            source.tree = None if node is None else _Builder(source).build(node, ())
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, col = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        why = " ".join(str(error.problem or error.context or "not understood").split())
        if why.startswith("but ") and error.context:
            why = f"{error.context}, {why}"
        source.problems.append(Problem(line, col, f"not YAML: {printable(why)}", _yaml_hint(why)))
    except (YAMLError, ValueError, OverflowError) as error:  # ReaderError, escapes beyond Unicode
        why = printable(str(error).splitlines()[0] if str(error) else "not understood")
        source.problems.append(Problem(*_where(error, text), f"not YAML: {why}"))
    return source


def _where(error: Exception, text: str) -> tuple[int, int]:
    """Line and column of an error that only knows its character's position."""
    position = getattr(error, "position", None)
    if not isinstance(position, int):
        return 1, 1
    return text.count("\n", 0, position) + 1, position - text.rfind("\n", 0, position)


def _yaml() -> YAML:
    return YAML(typ="safe", pure=True)


def _yaml_hint(why: str) -> str:
    if "\\t" in why or "tab" in why:
        return "indent with spaces, not tabs"
    if "expected <block end>" in why or "mapping values are not allowed" in why:
        return "check the indentation and the colons of this line and the one before"
    return ""


def _safe_events(text: str, source: Source) -> bool:
    """Look for what is refused before anything is built; False when building would be unwise."""
    depth = nodes = 0
    sound = True
    for event in _yaml().parse(text):
        start = event.start_mark
        if isinstance(event, DocumentStartEvent) and (event.version or event.tags):
            source.problems.append(
                Problem(start.line + 1, 1, "YAML directives are refused", "leave '%' lines out")
            )
            return False
        if not isinstance(event, NodeEvent):
            depth -= type(event).__name__ in ("MappingEndEvent", "SequenceEndEvent")
            continue
        place = (start.line + 1, start.column + 1)
        nodes += 1
        if nodes > NODES_MAX:
            source.problems.append(
                Problem(*place, f"more than {NODES_MAX} values", "a mission is a page or two")
            )
            return False
        if isinstance(event, AliasEvent):
            source.problems.append(Problem(*place, "aliases (*) are refused", "write the value out"))
            sound = False  # building would follow it, however often
        elif event.anchor:
            source.problems.append(
                Problem(*place, "anchors (&) are refused", "write the value out where it is used")
            )
        tag = getattr(event, "ctag", None)
        if tag is not None and str(tag) not in ("", "None"):
            source.problems.append(
                Problem(*place, f"tags are refused ({printable(str(tag))})", "leave the tag out")
            )
            sound = False
        if isinstance(event, (MappingStartEvent, SequenceStartEvent)):
            depth += 1
            if depth > DEPTH_MAX:
                source.problems.append(Problem(*place, f"nested more than {DEPTH_MAX} levels deep"))
                return False
    return sound


class _Builder:
    """Turns composed nodes into dict, list, str, int, float, bool and None."""

    def __init__(self, source: Source) -> None:
        self._source = source

    def build(self, node: Node, path: Path_) -> Any:
        self._source.values[path] = _place(node)
        if isinstance(node, MappingNode):
            return self._mapping(node, path)
        if isinstance(node, SequenceNode):
            return [self.build(child, (*path, i)) for i, child in enumerate(node.value)]
        assert isinstance(node, ScalarNode)  # the third and last kind
        return self._scalar(node, path)

    def _mapping(self, node: MappingNode, path: Path_) -> dict[str, Any]:
        out: dict[str, Any] = {}
        first: dict[str, int] = {}
        for key_node, value_node in node.value:
            line, col, width = _place(key_node)
            if not isinstance(key_node, ScalarNode):
                self._source.problems.append(Problem(line, col, "a key must be a plain word", "", width))
                continue
            key = printable(str(key_node.value))
            if key in first:
                message = f"'{key}' is given twice, first in line {first[key]}"
                self._source.problems.append(Problem(line, col, message, "keep one of them", width))
                continue
            first[key] = line
            self._source.keys[*path, key] = (line, col, width)
            out[key] = self.build(value_node, (*path, key))
            if isinstance(value_node, ScalarNode) and not value_node.value and value_node.style is None:
                self._source.values[*path, key] = (line, col, width)  # nothing stands there: point at the key
        return out

    def _scalar(self, node: ScalarNode, path: Path_) -> str | int | float | bool | None:
        text = str(node.value)
        kind = str(node.tag).rpartition(":")[2]
        value: str | int | float | bool | None = text
        if kind == "null":
            value = None
        elif kind == "bool":
            value = text.lower() == "true"
        elif kind in ("int", "float"):
            value = _number(text, kind)
            if value is None:
                self._source.add(path, f"{printable(text[:40])} is not a finite number of sensible size")
                self._source.spoilt.add(path)
                value = 0
        elif any(unicodedata.category(c) in ("Cc", "Cs") and c not in "\n\t" for c in text):
            self._source.add(path, "text with control characters is refused")
            self._source.spoilt.add(path)
            value = ""
        return value


def _number(text: str, kind: str) -> int | float | None:
    """YAML 1.2 number, or None when it is not finite or needlessly large."""
    plain = text.replace("_", "").lower()
    try:
        if kind == "float":
            value = float(plain.replace(".inf", "inf").replace(".nan", "nan"))
            return value if math.isfinite(value) else None
        whole = int(plain, 0) if plain.lstrip("+-")[:2] in ("0x", "0o", "0b") else int(plain)
    except ValueError:
        return None
    return whole if abs(whole) <= INTEGER_MAX else None


def _place(node: Node) -> tuple[int, int, int]:
    """Line, column (1-based) and the width of the part in its first line."""
    start: StringMark = node.start_mark
    end: StringMark = node.end_mark
    width = end.column - start.column if end.line == start.line else 1
    return start.line + 1, start.column + 1, max(1, width)
