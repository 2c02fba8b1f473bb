"""`python -m labr_autonomy.warm_up`: compile the map's and the simulator's kernels once, after installing.

Without it the first flight does so by itself and waits for it.
"""

from __future__ import annotations

import sys


def main() -> None:
    """Compile and cache."""
    from labr_autonomy.perception.rolling_map import warm_up

    sys.stdout.write("compiling the map's kernels (once) ...\n")
    sys.stdout.flush()
    warm_up()


if __name__ == "__main__":
    main()
