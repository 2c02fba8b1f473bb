"""The planner process: depth and pose in, trajectory out (network, map and refiner in one cycle)."""
