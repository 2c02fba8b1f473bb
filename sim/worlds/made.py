"""Worlds with their surface, made once for all who ask for the same one in turn."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from labr_autonomy.config import Body
from sim.worlds.build import rebuild_world
from sim.worlds.surface import Surface
from sim.worlds.world import World


def made_world(spec: Mapping[str, Any], body: Body) -> tuple[World, Surface]:
    """The world of a spec (`World.spec`) and its surface, from memory if it was asked for just before."""
    return _made(json.dumps(dict(spec), sort_keys=True), body)


@lru_cache(maxsize=2)  # a trial's task, its oracle and its flight ask for the same one
def _made(spec_json: str, body: Body) -> tuple[World, Surface]:
    world = rebuild_world(json.loads(spec_json))
    return world, Surface(world, body)
