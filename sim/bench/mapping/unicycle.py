"""A unicycle that follows a curve: limits hold by construction, and it always comes to rest."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

STEP_S = 0.05
LONGEST_S = 14.0
YAW_GAIN = 3.5  # 1/s, on the error of heading
SIDE_GAIN = 5.0  # 1/m^2, on the error to the side, times speed
TURNED_RAD, TURNED_MPS = 0.5, 0.3  # with a heading error beyond it no faster than that
CLOSE_M = 0.012  # of the end: there


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _wrap(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def rollout(x0: Any, curve: Any, caps: Any, spacing: float, limits: Any) -> Any:
    """Follow a curve from a state, in steps of `STEP_S` with constant accelerations.

    Args:
        x0: (5,) x, y [m], yaw [rad], speed [m/s], yaw rate [rad/s].
        curve: (n, 4) x, y [m], heading [rad], curvature [1/m], every `spacing` [m].
        caps: (n,) speeds from which the curve's end can be braked for [m/s].
        spacing: Of the curve [m].
        limits: acceleration, yaw rate, yaw acceleration.

    Returns:
        (k, 7): the state and the two accelerations that hold from it on; at rest in the last row.
    """
    most_a, most_w, most_alpha = limits
    n = len(curve)
    longest = int(LONGEST_S / STEP_S)
    out = np.zeros((longest + 400, 7))
    out[0, :5] = x0
    at = 0
    ending = False
    k = 0
    while k < len(out) - 1:
        x, y, yaw, v, w = out[k, 0], out[k, 1], out[k, 2], out[k, 3], out[k, 4]
        while at < n - 1:  # forward to the nearest point of the curve
            here = (curve[at, 0] - x) ** 2 + (curve[at, 1] - y) ** 2
            if (curve[at + 1, 0] - x) ** 2 + (curve[at + 1, 1] - y) ** 2 > here:
                break
            at += 1
        c, s = math.cos(curve[at, 2]), math.sin(curve[at, 2])
        along = (x - curve[at, 0]) * c + (y - curve[at, 1]) * s
        side = -(x - curve[at, 0]) * s + (y - curve[at, 1]) * c
        left = (n - 1 - at) * spacing - along
        ending = ending or left < CLOSE_M or k >= longest
        ahead = min(max(at + (along + 1.0 * v * STEP_S) / spacing, 0.0), n - 1.0)
        i = min(int(ahead), n - 2)
        f = ahead - i
        want_v, want_w = 0.0, 0.0
        if not ending:
            heading = curve[i, 2] + f * _wrap(curve[i + 1, 2] - curve[i, 2])
            error = _wrap(heading - yaw)
            want_v = max(caps[i] + f * (caps[i + 1] - caps[i]), 0.03)
            if abs(error) > TURNED_RAD:
                want_v = min(want_v, TURNED_MPS)
            bend = curve[i, 3] + f * (curve[i + 1, 3] - curve[i, 3])
            want_w = v * bend + YAW_GAIN * error - SIDE_GAIN * v * side
            want_w = min(max(want_w, -most_w), most_w)
        dv = min(max((want_v - v) / STEP_S, -most_a), most_a)
        dw = min(max((want_w - w) / STEP_S, -most_alpha), most_alpha)
        out[k, 5], out[k, 6] = dv, dw
        for j in range(3):  # Simpson's rule over the exact speed and heading
            t = 0.5 * STEP_S * j
            share = STEP_S / 6.0 * (4.0 if j == 1 else 1.0)
            turned = yaw + w * t + 0.5 * dw * t * t
            x += share * (v + dv * t) * math.cos(turned)
            y += share * (v + dv * t) * math.sin(turned)
        k += 1
        out[k, 0], out[k, 1] = x, y
        out[k, 2] = yaw + w * STEP_S + 0.5 * dw * STEP_S * STEP_S
        out[k, 3], out[k, 4] = v + dv * STEP_S, w + dw * STEP_S
        if ending and abs(out[k, 3]) < 1e-9 and abs(out[k, 4]) < 1e-9:
            break
    out[k, 3:] = 0.0
    return out[: k + 1]
