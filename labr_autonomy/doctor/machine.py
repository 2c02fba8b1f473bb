"""The computer: versions, network weights, disk, memory, load, permissions, wall clock."""

from __future__ import annotations

import os
import re
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from labr_autonomy import __version__
from labr_autonomy.config import RobotConfig
from labr_autonomy.doctor.finding import Finding, failed, good, note, wrong
from labr_autonomy.errors import LabrError

AREA = "machine"
DISK_MIN_B = 2 << 30  # an hour of flight.mcap and both tlogs
MEMORY_MIN_B = 1 << 30
PYTHON_MIN = (3, 11)
# The flight's own packages: what an installation of another version has broken before.
PACKAGES = (
    "mavsdk",
    "pymavlink",
    "numpy",
    "casadi",
    "onnxruntime",
    "opencv-python-headless",
    "mcap",
    "pyserial",
)


def examine_machine(config: RobotConfig, runs: Path) -> Iterator[Finding]:
    """Look at the computer.

    Args:
        config: For the weights that the network is to run with.
        runs: Where run folders are made.
    """
    yield from _versions()
    yield _weights(config)
    yield _disk(runs)
    yield _memory(Path("/proc/meminfo"))
    yield _load()
    yield _priority()
    yield _wall_clock()


def _versions() -> Iterator[Finding]:
    here = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info[:2] < PYTHON_MIN:
        yield wrong(AREA, "python", f"{here} is too old", "Install 3.11 or newer.")
    else:
        yield good(AREA, "python", f"{here}, labr-autonomy {__version__}")
    wanted = _wanted()
    for name in PACKAGES:
        try:
            have = metadata.version(name)
        except metadata.PackageNotFoundError:
            yield wrong(AREA, name, "not installed", f"pip install {name}")
            continue
        bound = wanted.get(name.lower(), "")
        if bound and not _fits(have, bound):
            yield wrong(AREA, name, f"{have} is installed, {bound} is wanted", f"pip install '{name}{bound}'")
        else:
            yield good(AREA, name, have)


def _wanted() -> dict[str, str]:
    """Version bounds of our own package, by name."""
    found = {}
    try:
        lines = metadata.requires("labr-autonomy") or []
    except metadata.PackageNotFoundError:  # run from a checkout that is not installed
        return {}
    for line in lines:
        match = re.match(r"([A-Za-z0-9_.-]+)\s*([<>=!~][^;]*)?", line)
        if match and "extra ==" not in line:
            found[match[1].lower()] = (match[2] or "").strip()
    return found


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(n) for n in re.findall(r"\d+", version.split("+")[0])[:3])


def _fits(have: str, bound: str) -> bool:
    """Whether a release meets bounds like ">=4.1,<5"; suffixes of pre-releases do not count."""
    mine = _numbers(have)
    for part in bound.split(","):
        operator, version = re.match(r"\s*([<>=!~]+)\s*(.+)", part).groups()  # type: ignore[union-attr]
        theirs = _numbers(version)
        size = max(len(mine), len(theirs))
        a, b = (v + (0,) * (size - len(v)) for v in (mine, theirs))
        met = {">=": a >= b, "<": a < b, "<=": a <= b, ">": a > b, "==": a == b, "!=": a != b}
        if not met.get(operator, True):
            return False
    return True


def _weights(config: RobotConfig) -> Finding:
    from labr_autonomy.gkpn.package import ONNX_NAME, check_runtime, packaged_dir, read_verified

    folder = config.network.weights or packaged_dir()
    try:
        check_runtime(config.network.runtime)
        size = len(read_verified(folder, ONNX_NAME))
    except LabrError as error:
        return failed(AREA, "network", error)
    return good(
        AREA, "network", f"{folder.name}/{ONNX_NAME} {size / 1e6:.1f} MB, checksum as in its manifest"
    )


def _disk(runs: Path) -> Finding:
    place = runs.resolve()
    while not place.exists():
        place = place.parent
    free = shutil.disk_usage(place).free
    text = f"{free / 2**30:.1f} GiB free where runs are kept"
    if not os.access(place, os.W_OK):
        return wrong(AREA, "disk", f"{place} cannot be written", "Choose another folder with --out.")
    if free < DISK_MIN_B:
        return wrong(AREA, "disk", text, f"Make room: an hour of logs wants {DISK_MIN_B / 2**30:.0f} GiB.")
    return good(AREA, "disk", text)


def _memory(meminfo: Path) -> Finding:
    try:
        found = re.search(r"MemAvailable:\s+(\d+) kB", meminfo.read_text())
    except OSError:
        found = None
    if found is None:
        return note(AREA, "memory", "not known on this system")
    available = int(found[1]) * 1024
    text = f"{available / 2**30:.1f} GiB available"
    if available < MEMORY_MIN_B:
        return wrong(AREA, "memory", text, "End other programs: a flight takes 1 GiB.")
    return good(AREA, "memory", text)


def _load() -> Finding:
    cores, load = os.cpu_count() or 1, os.getloadavg()[0]
    text = f"{load:.1f} on {cores} cores"
    if cores < 2:
        return wrong(AREA, "load", text, "A flight wants two cores: one for set-points, one for the planner.")
    if load > 0.75 * cores:
        return wrong(AREA, "load", text, "End other programs: set-points and plans would be late.")
    return good(AREA, "load", text)


def _priority() -> Finding:
    limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[1]
    if os.geteuid() == 0:
        return note(AREA, "rights", "this is root", "Fly as an ordinary user of the group dialout.")
    if limit in (0,):
        return note(
            AREA,
            "rights",
            "no real-time priority for this user",
            "Add '@dialout - rtprio 10' to /etc/security/limits.conf, for set-points on time under load.",
        )
    return good(AREA, "rights", f"real-time priority up to {limit}")


def _wall_clock() -> Finding:
    tool = shutil.which("timedatectl")
    if tool is None:
        return note(AREA, "wall clock", "not known whether it is set; only log names depend on it")
    asked = [tool, "show", "-p", "NTPSynchronized", "--value"]
    try:
        said = subprocess.run(asked, capture_output=True, text=True, timeout=5, check=False).stdout.strip()
    except subprocess.TimeoutExpired:
        said = ""
    if said == "yes":
        return good(AREA, "wall clock", "synchronised")
    return note(AREA, "wall clock", "not synchronised; logs may bear a wrong date", "Connect it once.")
