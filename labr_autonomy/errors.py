"""The error family. Each error says what happened, why, and what to do; the exit code is part of it.

LabrError
+ BadInput         exit 2  a file or argument is wrong
+ Refused          exit 3  the request is understood and not feasible
+ LinkError        exit 3  a device or process does not answer as it must
"""

from __future__ import annotations

import enum


class ExitCode(enum.IntEnum):
    """What `labr-mission` returns to the shell."""

    DONE = 0
    BAD_INPUT = 2
    REFUSED = 3
    EXPECTATION_MISSED = 4
    ABORTED = 5
    FAILSAFE = 6


class LabrError(Exception):
    """Base of the family.

    Args:
        what: What happened, with figures, as a sentence without its full stop.
        do: What the reader should do about it.
    """

    exit_code: ExitCode = ExitCode.REFUSED

    def __init__(self, what: str, do: str = "") -> None:
        super().__init__(f"{what}. {do}" if do else f"{what}.")
        self.what = what
        self.do = do


class BadInput(LabrError):
    """A file or an argument cannot be used."""

    exit_code = ExitCode.BAD_INPUT


class Refused(LabrError):
    """The request is well formed, but it must not or cannot be carried out."""

    exit_code = ExitCode.REFUSED


class LinkError(LabrError):
    """A device, a process or its protocol does not answer as it must."""

    exit_code = ExitCode.REFUSED
