"""What a network may see besides the image: the ground around the robot from above, in the level frame."""

from __future__ import annotations

SIDE = 64  # cells
CHANNELS = 8
