"""Pictures of trials: the world from above, cut at driving height, and the true way."""

from __future__ import annotations

import io
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import NDArray

from labr_autonomy.config import RobotConfig
from labr_autonomy.record.pictures import AIR, BAD, FAINT, INK, LAND, START
from labr_autonomy.types import Array, Image
from sim.lockstep.trial import Task, TrialResult
from sim.worlds.build import rebuild_world
from sim.worlds.world import World

WALL = "#6f7885"
MOVER = "#8a4f9e"  # track of a mover, and its size at both ends
CUTS_M = (0.06, 0.16, 0.26, 0.36)  # above the floor: what a driving robot can meet
FLAT = 0.75  # faces whose normal is steeper than this are floor, ramp or ground, no obstacle
MARGIN_M = 1.5
DEPTH_SHOWN_M = 8.0

STYLE: dict[str, Any] = {
    "font.size": 8,
    "font.family": "DejaVu Sans",
    "text.color": INK,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlesize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "grid.color": "#e6e9ed",
}


def outlines(world: World, floors_m: Array) -> NDArray[np.float64]:
    """Where the world's steep faces meet level planes a little above some floors.

    Args:
        world: Its triangles are cut.
        floors_m: (k,) heights of floors [m, odom].

    Returns:
        (n, 2, 2) segments, x and y of both ends [m, odom].
    """
    corners = world.triangles_m.astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    corners = corners[np.abs(normals[:, 2]) < FLAT * length]
    parts = [_cut(corners, float(floor) + cut) for floor in floors_m for cut in CUTS_M]
    return np.concatenate(parts) if parts else np.zeros((0, 2, 2))


def _cut(corners: Array, z_m: float) -> Array:
    """Segments in which triangles (n, 3, 3) meet the plane at a height."""
    above = corners[:, :, 2] > z_m
    crossing = corners[above.any(axis=1) & ~above.all(axis=1)]
    if not len(crossing):
        return np.zeros((0, 2, 2))
    over = crossing[:, :, 2] > z_m
    lone_above = over.sum(axis=1) == 1
    apex = np.where(lone_above, over.argmax(axis=1), (~over).argmax(axis=1))
    rows = np.arange(len(crossing))
    tip = crossing[rows, apex]
    ends = []
    for step in (1, 2):
        other = crossing[rows, (apex + step) % 3]
        share = (z_m - tip[:, 2]) / (other[:, 2] - tip[:, 2])
        ends.append(tip[:, :2] + share[:, None] * (other[:, :2] - tip[:, :2]))
    segments: Array = np.stack(ends, axis=1)
    return segments


def track_of(result: TrialResult) -> tuple[Array, NDArray[np.bool_]]:
    """Places (n, 3) odom [m] and whether each was flown (n,)."""
    table = np.array(result.track, dtype=np.float64).reshape(-1, 5)
    return table[:, 1:4], table[:, 4] > 0.5


def draw_top(axes: Axes, world: World, task: Task, result: TrialResult | None, *, near: bool = False) -> None:
    """The world from above with start, goal and way.

    Args:
        axes: Where.
        world: The task's.
        task: Start and goal.
        result: Its way; None for the world alone.
        near: Show where the robot was at the end rather than all of its way.
    """
    robot = RobotConfig().body
    places, flown = track_of(result) if result is not None else (np.zeros((0, 3)), np.zeros(0, bool))
    ends = np.array([task.start[:2], task.goal_m[:2]])
    centre = places[-1:, :2] if near and len(places) else np.vstack([ends, places[:, :2]])
    low, high = centre.min(axis=0) - MARGIN_M, centre.max(axis=0) + MARGIN_M
    half = max(float((high - low).max()) / 2.0, 2.5)
    middle = (low + high) / 2.0
    driven = places[~flown][:, 2] - robot.below_m
    floors = np.array([task.start[3]]) if not len(driven) else np.unique(np.round(driven * 2.0) / 2.0)
    floors = np.union1d(floors, [task.start[3]])
    segments = outlines(world, floors)
    inside = (np.abs(segments - middle) < half * 1.05).all(axis=2).any(axis=1) | _long(segments)
    axes.add_collection(LineCollection(list(segments[inside]), colors=WALL, linewidths=0.8, zorder=2))
    for mover in task.movers:
        axes.add_collection(LineCollection([mover["ends_m"]], colors=MOVER, linewidths=1.2, zorder=3))
        for x_m, y_m in mover["ends_m"]:
            reach = max(mover["shape"]["half_m"])
            axes.add_patch(Circle((x_m, y_m), reach, fill=False, ec=MOVER, linewidth=0.8, zorder=3))
    draw_way(axes, places[:, :2], flown)
    axes.plot(*ends[0], "s", ms=6, mfc="white", mec=START, mew=1.6, zorder=6)
    axes.plot(*ends[1], "o", ms=8, mfc="white", mec=AIR if task.in_air else LAND, mew=1.8, zorder=6)
    if result is not None and result.outcome != "reached" and len(places):
        axes.plot(*places[-1, :2], "X", ms=8, mfc=BAD, mec="white", mew=0.8, zorder=7)
        axes.add_patch(
            Circle(
                (places[-1, 0], places[-1, 1]), robot.radius_m, fill=False, ec=BAD, linewidth=0.9, zorder=7
            )
        )
    axes.set(
        xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half), aspect="equal"
    )
    axes.tick_params(labelsize=6, length=2)


def _long(segments: Array) -> NDArray[np.bool_]:
    """Segments that may cross the view with both ends outside."""
    found: NDArray[np.bool_] = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) > 2.0
    return found


def draw_way(axes: Axes, points: Array, flown: NDArray[np.bool_]) -> None:
    """A way (n, 2) in the colours of its modes."""
    if len(points) < 2:
        return
    colours = np.where(flown[1:], AIR, LAND)
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    axes.add_collection(LineCollection(list(pieces), colors=colours.tolist(), linewidths=1.8, zorder=5))


def draw_side(axes: Axes, task: Task, result: TrialResult) -> None:
    """Height of the body over the way travelled."""
    places, flown = track_of(result)
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1))])
    draw_way(axes, np.column_stack([travelled[: len(places)], places[:, 2]]), flown)
    axes.axhline(task.start[3], color=FAINT, linewidth=0.8)
    colour = AIR if task.in_air else LAND
    goal_at = float(travelled[-1] + np.linalg.norm(places[-1, :2] - task.goal_m[:2]))
    axes.plot(goal_at, task.goal_m[2], "o", ms=7, mfc="white", mec=colour, mew=1.6, zorder=6)
    heights = np.append(places[:, 2], [task.goal_m[2], task.start[3] + 0.5])
    axes.set(
        xlim=(0.0, max(goal_at * 1.02, 0.1)),
        ylim=(min(task.start[3], heights.min()) - 0.1, heights.max() + 0.3),
    )
    axes.set(xlabel="distance travelled [m]", ylabel="height [m]")


def last_depth(world: World, result: TrialResult) -> Image | None:
    """What the camera would see at the end, without noise, looking along the last motion; (h, w) [m].

    The track holds places alone, so the heading is that of the last 10 cm travelled.
    """
    from sim.camera.rays import RayRenderer

    places, _ = track_of(result)
    if len(places) < 2:
        return None
    away = np.flatnonzero(np.linalg.norm(places[:, :2] - places[-1, :2], axis=1) > 0.1)
    if not len(away):
        return None
    along = places[-1, :2] - places[away[-1], :2]
    along = along / np.linalg.norm(along)
    camera = RobotConfig().camera
    pose = np.eye(4)
    pose[:2, 0] = along
    pose[:2, 1] = [-along[1], along[0]]
    pose[:3, 3] = [*(places[-1, :2] + camera.x_m * along), places[-1, 2] + camera.z_m]
    return RayRenderer(world, camera.intrinsics, camera.range_max_m).depth(pose)


def draw_depth(axes: Axes, depth_m: Image) -> None:
    """A depth image; what has no depth is dark."""
    colours = mpl.colormaps["bone_r"].with_extremes(bad="#2b2f36")
    shown = np.ma.masked_less_equal(depth_m, 0.0)
    axes.imshow(shown, cmap=colours, vmin=0.0, vmax=DEPTH_SHOWN_M, interpolation="nearest")
    axes.set_axis_off()


def trial_picture(task: Task, result: TrialResult, title: str) -> bytes:
    """One trial from above and from the side; PNG."""
    world = rebuild_world(task.world)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.0, 9.4), layout="constrained")
        top, side = figure.subplots(2, 1, height_ratios=(4.0, 1.0))
        top.set_title(f"{title}: {result.outcome}, {result.time_s:.0f} s, {result.energy_j / 1e3:.2f} kJ")
        draw_top(top, world, task, result)
        top.set(xlabel="x [m]", ylabel="y [m]")
        figure.legend(
            handles=key(movers=bool(task.movers)),
            loc="outside lower center",
            ncols=6,
            frameon=False,
            fontsize=7,
        )
        if len(result.track):
            draw_side(side, task, result)
        return png(figure)


def key(*, movers: bool = False) -> list[Line2D]:
    """What the marks mean."""
    walked = [Line2D([], [], color=MOVER, linewidth=1.2, label="tracks of people and boxes")]
    return [
        Line2D([], [], color=LAND, linewidth=2.0, label="driven"),
        Line2D([], [], color=AIR, linewidth=2.0, label="flown"),
        Line2D([], [], marker="s", ls="", ms=6, mfc="white", mec=START, mew=1.6, label="start"),
        Line2D([], [], marker="o", ls="", ms=7, mfc="white", mec=INK, mew=1.6, label="goal"),
        Line2D([], [], marker="X", ls="", ms=7, mfc=BAD, mec="white", label="end away from the goal"),
        Line2D([], [], color=WALL, linewidth=1.0, label="obstacles at driving height"),
        *(walked if movers else []),
    ]


def png(figure: Figure) -> bytes:
    """The figure as a file."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=130)
    return out.getvalue()
