"""All examinations in their order."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

from labr_autonomy.config import RobotConfig
from labr_autonomy.doctor.finding import Finding
from labr_autonomy.doctor.machine import examine_machine
from labr_autonomy.doctor.ports import examine_ports


def examine(config: RobotConfig, areas: tuple[str, ...], runs: Path) -> Iterator[Finding]:
    """One finding after the other, as they are made.

    Args:
        config: The robot.
        areas: Which of `AREAS`.
        runs: Where run folders are made.
    """
    if "machine" in areas:
        yield from examine_machine(config, runs)
    if "ports" in areas:
        yield from examine_ports(config)
    if "camera" in areas or "vio" in areas:
        from labr_autonomy.doctor.sensors import examine_camera, examine_vio

        if "camera" in areas:
            yield from examine_camera(config)
        if "vio" in areas:
            yield from asyncio.run(examine_vio(config))
    if "ground" in areas or "air" in areas:
        from labr_autonomy.doctor.controllers import examine_air, examine_ground

        if "ground" in areas:
            yield from asyncio.run(examine_ground(config))
        if "air" in areas:
            yield from asyncio.run(examine_air(config))
    if "cpu" in areas:
        from labr_autonomy.doctor.cycle import examine_cpu

        yield from examine_cpu(config)
