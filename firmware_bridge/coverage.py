"""How much of `core/` the tests on this computer reach, by gcov: `python -m firmware_bridge.coverage`.

Prints lines and branches of each file and what was never taken; exit 4 below 100 % of either.
"""

from __future__ import annotations

import gzip
import json
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from firmware_bridge import build
from firmware_bridge.host.library import LIBRARY_VARIABLE
from labr_autonomy.errors import ExitCode, LabrError

TESTS = build.HERE.parent / "tests" / "ground"
FILES = ("test_conformance.py", "test_core_in_c.py", "test_core_corners.py")
SELECTED = [*(str(TESTS / name) for name in FILES), "-k", "not qemu and not twin"]


@dataclass(slots=True)
class FileCoverage:
    """What was reached of one source file."""

    lines: int = 0
    lines_hit: int = 0
    branches: int = 0
    branches_hit: int = 0
    missed: list[str] = field(default_factory=list)  # "12" for a line, "12 branch 1" for a branch


def read(report: dict[str, Any]) -> FileCoverage:
    """One file of gcov's JSON report."""
    found = FileCoverage()
    for line in report["lines"]:
        found.lines += 1
        found.lines_hit += line["count"] > 0
        if not line["count"]:
            found.missed.append(str(line["line_number"]))
        for k, branch in enumerate(line["branches"]):
            found.branches += 1
            found.branches_hit += branch["count"] > 0
            if line["count"] and not branch["count"]:
                found.missed.append(f"{line['line_number']} branch {k}")
    return found


def measure() -> dict[str, FileCoverage]:
    """Run the tests on a counting library; coverage by file name.

    Raises:
        LabrError: The tests fail, or gcov is not installed.
    """
    library = build.host_library(coverage=True)
    folder = library.parent
    for old in folder.glob("*.gcda"):
        old.unlink()
    tests = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *SELECTED],
        cwd=build.HERE.parent,
        env={
            **os.environ,
            LIBRARY_VARIABLE: str(library),
            "GCOV_PREFIX": str(folder),  # it was built in a scratch folder that is gone
            "GCOV_PREFIX_STRIP": str(len(folder.parts) - 1),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    if tests.returncode != 0:
        raise LabrError(f"the tests fail on the counting library:\n{tests.stdout[-2000:]}")
    reports: dict[str, FileCoverage] = {}
    for data in sorted(folder.glob("*.gcda")):
        try:
            subprocess.run(
                ["gcov", "--json-format", "--branch-probabilities", data.name],
                cwd=folder,
                check=True,
                capture_output=True,
            )
        except FileNotFoundError:
            raise LabrError("gcov is not installed", "apt-get install gcc") from None
    for path in sorted(folder.glob("*.gcov.json.gz")):
        for report in json.loads(gzip.decompress(path.read_bytes()))["files"]:
            if Path(report["file"]).parent == build.CORE and report["file"].endswith(".c"):
                reports[Path(report["file"]).name] = read(report)
        path.unlink()
    return reports


def main() -> int:
    """Entry of `python -m firmware_bridge.coverage`."""
    try:
        reports = measure()
    except LabrError as error:
        sys.stderr.write(f"{error}\n")
        return int(error.exit_code)
    for name, f in reports.items():
        rest = f"   missed: {', '.join(f.missed)}" if f.missed else ""
        sys.stdout.write(
            f"{name:20s} lines {f.lines_hit:3d} of {f.lines:3d}   "
            f"branches {f.branches_hit:3d} of {f.branches:3d}{rest}\n"
        )
    missed = sum(len(f.missed) for f in reports.values())
    lines, branches = (sum(getattr(f, k) for f in reports.values()) for k in ("lines", "branches"))
    sys.stdout.write(f"{lines} lines, {branches} branches, {missed} of them not reached\n")
    return int(ExitCode.EXPECTATION_MISSED if missed else ExitCode.DONE)


if __name__ == "__main__":
    sys.exit(main())
