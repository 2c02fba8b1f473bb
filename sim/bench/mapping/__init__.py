"""The mapping-based method of the benchmark, in the manner of EGO-Planner (Zhou et al., RA-L 2021)."""
