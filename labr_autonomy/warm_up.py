"""`python -m labr_autonomy.warm_up`: compile the kernels of a flight once, after installing.

Without it the first flight does so by itself and waits for it.
"""

from __future__ import annotations

import sys


def main() -> None:
    """Compile and cache."""
    from labr_autonomy.config import RobotConfig
    from labr_autonomy.estimation import error_state
    from labr_autonomy.planner.pipeline import Pipeline

    sys.stdout.write("compiling the flight's kernels (once) ...\n")
    sys.stdout.flush()
    error_state.warm_up()
    Pipeline(RobotConfig())


if __name__ == "__main__":
    main()
