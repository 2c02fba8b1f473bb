"""A folder of scenes: what is missing is made, what is there and whole is kept.

The manifest is written anew after each scene, so that whatever stops the command leaves a folder that the
same command goes on with.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.shards import (
    MANIFEST,
    Shard,
    digest,
    read_manifest,
    write_manifest,
    write_shard,
)
from sim.training_data.build import SceneConfig, build_scene, scene_spec
from sim.training_data.workers import carried_out

Entry = dict[str, Any]  # of the manifest


class ShardJob(Protocol):
    """One shard to be made, perhaps in another process."""

    @property
    def file(self) -> str:
        """Its name in the folder."""
        ...

    def make(self) -> Shard:
        """Make it; `BadInput` where there is nothing to make."""
        ...


@dataclass(frozen=True, slots=True)
class SceneJob:
    """One generated scene."""

    name: str
    spec: dict[str, Any]
    seed: int
    config: SceneConfig

    @property
    def file(self) -> str:
        """Its name in the folder."""
        return f"{self.name}-{self.seed}.npz"

    def make(self) -> Shard:
        """Make it."""
        return build_scene(self.name, self.spec, self.seed, self.config, RobotConfig())


@dataclass(frozen=True, slots=True)
class _Order:
    """What a worker is told."""

    job: ShardJob
    folder: Path


@dataclass(frozen=True, slots=True)
class Filled:
    """What has become of a folder."""

    manifest: dict[str, Any]
    made: int
    kept: int


def scene_jobs(
    places: Mapping[str, Mapping[str, Any]], seed: int, scenes: int, config: SceneConfig
) -> tuple[list[SceneJob], dict[str, Any]]:
    """The scenes of a data set, and the settings for its manifest.

    Args:
        places: Families and mesh worlds by name: what `build_world` takes.
        seed: Of the first scene; the others follow.
        scenes: How many.
        config: Of each.
    """
    jobs = [SceneJob(*scene_spec(places, s), s, config) for s in range(seed, seed + scenes)]
    robot = RobotConfig()
    said = {name: {k: v for k, v in spec.items() if k != "worlds_dir"} for name, spec in places.items()}
    settings = {
        "kind": "walks",
        "worlds": said,
        "seed": seed,
        **asdict(config),
        "camera": robot.camera.model_dump(mode="json"),
        "body": robot.body.model_dump(mode="json"),
    }
    return jobs, settings


def fill(
    folder: Path,
    settings: Mapping[str, Any],
    jobs: Sequence[ShardJob],
    processes: int,
    on_shard: Callable[[], None],
) -> Filled:
    """Make what is missing of a data set.

    Args:
        folder: Where; made when it is not there.
        settings: Of the data set; a folder of others is refused.
        jobs: All its shards.
        processes: How many at once.
        on_shard: Called for each shard that is there, found or made.

    Raises:
        BadInput: when the folder holds something else, or no job gives a shard.
    """
    folder.mkdir(parents=True, exist_ok=True)
    entries = _kept(folder, settings, jobs)
    for part in folder.glob(".*.part"):  # of a command that was killed
        part.unlink()
    kept, skipped = len(entries), list[Entry]()
    manifest = write_manifest(folder, settings, entries, skipped)
    there = {entry["file"] for entry in entries}
    for _ in entries:
        on_shard()
    orders = [_Order(job, folder) for job in jobs if job.file not in there]
    for entry in carried_out(_make, orders, processes):
        (entries if "sha256" in entry else skipped).append(entry)
        manifest = write_manifest(folder, settings, entries, skipped)
        on_shard()
    if not entries:
        why = skipped[0]["why"] if skipped else "no scene is asked for"
        raise BadInput(f"no scene could be made: {why.rstrip('.')}", "Name other worlds.")
    return Filled(manifest, len(entries) - kept, kept)


def _kept(folder: Path, settings: Mapping[str, Any], jobs: Sequence[ShardJob]) -> list[Entry]:
    """Entries of the shards that are there and whole."""
    if not (folder / MANIFEST).is_file():
        return []
    manifest = read_manifest(folder)
    if manifest["settings"] != dict(settings):
        names = sorted({*manifest["settings"], *settings})
        other = next(n for n in names if manifest["settings"].get(n) != settings.get(n))
        old, new = (json.dumps(said.get(other)) for said in (manifest["settings"], settings))
        raise BadInput(
            f"{folder} holds a data set with '{other}' {old}, not {new}",
            "Name another folder, or give the same settings.",
        )
    files = {job.file for job in jobs}
    listed = [entry for entry in manifest["shards"] if entry["file"] in files]
    if len(listed) < len(manifest["shards"]):
        raise BadInput(
            f"{folder} holds {len(manifest['shards'])} scenes, more than are asked for",
            "Ask for at least as many, or name another folder.",
        )
    return [e for e in listed if (folder / e["file"]).is_file() and digest(folder / e["file"]) == e["sha256"]]


def _make(order: _Order) -> Entry:
    """Make and write one shard; its entry for the manifest, or why there is none."""
    try:
        shard = order.job.make()
    except BadInput as error:
        return {"file": order.job.file, "why": str(error)}
    sha256 = write_shard(order.folder / order.job.file, shard)
    return {
        "file": order.job.file,
        "sha256": sha256,
        "family": shard.family,
        "seed": shard.seed,
        "views": len(shard.poses),
        "goals": int(shard.in_air.size),
        "hard": int(shard.hard.sum()),
        "air": int(shard.in_air.sum()),
    }
