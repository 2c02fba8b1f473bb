"""Validation errors of pydantic as sentences, each at its place in the file, with a hint where one helps."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from labr_autonomy.mission.source import Path_, Source, printable

_NUMBER = {"float_type", "float_parsing", "finite_number"}
_BOUNDS = {
    "greater_than": ("more than", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("less than", "lt"),
    "less_than_equal": ("at most", "le"),
}
_KINDS = {
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a block of 'key: value' lines",
    "model_type": "a block of 'key: value' lines",
    "model_attributes_type": "a block of 'key: value' lines",
} | dict.fromkeys(_NUMBER, "a number")


def note(error: ErrorDetails, source: Source, schema: Mapping[str, Any]) -> None:
    """Add one validation error to the problems of `source`.

    Args:
        error: As pydantic reports it.
        source: The file; receives the problem.
        schema: JSON Schema of the model, for names to suggest.
    """
    kind, context = error["type"], error.get("ctx") or {}
    path = _path(error["loc"], source)
    hint = str(context.get("hint", ""))
    if path in source.spoilt:
        return  # said already, and what pydantic saw is not what stands there
    if kind == "extra_forbidden":
        _note_unknown_key(error, path, source, schema)
    elif kind == "missing":
        _note_missing(error, path, source, schema)
    elif kind == "union_tag_not_found":
        _note_undecided(path, source)
    elif kind in ("literal_error", "enum"):
        names = _choices(str(context.get("expected", "")))
        source.add(
            path, f"must be {_listed(names)}, not {_shown(error['input'])}", _mean(error["input"], names)
        )
    elif kind in _BOUNDS:
        word, key = _BOUNDS[kind]
        source.add(path, f"must be {word} {_number(context[key])} (is {_shown(error['input'])})")
    elif kind in _KINDS:
        if error["input"] is None and kind.startswith("model"):
            hint = "write {} when there is nothing to set"
        source.add(path, f"needs {_KINDS[kind]}, not {_shown(error['input'])}", hint)
    elif kind in ("too_short", "too_long"):
        least = kind == "too_short"
        count, bound = context.get("actual_length"), context["min_length" if least else "max_length"]
        noun = "entry" if bound == 1 else "entries"
        source.add(path, f"needs at {'least' if least else 'most'} {bound} {noun} (has {count})")
    elif kind == "string_pattern_mismatch":
        if "ya?ml" in str(context.get("pattern")):
            source.add(path, f"{_shown(error['input'])} is not a .yaml file")
            return
        what = f"{_shown(error['input'])} is not a plain name"
        at_key = error["loc"][-1] == "[key]"
        source.add(path, what, "letters, digits, '_' and '-', not a digit first", at_key=at_key)
    else:
        at = context.get("at")  # a check of the whole block that blames one of its keys
        source.add((*path, at) if isinstance(at, str) else path, error["msg"].rstrip("."), hint)


def _path(loc: tuple[int | str, ...], source: Source) -> Path_:
    """The location as far as the file has it; names of union members are passed over."""
    path: Path_ = ()
    for part in loc:
        if (*path, part) in source.values:
            path = (*path, part)
    return path


def _note_missing(error: ErrorDetails, path: Path_, source: Source, schema: Mapping[str, Any]) -> None:
    name = error["loc"][-1]
    if isinstance(name, int):
        source.add(path, f"needs at least {name + 1} entries")
        return
    if any(_mean(key, [name]) for key in _mapping_at(source.tree, path) if key not in _known(error, schema)):
        return  # it is there, misspelt, and the unknown key is an error of its own
    where = f" in '{path[-1]}'" if path and isinstance(path[-1], str) else ""
    source.add(path, f"'{name}' is missing{where}", at_key=True)


def _note_unknown_key(error: ErrorDetails, path: Path_, source: Source, schema: Mapping[str, Any]) -> None:
    name = str(error["loc"][-1])
    known = sorted(_known(error, schema))
    taken = _mapping_at(source.tree, path[:-1])
    hint = _mean(name, [k for k in known if k not in taken])
    if not hint and known:
        hint = f"known here: {', '.join(known)}"
    elif not known:
        hint = "this block takes no keys"
    source.add(path, f"unknown key '{printable(name)}'", hint, at_key=True)


def _note_undecided(path: Path_, source: Source) -> None:
    """A union whose member is told by a key: the key is absent, misspelt, or there are two of them."""
    if len(path) == 2 and path[0] == "items":
        verbs, thing = ["goto", "wait", "land", "return"], "an item"
    else:
        verbs, thing = ["family", "mesh", "file"], "a world"
    block = _mapping_at(source.tree, path)
    present = [key for key in block if key in verbs]
    if len(present) > 1:
        text = f"{thing} has one of {_listed(verbs)}, but this has {_listed(present, 'and')}"
        source.add((*path, present[1]), text, "make two of it" if thing == "an item" else "", at_key=True)
        return
    for key in block:
        if hint := _mean(key, verbs):
            source.add((*path, key), f"unknown key '{key}'", hint, at_key=True)
            return
    hint = "for example: - goto: {x: 1, y: 2}" if thing == "an item" else "for example: {family: hall}"
    source.add(path, f"{thing} needs one of {_listed(verbs)}", hint)


def _mapping_at(tree: Any, path: Path_) -> dict[str, Any]:
    for part in path:
        tree = tree[part]
    return tree if isinstance(tree, dict) else {}


def _known(error: ErrorDetails, schema: Mapping[str, Any]) -> set[str]:
    """Keys known in the block that an error about a key is about."""
    return _keys_at(error["loc"][:-1], schema)


def _keys_at(loc: tuple[int | str, ...], schema: Mapping[str, Any]) -> set[str]:
    """Property names the schema knows at a location."""
    definitions = schema.get("$defs", {})

    def opened(node: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
        if "$ref" in node:
            yield from opened(definitions[node["$ref"].rpartition("/")[2]])
        for choice in (*node.get("oneOf", ()), *node.get("anyOf", ())):
            yield from opened(choice)
        yield node

    nodes: list[Mapping[str, Any]] = list(opened(schema))
    for part in loc:
        below: list[Mapping[str, Any]] = []
        for node in nodes:
            child = node.get("properties", {}).get(part)
            if child is None:
                child = node.get("items") if isinstance(part, int) else node.get("additionalProperties")
            if isinstance(child, dict):
                below += opened(child)
        if not below and part in definitions:  # a union member's name
            below = list(opened(definitions[part]))
        nodes = below or nodes
    return {key for node in nodes for key in node.get("properties", {})}


def _choices(expected: str) -> list[str]:
    return [c.strip().strip("'") for c in expected.replace(" or ", ",").split(",") if c.strip()]


def _mean(word: object, names: list[str]) -> str:
    """A suggestion for a misspelt word, or nothing."""
    if not isinstance(word, str):
        return ""
    close = difflib.get_close_matches(word.lower(), names, n=1, cutoff=0.6)
    if not close:
        close = [
            n for n in names if len(word) >= 3 and (n.startswith(word.lower()) or word.lower().startswith(n))
        ]
    return f"did you mean '{close[0]}'?" if close else ""


def suggest(word: str, names: list[str]) -> str:
    """`did you mean 'speed'?`, or the names there are."""
    return _mean(word, names) or (f"known: {', '.join(sorted(names)[:12])}" if names else "")


def _listed(names: list[str], joint: str = "or") -> str:
    quoted = [n if n.isdecimal() else f"'{n}'" for n in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} {joint} {quoted[-1]}"


def _shown(value: object) -> str:
    match value:
        case None:
            return "nothing"
        case bool():
            return "true" if value else "false"
        case str():
            return f"'{printable(value[:40])}{'...' if len(value) > 40 else ''}'"
        case int() | float():
            return _number(value)
        case dict():
            return "a block"
        case list() | tuple():
            return "a list"
        case BaseModel():
            return "this"
    return type(value).__name__


def _number(value: object) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)
