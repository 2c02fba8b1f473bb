"""The depth image as a small picture for people."""

from __future__ import annotations

import numpy as np

from labr_autonomy.types import Image

FAR_M = 6.0  # drawn darkest
QUALITY = 70


def depth_jpeg(depth_m: Image) -> bytes:
    """JPEG of a depth image (h, w) [m]: near is bright, what was not measured is black."""
    import cv2  # heavy

    known = np.nan_to_num(depth_m, nan=0.0, posinf=0.0, neginf=0.0)
    near = 1.0 - np.clip(known / FAR_M, 0.0, 1.0)
    shade = (40.0 + 215.0 * near).astype(np.uint8)
    picture = cv2.applyColorMap(shade, cv2.COLORMAP_CIVIDIS)  # readable without colour vision
    picture[known <= 0.0] = 0
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return data.tobytes()
