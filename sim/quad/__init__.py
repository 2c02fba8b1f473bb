"""The flying robot: a 3.4 kg X-quad in JSBSim."""

from sim.quad.quad import STEP_S, Quad
from sim.quad.state import QuadState

__all__ = ["STEP_S", "Quad", "QuadState"]
