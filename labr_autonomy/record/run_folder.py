"""One folder for each run: `runs/YYYYMMDD-HHMMSS-name`."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

from labr_autonomy.clock import utc_s
from labr_autonomy.errors import BadInput

_TRIES = 100


def slug(name: str) -> str:
    """A mission's name as part of a file name: lower-case letters, digits and dashes."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:40].strip("-") or "run"


def make_run_folder(name: str, out_dir: Path | None = None, *, now_s: float | None = None) -> Path:
    """Create a new folder and return it.

    Args:
        name: The mission's name.
        out_dir: Where runs are kept; `runs` below the working directory by default.
        now_s: Wall clock [s since the epoch]; now by default.

    Raises:
        BadInput: when the folder cannot be made.
    """
    stamp = datetime.fromtimestamp(utc_s() if now_s is None else now_s, tz=UTC)
    base = (out_dir or Path("runs")) / f"{stamp:%Y%m%d-%H%M%S}-{slug(name)}"
    for attempt in range(1, _TRIES):
        folder = base if attempt == 1 else base.with_name(f"{base.name}-{attempt}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            if not base.parent.is_dir():
                raise BadInput(f"{base.parent} is not a folder", "Choose another --out DIR") from None
            continue  # another run began in the same second
        except OSError as error:
            raise BadInput(f"{base} cannot be made: {error.strerror}", "Choose another --out DIR") from None
        return folder
    raise BadInput(f"{base} and {_TRIES - 2} more of that name exist", "Choose another --out DIR")
