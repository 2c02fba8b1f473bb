"""Pictures of the report, drawn without a display. Land is orange, air is blue: told apart by every eye."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from labr_autonomy.frames import rotation_matrix
from labr_autonomy.record.depth_png import decode_depth
from labr_autonomy.record.run_data import RunData, Track
from labr_autonomy.types import Array

LAND = "#d9730d"
AIR = "#1668c7"
INK = "#22272e"
FAINT = "#8b949e"
OBSTACLE = "#c3c9d1"
START = "#2e7d32"
BAD = "#c62828"
MU_LIMIT = 0.5  # from here on the network's path is not used
TRACK_POINTS = 1500
PLANS_DRAWN = 120
DEPTH_SHOWN_M = 8.0
NEAR_M = 0.6  # obstacles nearer to the way than this are told in the side view
CELL_M = 0.1  # of the rolling map
CELLS_MAX = 2000  # a side

STYLE = {
    "font.size": 9,
    "font.family": "DejaVu Sans",
    "text.color": INK,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "grid.color": "#e6e9ed",
    "svg.hashsalt": "labr",
    "svg.fonttype": "path",
}


def top_view(data: RunData) -> bytes | None:
    """Map, planned and true trail, goals and start, from above; SVG."""
    track = data.track
    goals = list(_goals(data))
    if track is None and not goals:
        return None
    with mpl.rc_context(STYLE):
        extent = _extent(data, goals)
        aspect = (extent[3] - extent[2]) / (extent[1] - extent[0])
        figure = Figure(figsize=(9.0, min(8.0, max(3.2, 8.2 * aspect + 0.9))), layout="constrained")
        axes = figure.add_subplot()
        axes.grid(True, linewidth=0.6)
        axes.set_axisbelow(True)
        if data.occupied_xy_m is not None:
            _draw_map(axes, data.occupied_xy_m)
        axes.set(xlim=extent[:2], ylim=extent[2:], aspect="equal", xlabel="x [m]", ylabel="y [m]")
        _draw_plans(axes, data)
        if data.truth is not None and data.estimate is not None:
            thin = _thinned(data.estimate)
            axes.plot(
                thin.position_m[:, 0], thin.position_m[:, 1], color=INK, linewidth=0.7, linestyle=(0, (2, 2))
            )
        if track is not None:
            thin = _thinned(track)
            _draw_modes(axes, thin.position_m[:, :2], thin.air, width=2.4)
        _draw_start(axes, data)
        for number, goal, done in goals:
            colour = AIR if len(goal) > 2 else LAND
            axes.plot(
                goal[0], goal[1], "o", ms=15, mfc="white" if done else "#fde8e8", mec=colour, mew=2, zorder=6
            )
            axes.annotate(
                str(number), (goal[0], goal[1]), ha="center", va="center", fontsize=8, weight="bold", zorder=7
            )
        axes.legend(
            handles=_key(data), loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=6, frameon=False
        )
        return figure_bytes(figure, "svg")


def side_view(data: RunData) -> bytes | None:
    """Height of the body over the distance travelled; SVG."""
    track = data.track
    if track is None or len(track) < 2:
        return None
    thin = _thinned(track)
    steps = np.hypot(*np.diff(thin.position_m[:, :2], axis=0).T)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 2.4), layout="constrained")
        axes = figure.add_subplot()
        axes.axhspan(-0.5, 0.0, color="#eceff2", zorder=0)
        _draw_near(axes, data, thin, travelled)
        axes.grid(True, axis="y", linewidth=0.6)
        heights = thin.position_m[:, 2]
        _draw_modes(axes, np.column_stack([travelled, heights]), thin.air, width=2.0)
        for number, goal, _ in _goals(data):
            if len(goal) > 2:
                near = int(np.argmin(np.linalg.norm(thin.position_m - np.asarray(goal[:3]), axis=1)))
                axes.plot(travelled[near], goal[2], "o", ms=13, mfc="white", mec=AIR, mew=1.8, zorder=6)
                at = (float(travelled[near]), float(goal[2]))
                axes.annotate(
                    str(number), at, ha="center", va="center", fontsize=7.5, weight="bold", zorder=7
                )
        top = max(1.0, float(np.nanmax(heights)) * 1.15 + 0.15)
        axes.set(xlim=(0.0, max(float(travelled[-1]), 0.1)), ylim=(-0.08, top))
        axes.set(xlabel="distance travelled [m]", ylabel="height of the body [m]")
        return figure_bytes(figure, "svg")


def depth_view(message: Mapping[str, Any], plan: Mapping[str, Any] | None) -> bytes:
    """A depth frame with the network's key points drawn in; PNG."""
    depth = decode_depth(message)
    height, width = depth.shape
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(3.2, 3.2 * height / width), dpi=150)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
        axes.set_axis_off()
        shown = np.ma.masked_less_equal(depth, 0.0)
        colours = mpl.colormaps["bone_r"].with_extremes(bad="#2b2f36")
        axes.imshow(shown, cmap=colours, vmin=0.0, vmax=DEPTH_SHOWN_M, interpolation="nearest", aspect="auto")
        network = (plan or {}).get("network")
        if network and network.get("points_m"):
            _draw_key_points(axes, message, network)
        return figure_bytes(figure, "png")


def project(message: Mapping[str, Any], points_m: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Pixels (n, 2) u, v of points (n, 3) odom in a `/depth` message's image, and which lie in front."""
    body = (points_m - np.asarray(message["position_m"])) @ rotation_matrix(np.asarray(message["quaternion"]))
    camera = body - np.asarray(message["camera_in_body_m"])
    before = camera[:, 0] > 0.05
    x = np.where(before, camera[:, 0], 1.0)
    k = message["intrinsics"]
    u = k["cx"] - k["fx"] * camera[:, 1] / x
    v = k["cy"] - k["fy"] * camera[:, 2] / x
    return np.column_stack([u, v]), before


def _draw_key_points(axes: Axes, message: Mapping[str, Any], network: Mapping[str, Any]) -> None:
    points = np.asarray(network["points_m"], dtype=np.float64)
    pixels, before = project(message, points)
    air = np.asarray(network["air"], dtype=bool)
    size = np.array([message["width"], message["height"]])
    inside = before & (pixels > -0.5).all(axis=1) & (pixels < size - 0.5).all(axis=1)
    axes.plot(pixels[before, 0], pixels[before, 1], color="white", linewidth=3.0, alpha=0.9, zorder=3)
    axes.plot(pixels[before, 0], pixels[before, 1], color=INK, linewidth=1.2, zorder=3)
    for (u, v), flown in zip(pixels[inside], air[inside], strict=True):
        axes.plot(
            u, v, "^" if flown else "o", ms=8, mfc=AIR if flown else LAND, mec="white", mew=1.4, zorder=4
        )


def _draw_plans(axes: Axes, data: RunData) -> None:
    paths = [
        np.asarray(p["path_m"], dtype=np.float64)[:, :2] for p in data.plans if len(p.get("path_m") or ()) > 1
    ]
    chosen = paths[:: max(1, math.ceil(len(paths) / PLANS_DRAWN))]
    if chosen:
        axes.add_collection(LineCollection(chosen, colors="#7b5ea7", linewidths=0.6, alpha=0.45, zorder=3))


def _draw_modes(axes: Axes, points: Array, air: NDArray[np.bool_], width: float) -> None:
    for first, last in _runs(air):
        part = points[first : last + 2]  # one point more, so that the trail has no gaps
        axes.plot(part[:, 0], part[:, 1], color=AIR if air[first] else LAND, linewidth=width, zorder=5)


def _draw_map(axes: Axes, cells_m: Array) -> None:
    """Occupied cells as one picture, so that the file stays small and the cells touch."""
    low, high = cells_m.min(axis=0) - CELL_M / 2, cells_m.max(axis=0) + CELL_M / 2
    shape = np.minimum(np.ceil((high - low) / CELL_M).astype(int) + 1, CELLS_MAX)
    index = np.minimum(((cells_m - low) / CELL_M).astype(int), shape - 1)
    taken = np.zeros(shape, dtype=bool)
    taken[index[:, 0], index[:, 1]] = True
    top = low + shape * CELL_M
    grey = mpl.colors.ListedColormap([OBSTACLE])
    image = np.ma.masked_equal(taken.T, False)
    extent = (low[0], top[0], low[1], top[1])
    axes.imshow(image, cmap=grey, origin="lower", extent=extent, interpolation="nearest", zorder=1)


def _draw_near(axes: Axes, data: RunData, track: Track, travelled: Array) -> None:
    """Where an obstacle of the map stands beside the way; its height is not known here."""
    if data.occupied_xy_m is None:
        return
    distance, _ = cKDTree(data.occupied_xy_m).query(track.position_m[:, :2])
    for first, last in _runs(distance < NEAR_M):
        if distance[first] < NEAR_M:
            axes.axvspan(travelled[first], travelled[last] + 0.02, ymax=0.16, color=OBSTACLE, zorder=1)


def _draw_start(axes: Axes, data: RunData) -> None:
    start = data.summary.get("start_m")
    if not start and data.track is not None:
        start = data.track.position_m[0]
    if start is not None and len(start) >= 2:
        axes.plot(start[0], start[1], "s", ms=10, mfc="white", mec=START, mew=2.2, zorder=6)


def _runs(flags: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """First and last index of each stretch of equal flags."""
    edges = np.flatnonzero(np.diff(flags.astype(np.int8))) + 1
    starts = [0, *edges.tolist()]
    yield from zip(starts, [*(e - 1 for e in edges.tolist()), len(flags) - 1], strict=True)


def _thinned(track: Track) -> Track:
    step = max(1, len(track) // TRACK_POINTS)
    return Track(track.stamp_s[::step], track.position_m[::step], track.air[::step])


def _goals(data: RunData) -> Iterator[tuple[int, list[float], bool]]:
    """Number, place and whether it was reached, for each item with a goal."""
    for leg in data.summary.get("legs") or ():
        goal = leg.get("goal_m")
        if goal and len(goal) >= 2:
            yield int(leg.get("index", 0)) + 1, [float(v) for v in goal], leg.get("outcome") == "done"


def _extent(data: RunData, goals: list[tuple[int, list[float], bool]]) -> tuple[float, float, float, float]:
    parts = [np.array([g[:2] for _, g, _ in goals], dtype=np.float64).reshape(-1, 2)]
    if data.track is not None:
        parts.append(data.track.position_m[:, :2])
    if data.occupied_xy_m is not None:
        cells = data.occupied_xy_m
        parts.append(np.percentile(cells, [0.2, 99.8], axis=0))
    points = np.concatenate(parts)
    points = points[np.isfinite(points).all(axis=1)]
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.ones(2))
    middle, half = (low + high) / 2.0, np.maximum((high - low) / 2.0 + 0.7, 1.5)
    return middle[0] - half[0], middle[0] + half[0], middle[1] - half[1], middle[1] + half[1]


def _key(data: RunData) -> list[Line2D]:
    entries = [
        Line2D([], [], color=LAND, linewidth=2.4, label="driven"),
        Line2D([], [], color=AIR, linewidth=2.4, label="flown"),
        Line2D([], [], color="#7b5ea7", linewidth=1.0, alpha=0.7, label="planned"),
    ]
    if data.truth is not None and data.estimate is not None:
        entries.append(Line2D([], [], color=INK, linewidth=0.9, linestyle=(0, (2, 2)), label="estimate"))
    entries.append(Line2D([], [], marker="s", ls="", ms=8, mfc="white", mec=START, mew=2, label="start"))
    if data.occupied_xy_m is not None:
        entries.append(Line2D([], [], marker="s", ls="", ms=6, color=OBSTACLE, label="obstacles seen"))
    return entries


def figure_bytes(figure: Figure, kind: str) -> bytes:
    """A figure as a file."""
    out = io.BytesIO()
    figure.savefig(out, format=kind, metadata={"Date": None} if kind == "svg" else None)
    return out.getvalue()
