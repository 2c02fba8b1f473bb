"""Maps as if the robot had looked all round, for the tests of this folder."""

from __future__ import annotations

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.types import DepthFrame

CONFIG = RobotConfig()


def looked_round(pipeline, pose):
    """Take a pipeline's map to a pose and let all floor round it be free; the map, to be painted on."""
    optics = CONFIG.camera.intrinsics
    nothing = DepthFrame(1, 0.0, np.zeros((optics.height, optics.width), np.float32), optics)
    grid = pipeline._map
    grid.update(nothing, pose, 0.0)  # the map follows it there
    grid.driving.bands[:], grid.driving.odds[:] = -20, -20
    return grid
