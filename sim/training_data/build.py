"""One scene of training data: a world by its seed, walks through it, what was seen on them, and the truth.

The same seed gives the same arrays: world, walks, noise and goals have their own streams of random numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.local_map import local_map
from labr_autonomy.gkpn.resample import network_image
from labr_autonomy.gkpn.shards import Shard
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.types import DepthFrame, Image, Mode
from sim.bench.known import Known, know
from sim.camera.process import Eye
from sim.camera.renderer import make_renderer
from sim.training_data.fields import AirTruth, LandTruth, air_truth, land_truth
from sim.training_data.goals import Goals, draw_goals
from sim.training_data.walks import Stop, Walker

DIFFICULTY = (0.2, 0.9)  # of generated worlds
VIEWS_A_WALK = 12
FLYING_SHARE = 0.3  # of the views
WALKS_WITHOUT_VIEW = 40
PLACE_M = 2.0  # a view in the air has a place to stand within this, seen from above
FLIGHT_M = 1.2  # above the floor: the layer in which ways in the air are measured from the wheels
LAYER_HALF_M = 8.0
_KIND, _WALKS, _NOISE, _GOALS = 11, 12, 13, 14  # streams of random numbers


@dataclass(frozen=True, slots=True)
class SceneConfig:
    """How much of a scene, and in what size."""

    views: int = 96
    goals: int = 8
    width: int = 160  # of the network's images [px]
    height: int = 90


@dataclass(frozen=True, slots=True)
class _View:
    image_m: Image  # (h, w) of the network
    map_bits: NDArray[np.uint8]  # (channels, bytes)
    stop: Stop
    land: LandTruth
    goals: Goals


def scene_spec(places: Mapping[str, Mapping[str, Any]], seed: int) -> tuple[str, dict[str, Any]]:
    """The world of a seed: its place's name, and what `build_world` takes.

    Args:
        places: By name, what `build_world` takes; families get seed and difficulty drawn.
        seed: Of the scene.
    """
    rng = np.random.default_rng([seed, _KIND])
    name = sorted(places)[int(rng.integers(len(places)))]
    spec = dict(places[name])
    if "family" in spec:
        spec["seed"] = seed
        if spec["family"] != "hall":
            spec["difficulty"] = round(float(rng.uniform(*DIFFICULTY)), 3)
    return name, spec


def build_scene(
    name: str, spec: Mapping[str, Any], seed: int, config: SceneConfig, robot: RobotConfig
) -> Shard:
    """The shard of one scene.

    Args:
        name: Of the family or of the mesh world.
        spec: What `build_world` takes.
        seed: Of walks, noise and goals.
        config: How much.
        robot: Its outline, camera and powers.

    Raises:
        BadInput: when the world offers no walk with goals.
    """
    known = know(spec, robot)
    air = air_truth(known)
    with closing(make_renderer(known.world, robot.camera.intrinsics, robot.camera.range_max_m)) as renderer:
        noise = int(np.random.default_rng([seed, _NOISE]).integers(1 << 31))
        eye = Eye(renderer, robot.camera, seed=noise)
        views = _views(known, air, eye, seed, config, robot)
    below = robot.body.below_m
    stops = [view.stop for view in views]
    return Shard(
        images_mm=np.array([np.round(1000.0 * view.image_m) for view in views], np.uint16),
        maps=np.array([view.map_bits for view in views], np.uint8),
        poses=np.array([[*s.pose.position_m, s.rpy_rad[2], *s.rpy_rad[:2]] for s in stops], np.float32),
        floor_m=np.array([s.floor_z_m + below - s.pose.position_m[2] for s in stops], np.float32),
        goals_m=np.array([view.goals.level_m for view in views], np.float32),
        in_air=np.array([view.goals.in_air for view in views], np.bool_),
        hard=np.array([view.goals.hard for view in views], np.bool_),
        land_cm=np.array([view.land.distance_cm for view in views], np.int8),
        floors_cm=np.array([view.land.floors_cm for view in views], np.int16),
        land_corner_m=np.array([view.land.corner_m for view in views], np.float32),
        air_cm=air.distance_cm,
        air_origin_m=air.origin_m.astype(np.float32),
        air_cell_m=air.cell_m,
        family=name,
        seed=seed,
    )


def _views(
    known: Known, air: AirTruth, eye: Eye, seed: int, config: SceneConfig, robot: RobotConfig
) -> list[_View]:
    if len(known.places_m) < 2:
        raise BadInput(
            f"the world '{known.world.name}' has no place to stand on", "Check its scale and its up axis."
        )
    walker = Walker(known, robot, np.random.default_rng([seed, _WALKS]))
    rng = np.random.default_rng([seed, _GOALS])
    views: list[_View] = []
    idle, dice = 0, rng.random()
    while len(views) < config.views:
        wanted = min(VIEWS_A_WALK, config.views - len(views))
        flown = sum(view.stop.mode is Mode.AIR for view in views)
        flying = flown + VIEWS_A_WALK * dice < FLYING_SHARE * (len(views) + VIEWS_A_WALK)
        found = _walk(known, air, walker.walk(flying), eye, wanted, rng, config, robot)
        views += found
        idle = 0 if found else idle + 1
        if idle >= WALKS_WITHOUT_VIEW:
            raise BadInput(
                f"the world '{known.world.name}' offers no walk with goals",
                "Give it more free floor, or other bounds.",
            )
    return views


def _walk(
    known: Known,
    air: AirTruth,
    stops: list[Stop],
    eye: Eye,
    wanted: int,
    rng: np.random.Generator,
    config: SceneConfig,
    robot: RobotConfig,
) -> list[_View]:
    """Take the pictures of a walk into a fresh map, as `planner.pipeline` does, and keep its views."""
    rolling, views = RollingMap(robot), list[_View]()
    intrinsics = robot.camera.intrinsics
    for number, stop in enumerate(stops):
        depth_m = eye.look(stop.pose)
        rolling.update(DepthFrame(number, 0.0, depth_m, intrinsics), stop.pose, stop.floor_z_m)
        rolling.clear_robot(stop.pose)
        if not stop.view:
            continue
        place = _place_below(known, stop)
        if place is None:
            continue
        land = land_truth(known, stop.pose.position_m[:2], stop.floor_z_m, known.places_m[place])
        here = stop.pose.position_m
        flight_z_m = float(here[2]) if stop.mode is Mode.AIR else stop.floor_z_m + FLIGHT_M
        layer = air.layer(here[:2], flight_z_m, LAYER_HALF_M)
        goals = draw_goals(known, stop, land, layer, config.goals, rng, robot)
        if goals is None:
            continue
        image_m = network_image(depth_m, intrinsics, config.width, config.height)
        bits = local_map(rolling, stop.pose, stop.floor_z_m)
        packed = np.packbits(bits.reshape(len(bits), -1), axis=1)
        views.append(_View(image_m, packed, stop, land, goals))
        if len(views) == wanted:
            break
    return views


def _place_below(known: Known, stop: Stop) -> int | None:
    """The standing place nearest to below a stop, on its floor; None when there is none nearby."""
    layer = known.free.land
    gap = np.linalg.norm(known.places_m[:, :2] - stop.pose.position_m[:2], axis=1)
    gap += np.abs(layer.floor_z_m - stop.floor_z_m)
    gap[layer.reach != stop.reach] = np.inf
    best = int(gap.argmin())
    return best if gap[best] <= PLACE_M else None
