"""What a benchmark was asked to do; it can only be continued by the same question."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from labr_autonomy.errors import BadInput
from labr_autonomy.record.run_folder import make_run_folder, slug
from labr_autonomy.record.summary import versions
from sim.bench.alone.names import digest_of, is_network
from sim.bench.records import read_json, write_whole
from sim.worlds.build import build_world

FILE = "settings.json"


@dataclass(frozen=True, slots=True)
class Place:
    """A kind of world to fly in."""

    name: str  # a family's, or a mesh world's own
    spec: dict[str, Any]  # for `sample_task`


def world_place(path: Path, worlds_dir: Path | None) -> Place:
    """The place of a world file, which is checked against its mesh.

    Raises:
        FileProblems, BadInput: when it cannot be used.
    """
    world = build_world(
        {"file": str(path.resolve() if path.is_file() else path)}, seed=0, worlds_dir=worlds_dir
    )
    return Place(slug(world.name), world.spec)


@dataclass(frozen=True, slots=True)
class Settings:
    """The question."""

    bench: str  # "navigation" or "table3"
    places: tuple[Place, ...]
    methods: tuple[str, ...]
    trials: int  # in every place
    seed: int  # of the first trial; the others follow
    arguments: tuple[str, ...]  # of the command that asks this, without where and how to compute
    robot: dict[str, Any] | None = None  # None: the standard robot

    @property
    def seeds(self) -> range:
        """Seeds of the trials."""
        return range(self.seed, self.seed + self.trials)

    @property
    def command(self) -> str:
        """The command line that asks this."""
        return shlex.join(["labr-mission", "bench", self.bench, *self.arguments])

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, as the run folder keeps it."""
        kept = {key: value for key, value in asdict(self).items() if key != "arguments"}
        kept["versions"] = versions()
        weights = {name: digest_of(name) for name in self.methods if is_network(name)}
        if weights:  # a network that was trained anew is another question
            kept["weights"] = weights
        whole: dict[str, Any] = json.loads(json.dumps(kept))
        return whole


def open_folder(settings: Settings, out: Path | None, *, resume: bool) -> Path:
    """The run folder: a new one, or one that holds the beginning of the same benchmark.

    Args:
        settings: What is asked now.
        out: The folder; without it a new one in `runs`, or with `resume` the latest of the same question.
        resume: There must be something to continue.

    Raises:
        BadInput: when the folder holds something else, or another question.
    """
    asked = settings.as_dict()
    if out is None:
        found = _latest(settings.bench, asked) if resume else None
        if resume and found is None:
            raise BadInput("runs holds no benchmark with these settings", "Name its folder by --out DIR")
        folder = found or make_run_folder(f"bench-{settings.bench}")
    else:
        folder = out
    kept = folder / FILE
    if kept.is_file():
        _require_same(folder, read_json(kept), asked)
        return folder
    if resume:
        raise BadInput(f"{folder} holds no benchmark to resume", "Leave out --resume to begin one there")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadInput(f"{folder} is there and holds no benchmark", "Choose another --out DIR")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{folder} cannot be made: {error.strerror}", "Choose another --out DIR") from None
    write_whole(kept, json.dumps(asked, indent=1) + "\n")
    return folder


def _latest(bench: str, asked: Mapping[str, Any]) -> Path | None:
    folders = sorted(Path("runs").glob(f"*-bench-{bench}*"), reverse=True)
    return next((f for f in folders if (f / FILE).is_file() and read_json(f / FILE) == asked), None)


def _require_same(folder: Path, kept: Any, asked: Mapping[str, Any]) -> None:
    """Refuse to mix two questions in one folder."""
    before = kept if isinstance(kept, dict) else {}
    differing = [
        f"{key} was {_short(before.get(key))} and is {_short(asked.get(key))} now"
        for key in sorted(before.keys() | asked.keys())
        if before.get(key) != asked.get(key)
    ]
    if differing:
        raise BadInput(
            f"{folder} holds a benchmark with other settings: {'; '.join(differing)}",
            "Ask the same again to continue it, or choose another --out DIR",
        )


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 160 else f"{text[:157]}..."
