"""A picture of a world for people: from above without its roofs, and what the robot's camera sees in it.

Rays by Embree, Lambert shading with shadows; nothing that the simulator itself needs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.config import Body, Camera
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.types import Array, Image, Pose
from sim.camera.process import camera_pose
from sim.camera.rays import RayRenderer
from sim.worlds.surface import REACH_M, Surface
from sim.worlds.world import World

SIZE_PX = (900, 600)
SAMPLES = 2  # rays per pixel along each side
CUT_M = 2.6  # above the floor of the region nothing is drawn that faces down
TILT_RAD = math.radians(52.0)  # of the view below the horizon
TURN_RAD = math.radians(68.0)  # of the view to the left of the longer side
SUN = np.array([0.45, 0.3, 0.84]) / np.linalg.norm([0.45, 0.3, 0.84])
AMBIENT = 0.66
SUNLIGHT = 0.46
PAPER = np.array([0.972, 0.972, 0.965])
LAND = np.array([0.10, 0.42, 0.75])
AIR = np.array([0.88, 0.33, 0.10])
INSET_PX = (212, 120)
LEVEL = 0.9  # upright part of a normal from which on a surface is level
COVERED = 0.6  # share of the region under level surfaces from which on there is a roof
FILL = 0.92  # of the picture
SKY_REACH_M = 3.0  # farther things do not darken a place
TALL_M = 2.2  # height over which the colours run, at least
GROUND_M = 0.05
MARGIN_PX = 14
_EPS_M = 1e-3
BACKS = 0.1
CUT = np.array([0.45, 0.47, 0.50])
GROUND = np.array([0.86, 0.85, 0.81])
_STOPS = np.array([0.0, 0.35, 0.7, 1.0])
_RAMP = np.array([[0.80, 0.58, 0.36], [0.62, 0.66, 0.52], [0.50, 0.66, 0.68], [0.72, 0.78, 0.84]])
_SKY = np.array(
    [[0.8 * math.cos(a), 0.8 * math.sin(a), 0.6] for a in np.arange(0.4, 6.6, math.pi / 6)]
    + [[0.0, 0.0, 1.0]]
)

Track = Sequence[Sequence[float]]  # rows t [s], x, y, z [m] odom, 1 in the air: as in TrialResult.track
Floats = NDArray[np.float32]


class _View(NamedTuple):
    """A camera without perspective."""

    ahead: Array  # (3,) unit vectors, odom
    right: Array
    up: Array
    centre_m: Array  # (3,) what lies in the middle of the picture
    metres_per_px: float

    def pixel(self, points_m: Array) -> Array:
        """Points (n, 3) in the picture, (n, 2): across and down [px]."""
        away = points_m - self.centre_m
        across, high = away @ self.right, away @ self.up
        w, h = SIZE_PX
        return np.column_stack([w / 2 + across / self.metres_per_px, h / 2 - high / self.metres_per_px])


def portrait(
    world: World,
    surface: Surface,
    path: Path,
    *,
    tracks: Sequence[Track] = (),
    cut_m: float | None = None,
    eye: tuple[float, float, float, float] | None = None,
) -> None:
    """Draw a world into a PNG file of 900 x 600.

    Args:
        world: What is drawn.
        surface: Its surface, for a free place to look from.
        path: The file.
        tracks: Ways that were taken, drawn over it: blue on wheels, orange in the air.
        cut_m: Height [m, odom] above which nothing is drawn; by default roofs are taken off and trees kept.
        eye: Body origin x, y, z [m, odom] and yaw [rad] of the inset's camera; by default a free place from
            which most is seen.
    """
    import cv2

    scene = _opened(world, cut_m)
    view = _frame_of(world, scene)
    colours = _shaded(scene, view, world)
    # Steps of 4 in 256 are not seen and halve the file.
    image = (
        np.ascontiguousarray(4.0 * np.rint(255.0 / 4.0 * colours[..., ::-1])).clip(0, 255).astype(np.uint8)
    )
    for track in tracks:
        _draw_track(image, view, np.asarray(track, dtype=np.float64))
    _inset(image, world, surface, eye)
    cv2.imwrite(str(path), image, [cv2.IMWRITE_PNG_COMPRESSION, 9])


class _Scene:
    """Triangles for Embree."""

    def __init__(self, triangles_m: Floats) -> None:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        edges = np.diff(triangles_m.astype(np.float64), axis=1)
        normals = np.cross(edges[:, 0], edges[:, 1])
        self.upper_m = triangles_m.reshape(-1, 3).max(axis=0).astype(np.float64)
        self.normals = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
        self._scene = rtcore_scene.EmbreeScene()
        self._mesh = TriangleMesh(self._scene, np.ascontiguousarray(triangles_m))

    def first(self, origins_m: Array, directions: Array) -> tuple[Array, NDArray[np.int64]]:
        """Distance [m] to the first hit and its triangle, -1 without one."""
        found = self._scene.run(
            np.ascontiguousarray(origins_m, np.float32),
            np.ascontiguousarray(np.broadcast_to(directions, origins_m.shape), np.float32),
            output=1,
        )
        return found["tfar"].astype(np.float64), found["primID"].astype(np.int64)


def _opened(world: World, cut_m: float | None) -> _Scene:
    """The world below the cut; triangles that cross it are clipped."""
    if cut_m is None:
        cut_m = _roof_m(world)
    return _Scene(_clipped(world.triangles_m, cut_m) if math.isfinite(cut_m) else world.triangles_m)


def _roof_m(world: World) -> float:
    """CUT_M above the region's floor where level surfaces cover most of the region, else nowhere."""
    low, high = world.region_m
    x, y = (np.linspace(low[k], high[k], 22)[1:-1] for k in (0, 1))
    gx, gy = np.meshgrid(x, y)
    scene = _Scene(world.triangles_m)
    origins = np.column_stack([gx.ravel(), gy.ravel(), np.full(gx.size, low[2] + CUT_M)])
    _, triangle = scene.first(origins, np.array([0.0, 0.0, 1.0]))
    level = np.abs(scene.normals[triangle, 2]) > LEVEL
    return float(low[2] + CUT_M) if (level & (triangle >= 0)).mean() > COVERED else math.inf


def _clipped(triangles_m: Floats, cut_m: float) -> Floats:
    """What of the triangles (n, 3, 3) lies below a height."""
    below = triangles_m[..., 2] < cut_m
    whole = triangles_m[below.all(axis=1)]
    parts = [whole]
    for count in (1, 2):
        some = triangles_m[below.sum(axis=1) == count]
        if len(some) == 0:
            continue
        # The odd corner out comes first: the one below of one, the one above of two.
        odd = np.argmax((some[..., 2] < cut_m) == (count == 1), axis=1)
        a, b, c = (some[np.arange(len(some)), (odd + k) % 3] for k in range(3))
        ab, ac = (
            a + (p - a) * ((cut_m - a[:, 2]) / (p[:, 2] - a[:, 2]))[:, None].astype(np.float32)
            for p in (b, c)
        )
        if count == 1:
            parts.append(np.stack([a, ab, ac], axis=1))
        else:
            parts += [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
    return np.concatenate(parts).astype(np.float32)


def _frame_of(world: World, scene: _Scene) -> _View:
    """The view that just holds the world's region."""
    low, high = np.maximum(world.region_m[0], world.lower_m), np.minimum(world.region_m[1], scene.upper_m)
    wide, deep = (high - low)[:2]
    flat, turn = math.cos(TILT_RAD), TURN_RAD + (math.pi / 2 if deep > 1.2 * wide else 0.0)
    ahead = np.array([flat * math.cos(turn), flat * math.sin(turn), -math.sin(TILT_RAD)])
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    pick = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=bool)
    corners = np.where(pick, high, low)
    across, along = corners @ right, corners @ up
    scale = max(np.ptp(across) / (SIZE_PX[0] * FILL), np.ptp(along) / (SIZE_PX[1] * FILL))
    centre = right * (across.max() + across.min()) / 2 + up * (along.max() + along.min()) / 2
    return _View(ahead, right, up, centre, float(scale))


def _shaded(scene: _Scene, view: _View, world: World) -> Array:
    """The picture (h, w, 3), 0..1, red first."""
    w, h = SIZE_PX[0] * SAMPLES, SIZE_PX[1] * SAMPLES
    step = view.metres_per_px / SAMPLES
    across = (np.arange(w) - 0.5 * (w - 1)) * step
    high = (0.5 * (h - 1) - np.arange(h)) * step
    back_m = 2.0 * float(np.linalg.norm(world.upper_m - world.lower_m))
    start = view.centre_m - back_m * view.ahead
    origins = (start + high[:, None, None] * view.up + across[:, None] * view.right).reshape(-1, 3)
    distance, triangle = scene.first(origins, view.ahead)
    seen = np.flatnonzero(triangle >= 0)
    points = origins[seen] + distance[seen, None] * view.ahead
    normals = scene.normals[triangle[seen]]
    back = normals @ view.ahead > 0.0
    normals *= -np.sign(normals @ view.ahead)[:, None]  # meshes in the wild are wound either way
    light = _light(scene, points + _EPS_M * normals, normals)
    colours = np.tile(PAPER, (h * w, 1))
    colours[seen] = np.clip(_paint(points, normals, world) * light[:, None], 0.0, 1.0)
    if back.mean() < BACKS:  # where faces are wound outwards, a back is the inside of something cut open
        colours[seen[back]] = CUT
    picture: Array = colours.reshape(SIZE_PX[1], SAMPLES, SIZE_PX[0], SAMPLES, 3).mean(axis=(1, 3))
    return picture


def _light(scene: _Scene, points_m: Array, normals: Array) -> Array:
    """Sun with shadows, and sky by how much of it a few rays see."""
    sun = np.maximum(normals @ SUN, 0.0)
    _, hit = scene.first(points_m, SUN)
    sun[hit >= 0] = 0.0
    sky = np.zeros(len(points_m))
    weight = np.zeros(len(points_m))
    for direction in _SKY:
        facing = np.maximum(normals @ direction, 0.0)
        distance, hit = scene.first(points_m, direction)
        sky += facing * ((hit < 0) | (distance > SKY_REACH_M))
        weight += facing
    light: Array = AMBIENT * (0.4 + 0.6 * sky / np.maximum(weight, 1e-6)) + SUNLIGHT * sun
    return light


def _paint(points_m: Array, normals: Array, world: World) -> Array:
    """Colours by height over the region's floor; level ground near it is pale."""
    low = float(world.region_m[0, 2])
    top = max(TALL_M, 0.6 * (float(world.upper_m[2]) - low))
    share = np.clip((points_m[:, 2] - low) / min(top, 3.0 * TALL_M), 0.0, 1.0)
    colours = np.column_stack([np.interp(share, _STOPS, _RAMP[:, k]) for k in range(3)])
    ground = (normals[:, 2] > 0.8) & (points_m[:, 2] < low + GROUND_M)
    colours[ground] = GROUND
    return colours


def _draw_track(image: NDArray[np.uint8], view: _View, rows: Array) -> None:
    """A way: a line with a white seam, round at its ends."""
    import cv2

    pixels = np.rint(view.pixel(rows[:, 1:4]) * 16).astype(np.int32)
    for colour, width in ((None, 5), (rows[:, 4], 3)):
        for number in range(len(pixels) - 1):
            bgr = (255.0, 255.0, 255.0)
            if colour is not None:
                r, g, b = 255.0 * (AIR if colour[number + 1] > 0 else LAND)
                bgr = (float(b), float(g), float(r))
            (x0, y0), (x1, y1) = pixels[number : number + 2].tolist()
            cv2.line(image, (x0, y0), (x1, y1), bgr, width, cv2.LINE_AA, 4)
    for place, colour_rgb in ((pixels[0], LAND), (pixels[-1], AIR)):
        r, g, b = 255.0 * colour_rgb
        cv2.circle(image, (int(place[0]), int(place[1])), 6 * 16, (255, 255, 255), -1, cv2.LINE_AA, 4)
        cv2.circle(image, (int(place[0]), int(place[1])), 4 * 16, (b, g, r), -1, cv2.LINE_AA, 4)


def _inset(
    image: NDArray[np.uint8], world: World, surface: Surface, eye: tuple[float, float, float, float] | None
) -> None:
    """The depth image from a place of the robot, near is bright, in the lower right corner with a frame."""
    import cv2

    camera = Camera()
    renderer = RayRenderer(world, camera.intrinsics, camera.range_max_m)
    places = [eye] if eye is not None else _places(world, surface)
    images = [renderer.depth(camera_pose(_pose(*place), camera)) for place in places]
    renderer.close()
    depth = max(images, key=_richness)
    share = np.where(depth > 0.0, 1.0 - np.sqrt(depth / camera.range_max_m), 0.0)
    picture = cv2.applyColorMap(np.rint(255.0 * share).astype(np.uint8), cv2.COLORMAP_INFERNO)
    picture = cv2.resize(picture, INSET_PX, interpolation=cv2.INTER_AREA)
    framed = cv2.copyMakeBorder(picture, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=(255, 255, 255))
    h, w = framed.shape[:2]
    image[-h - MARGIN_PX : -MARGIN_PX, -w - MARGIN_PX : -MARGIN_PX] = framed


def _pose(x_m: float, y_m: float, z_m: float, yaw_rad: float) -> Pose:
    return Pose(np.array([x_m, y_m, z_m]), quaternion_from_rpy(0.0, 0.0, yaw_rad))


def _richness(depth_m: Image) -> float:
    """How much there is to see: steps of depth, where most of the view is within range."""
    seen = depth_m > 0.0
    steps = (np.abs(np.diff(np.log(np.maximum(depth_m, 0.3)), axis=1)) > 0.1).mean()
    near = (seen & (depth_m < 0.8)).mean()
    return float(steps + 0.05 * seen.mean() - 0.2 * near)


def _places(world: World, surface: Surface) -> list[tuple[float, float, float, float]]:
    """Free places over the floor near the middle of the region, each with eight headings."""
    body = Body()
    rng = np.random.default_rng([900, 600])
    low, high = world.region_m
    middle, half = (low + high) / 2, (high - low) / 2
    places: list[tuple[float, float, float, float]] = []
    for x, y in middle[:2] + rng.uniform(-0.6, 0.6, (60, 2)) * half[:2]:
        floor_m = surface.floor_below(float(x), float(y), float(low[2]) + 0.5)
        z = floor_m + body.below_m
        if not math.isfinite(floor_m) or surface.clearance(np.array([x, y, z]), on_floor=True) < 0.3:
            continue
        places += [(float(x), float(y), z, k * math.pi / 4) for k in range(8)]
        if len(places) >= 64:
            break
    return places or [(float(middle[0]), float(middle[1]), float(low[2]) + REACH_M, 0.0)]
