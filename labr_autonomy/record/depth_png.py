"""Depth images as 16-bit PNG, the way `/depth` keeps them."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np

from labr_autonomy.types import Image

DEPTH_SCALE_M = 0.001


def encode_depth(depth_m: Image) -> bytes:
    """16-bit PNG of a depth image (h, w) [m] in units of DEPTH_SCALE_M; 0 = invalid."""
    import cv2  # heavy; only the thread needs it

    units = np.nan_to_num(depth_m / DEPTH_SCALE_M, nan=0.0, posinf=0.0, neginf=0.0)
    scaled = np.clip(np.rint(units), 0, 65535).astype(np.uint16)
    return bytes(cv2.imencode(".png", scaled)[1])


def decode_depth(message: Mapping[str, Any]) -> Image:
    """The depth image (h, w) float32 [m] of a `/depth` message."""
    import cv2

    raw = np.frombuffer(base64.b64decode(message["data"]), dtype=np.uint8)
    return np.asarray(cv2.imdecode(raw, cv2.IMREAD_UNCHANGED), dtype=np.float32) * np.float32(
        message["scale_m"]
    )
