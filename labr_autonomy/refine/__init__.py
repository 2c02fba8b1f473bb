"""Stage two: key points, map and state in; a trajectory that is feasible and free out."""
