"""What tests of the firmware need, and how they are skipped where it is missing."""

from __future__ import annotations

import shutil

import pytest

from firmware_bridge import build

NEEDS = {"gcc": "gcc", "arm-none-eabi-gcc": build.CROSS_PACKAGES, "qemu-system-arm": "qemu-system-arm"}
PREFIX = "firmware: "


def need(*programs: str) -> None:
    """Skip the test where a program is missing, with the package that brings it."""
    missing = [p for p in programs if shutil.which(p) is None]
    if missing:
        packages = " ".join(NEEDS[p] for p in missing)
        pytest.skip(f"{PREFIX}{', '.join(missing)} not installed; apt-get install {packages}")
