"""Mission and robot files: read, check against the schema, and report everything wrong at once."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from labr_autonomy.config import RobotConfig
from labr_autonomy.gkpn.package import ONNX_NAME, check_runtime, read_verified
from labr_autonomy.mission import explain
from labr_autonomy.mission.schema import GoalMode, Mission
from labr_autonomy.mission.source import FileProblems, Source, parse, read_source

__all__ = ["FileProblems", "load_mission", "load_robot", "parse_mission", "parse_robot", "validated"]

Model = TypeVar("Model", bound=BaseModel)


def load_mission(path: Path) -> Mission:
    """Read a mission file.

    Raises:
        FileProblems: with everything wrong in it.
        BadInput: when it cannot be read.
    """
    return _mission(read_source(path))


def load_robot(path: Path) -> RobotConfig:
    """Read `robot.yaml`.

    Raises:
        FileProblems: with everything wrong in it.
        BadInput: when it cannot be read, or the network that it names cannot.
    """
    robot = validated(read_source(path), RobotConfig)
    if robot.links.air_key is not None:
        key = (path.parent / robot.links.air_key).resolve()
        robot = robot.model_copy(update={"links": robot.links.model_copy(update={"air_key": key})})
    network = robot.network
    check_runtime(network.runtime)
    if network.weights is None:
        return robot
    weights = (path.parent / network.weights).resolve()
    read_verified(weights, ONNX_NAME, "Mend network.weights in robot.yaml, or leave it out.")
    return robot.model_copy(update={"network": network.model_copy(update={"weights": weights})})


def parse_mission(raw: bytes, file: str = "<mission>") -> Mission:
    """The mission in `raw`; `file` is the name used in errors."""
    return _mission(parse(raw, file))


def parse_robot(raw: bytes, file: str = "<robot>") -> RobotConfig:
    """The robot in `raw`; `file` is the name used in errors."""
    return validated(parse(raw, file), RobotConfig)


def _mission(source: Source) -> Mission:
    _note_place_names(source)
    return validated(source, Mission)


def validated(source: Source, model: type[Model]) -> Model:
    """Check what was read against a schema; strict, so that `true` is no number and '1' no text for one.

    Args:
        source: The file as read; receives what is wrong.
        model: Its schema.

    Raises:
        FileProblems: with everything wrong in it.
    """
    if source.tree is None:
        if not source.problems:
            source.add((), "the file is empty", f"start with 'version: 1' and 'name: ...' ({model.__name__})")
        source.raise_problems()
    value: Model | None = None
    try:
        # JSON mode lets lists stand for tuples and words for enums, and stays strict otherwise
        value = model.model_validate_json(json.dumps(source.tree), strict=True)
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            explain.note(detail, source, _schema(model))
    source.raise_problems()
    assert value is not None  # no problems means that validation returned
    return value


@functools.cache
def _schema(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema(by_alias=True)


def _note_place_names(source: Source) -> None:
    """Each `goto: name` names a place, and one on the ground when it is to be driven to."""
    tree = source.tree if isinstance(source.tree, dict) else {}
    places = tree.get("places")
    places = places if isinstance(places, dict) else {}
    items = tree.get("items")
    for i, item in enumerate(items if isinstance(items, list) else ()):
        name = item.get("goto") if isinstance(item, dict) else None
        if not isinstance(name, str):
            continue
        path = ("items", i, "goto")
        if name not in places:
            source.add(path, f"no place is called '{name}'", explain.suggest(name, list(places)))
        elif (
            item.get("mode") == GoalMode.GROUND.value
            and isinstance(places[name], dict)
            and places[name].get("z")
        ):
            hint = "leave z out of the place, or use mode 'auto' or 'air'"
            source.add(path, f"mode 'ground' cannot reach '{name}': it is in the air", hint)
