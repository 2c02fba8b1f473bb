"""Worlds the simulator flies in: generated families and mesh files, as triangles."""
