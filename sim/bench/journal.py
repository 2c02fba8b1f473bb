"""`trials.jsonl`: one line for every flight that has ended, safe against every interruption.

A line is appended by one write and is on the disk before the next flight is reported. A line without its
end was torn by a crash: it is dropped, and its flight is flown again.
"""

from __future__ import annotations

import fcntl
import json
import os
from pathlib import Path
from types import TracebackType

from labr_autonomy.errors import BadInput
from sim.bench.records import Record


class Journal:
    """The records of one run folder; use as a context manager.

    Args:
        path: The file; made when it is not there.

    Raises:
        BadInput: when another benchmark is writing it, or it is damaged other than at its end.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.records = self._read()
        except BlockingIOError:
            os.close(self._file)
            raise BadInput(
                f"another benchmark is writing {path.parent}", "Wait for it or choose another --out"
            ) from None
        except BaseException:
            os.close(self._file)
            raise

    def __enter__(self) -> Journal:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file, which gives the lock back."""
        os.close(self._file)

    def add(self, record: Record) -> None:
        """Keep one more; a later record of the same flight replaces an earlier one."""
        line = json.dumps(record.as_dict(), allow_nan=False, separators=(",", ":")).encode() + b"\n"
        while line:
            line = line[os.write(self._file, line) :]
        os.fsync(self._file)
        self.records[record.key] = record

    def _read(self) -> dict[tuple[str, int, str], Record]:
        raw = self._path.read_bytes()
        whole = raw[: raw.rfind(b"\n") + 1]
        if len(whole) < len(raw):
            os.ftruncate(self._file, len(whole))
        found: dict[tuple[str, int, str], Record] = {}
        for number, line in enumerate(whole.splitlines(), start=1):
            try:
                record = Record.from_dict(json.loads(line))
            except (ValueError, KeyError, TypeError) as error:
                raise BadInput(
                    f"{self._path} is damaged in line {number}: {error}",
                    "Remove that line, or choose another --out DIR",
                ) from None
            found[record.key] = record
        return found
