"""How far places along a path are from what hinders the robot there, with gradients.

Heights are *followed*: a place's z counts as if the floor went on level from under the robot, so that a path
up a ramp is one of constant z, and what flies differs from what drives on any floor.

Low places are judged by the field of driving of their view, which knows floors, drops and what the wheels
climb; high ones by the scene's distance to any surface; between DRIVEN_M and FLOWN_M above the driving
height by a mixture, whose slope also tells a path that it would be freer higher up.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import torch
from torch import Tensor

from labr_autonomy.gkpn.learning.views import Views
from labr_autonomy.gkpn.shards import LAND_CELL_M, NO_FLOOR

DRIVEN_M, FLOWN_M = 0.12, 0.40  # rise of the body above its driving height
CM = 0.01


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _corner(u: float, n: int) -> tuple[int, float, float]:
    """Cell, share and slope (0 beyond the rim) of linear interpolation at u, centres at whole numbers."""
    if u <= 0.0:
        return 0, 0.0, 0.0
    if u >= n - 1:
        return n - 2, 1.0, 0.0
    i = int(u)
    return i, u - i, 1.0


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _flat(field: Any, x: float, y: float, cell: float, out: Any) -> None:
    """Bilinear value of a field (n, m) [cm] at cells (x, y), and its slope per metre: out = value, dx, dy."""
    i, a, sa = _corner(x - 0.5, field.shape[0])
    j, b, sb = _corner(y - 0.5, field.shape[1])
    v00, v01 = float(field[i, j]), float(field[i, j + 1])
    v10, v11 = float(field[i + 1, j]), float(field[i + 1, j + 1])
    low, high = v00 + (v01 - v00) * b, v10 + (v11 - v10) * b
    out[0] = CM * (low + (high - low) * a)
    out[1] = CM * sa * (high - low) / cell
    out[2] = CM * sb * ((v01 - v00) * (1.0 - a) + (v11 - v10) * a) / cell


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _solid(values: Any, start: int, shape: Any, x: float, y: float, z: float, cell: float, out: Any) -> None:
    """Trilinear value at voxels (x, y, z), and its slope per metre: out = value, dx, dy, dz."""
    ny, nz = shape[1], shape[2]
    i, a, sa = _corner(x - 0.5, shape[0])
    j, b, sb = _corner(y - 0.5, ny)
    k, c, sc = _corner(z - 0.5, nz)
    base = start + (i * ny + j) * nz + k
    dx, dy = ny * nz, nz
    q = np.empty(8)
    for m in range(8):
        q[m] = values[base + (m >> 2) * dx + ((m >> 1) & 1) * dy + (m & 1)]
    e00, e01 = q[0] + (q[1] - q[0]) * c, q[2] + (q[3] - q[2]) * c
    e10, e11 = q[4] + (q[5] - q[4]) * c, q[6] + (q[7] - q[6]) * c
    f0, f1 = e00 + (e01 - e00) * b, e10 + (e11 - e10) * b
    g0 = (q[1] - q[0]) * (1.0 - b) + (q[3] - q[2]) * b
    g1 = (q[5] - q[4]) * (1.0 - b) + (q[7] - q[6]) * b
    out[0] = CM * (f0 + (f1 - f0) * a)
    out[1] = CM * sa * (f1 - f0) / cell
    out[2] = CM * sb * ((e01 - e00) * (1.0 - a) + (e11 - e10) * a) / cell
    out[3] = CM * sc * (g0 * (1.0 - a) + g1 * a) / cell


@numba.njit(cache=True, parallel=True)  # type: ignore[untyped-decorator,unused-ignore]
def _look(
    points: Any,
    view: Any,
    scene: Any,
    land: Any,
    floors: Any,
    corner: Any,
    ground: Any,
    air: Any,
    air_start: Any,
    air_shape: Any,
    air_origin: Any,
    air_cell: Any,
    drives: bool,
    distance: Any,
    slope: Any,
    rise: Any,
) -> None:
    side = land.shape[1]
    for n in numba.prange(points.shape[0]):
        v = view[n]
        s = scene[v]
        cell = air_cell[s]
        out, above = np.empty(3), np.empty(4)
        for p in range(points.shape[1]):
            x, y, z = points[n, p, 0], points[n, p, 1], points[n, p, 2]
            u, w = (x - corner[v, 0]) / LAND_CELL_M, (y - corner[v, 1]) / LAND_CELL_M
            i, j = min(max(int(u), 0), side - 1), min(max(int(w), 0), side - 1)
            step = floors[v, i, j]
            true_z = z if step == NO_FLOOR else z + CM * step
            rise[n, p] = z - ground[v]
            share = min(max((rise[n, p] - DRIVEN_M) / (FLOWN_M - DRIVEN_M), 0.0), 1.0)
            if drives:
                share = 0.0
            total, gx, gy, gz = 0.0, 0.0, 0.0, 0.0
            low = 0.0
            if share < 1.0:
                _flat(land[v], u, w, LAND_CELL_M, out)
                low = out[0]
                total += (1.0 - share) * low
                gx += (1.0 - share) * out[1]
                gy += (1.0 - share) * out[2]
            if share > 0.0:
                _solid(
                    air,
                    air_start[s],
                    air_shape[s],
                    (x - air_origin[s, 0]) / cell,
                    (y - air_origin[s, 1]) / cell,
                    (true_z - air_origin[s, 2]) / cell,
                    cell,
                    above,
                )
                total += share * above[0]
                gx += share * above[1]
                gy += share * above[2]
                gz += share * above[3]
                if share < 1.0:
                    gz += (above[0] - low) / (FLOWN_M - DRIVEN_M)
            distance[n, p] = total
            slope[n, p, 0], slope[n, p, 1], slope[n, p, 2] = gx, gy, gz


class _Distance(torch.autograd.Function):  # type: ignore[misc]  # torch is untyped here
    """The kernel's values and slopes as a differentiable function of the places."""

    @staticmethod
    def forward(
        ctx: Any, points_m: Tensor, view: Tensor, views: Views, drives: bool
    ) -> tuple[Tensor, Tensor]:
        places = points_m.detach().to("cpu", torch.float32).contiguous().numpy()
        shape = places.shape[:2]
        distance, rise = np.empty(shape, np.float32), np.empty(shape, np.float32)
        slope = np.empty((*shape, 3), np.float32)
        air = views.air
        _look(
            places,
            view.cpu().numpy(),
            views.scene,
            views.land_cm,
            views.floors_cm,
            views.land_corner_m,
            views.poses[:, 2] + views.floor_m,
            air.values_cm,
            air.start,
            air.shape,
            air.origin_m,
            air.cell_m,
            drives,
            distance,
            slope,
            rise,
        )
        ctx.save_for_backward(torch.from_numpy(slope).to(points_m.device))
        out = torch.from_numpy(distance).to(points_m), torch.from_numpy(rise).to(points_m)
        return out

    @staticmethod
    def backward(ctx: Any, grad_distance: Tensor, grad_rise: Tensor) -> tuple[Tensor, None, None, None]:
        (slope,) = ctx.saved_tensors
        out = grad_distance[..., None] * slope
        out[..., 2] += grad_rise
        return out, None, None, None


def look(points_m: Tensor, view: Tensor, views: Views, *, drives: bool = False) -> tuple[Tensor, Tensor]:
    """Distances and heights of places.

    Args:
        points_m: (b, p, 3) body origins, odom, heights followed.
        view: (b,) whose field of driving counts.
        views: The data.
        drives: Judge all places as driven, whatever their height.

    Returns:
        Signed distance (b, p) to what hinders there [m], at most 1.27, and rise (b, p) of the body above its
        driving height [m].
    """
    distance, rise = _Distance.apply(points_m, view, views, drives)
    return distance, rise
