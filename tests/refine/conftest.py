from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from labr_autonomy.config import RobotConfig
from labr_autonomy.refine.planner import Refiner


@pytest.fixture(scope="session")
def refiner():
    return Refiner(RobotConfig())
