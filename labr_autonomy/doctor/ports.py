"""Serial devices: what is plugged in, what robot.yaml names, and whether this user may open it."""

from __future__ import annotations

import grp
import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path

from labr_autonomy.config import RobotConfig
from labr_autonomy.doctor.finding import Finding, good, note, wrong

AREA = "ports"
BY_ID = Path("/dev/serial/by-id")
# USB names of what may be meant; a name is only a hint, the handshake is the identity
HINTS = {
    "air": re.compile(r"px4|pixhawk|ardupilot|cube|holybro|auterion|3d_robotics|fmu", re.IGNORECASE),
    "ground": re.compile(r"labr|stm32|stmicro", re.IGNORECASE),
}


def air_device(url: str) -> str | None:
    """Device of `serial:///dev/NAME:BAUD`; None for a network address."""
    return url.removeprefix("serial://").rpartition(":")[0] if url.startswith("serial://") else None


def examine_ports(config: RobotConfig, by_id: Path = BY_ID) -> Iterator[Finding]:
    """Look at the devices of both channels.

    Args:
        config: With the links.
        by_id: Where udev names serial devices by what they are.
    """
    present = sorted(by_id.iterdir()) if by_id.is_dir() else []
    if present:
        named = ", ".join(f"{path.name} ({path.resolve().name})" for path in present)
        yield good(AREA, "found", named)
    else:
        yield note(AREA, "found", f"no serial device in {by_id}")
    air = air_device(config.links.air)
    if air is None:
        yield good(AREA, "air", f"{config.links.air} is no serial device")
    else:
        yield _device("air", "links.air", air, present)
    yield _device("ground", "links.ground", config.links.ground, present)


def _device(channel: str, key: str, device: str, present: list[Path]) -> Finding:
    path = Path(device)
    try:
        mode = path.stat().st_mode
    except OSError:
        meant = [str(p) for p in present if HINTS[channel].search(p.name)]
        do = (
            f"Set {key} to {' or '.join(meant)}." if meant else f"Plug it in, or correct {key} in robot.yaml."
        )
        return wrong(AREA, channel, f"{device} is not there", do)
    if not stat.S_ISCHR(mode):
        return wrong(AREA, channel, f"{device} is no serial device", f"Correct {key} in robot.yaml.")
    if not os.access(path, os.R_OK | os.W_OK):
        try:
            group = grp.getgrgid(path.stat().st_gid).gr_name
        except KeyError:
            group = "that owns it"
        do = f"Add the user to the group {group} (sudo usermod -aG {group} USER) and log in again."
        return wrong(AREA, channel, f"this user may not open {device}", do)
    by_name = next((p for p in present if p.resolve() == path.resolve()), None)
    if by_name is not None and path.parent != by_name.parent:
        do = f"Set {key} to {by_name}: {path.name} may be another device after the next start."
        return note(AREA, channel, f"{device} can be opened", do)
    return good(AREA, channel, f"{device} can be opened")
