"""How the loops of this room are compiled: cached, without the interpreter's lock, without bounds checks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit

compiled: Callable[[Any], Any] = njit(cache=True, nogil=True, boundscheck=False)
