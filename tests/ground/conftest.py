"""The tiers of the land controller, and a table of what could not be tested here."""

from __future__ import annotations

import pytest
from firmware_needs import PREFIX, need
from land_bench import Bench
from land_tiers import HostTier, QemuTier, TwinTier

from firmware_bridge.host.library import Library


def pytest_terminal_summary(terminalreporter) -> None:
    """Say which firmware tests did not run, and why; a quiet run shows no reasons otherwise."""
    rows = {}
    for report in terminalreporter.stats.get("skipped", []):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        if PREFIX in reason:
            reason = reason.split(PREFIX)[1]
            rows[reason] = rows.get(reason, 0) + 1
    if rows:
        terminalreporter.section("firmware tests that did not run")
        for reason, count in sorted(rows.items()):
            terminalreporter.write_line(f"{count:4d}  {reason}")


@pytest.fixture(scope="session")
def library() -> Library:
    need("gcc")
    return Library()


def _tier(name: str, request):
    if name == "twin":
        return TwinTier()
    if name == "host":
        return HostTier(request.getfixturevalue("library"))
    need("arm-none-eabi-gcc", "qemu-system-arm")
    return QemuTier()


@pytest.fixture(params=["twin", "host", pytest.param("qemu", marks=pytest.mark.sitl)])
def bench(request):
    """The conformance suite's bench, once for each tier."""
    tier = _tier(request.param, request)
    try:
        yield Bench(tier)
    finally:
        tier.close()
