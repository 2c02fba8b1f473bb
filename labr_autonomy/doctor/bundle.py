"""A report archive to hand on: findings, settings, versions, the words of the last run; no secrets.

Left out altogether: keys, images and the links' logs. Blackened in what is kept: the user, the
machine's name, the home folder, and whatever is called a key, token, password or secret.
"""

from __future__ import annotations

import getpass
import json
import platform
import re
import socket
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from labr_autonomy.config import RobotConfig
from labr_autonomy.doctor.finding import Finding
from labr_autonomy.errors import BadInput
from labr_autonomy.record.summary import versions

BLACK = "[removed]"
SECRET = re.compile(
    r"(?i)([\w-]*(?:secret|token|passw(?:or)?d|passphrase|api[_-]?key|signing[_-]?key|private[_-]?key)[\w-]*"
    r"[\"']?\s*[:=]\s*)([\"'][^\"'\n]*[\"']|[^\s,;}]+)"
)
URL_USER = re.compile(r"(\w+://)[^/\s:@]+(?::[^/\s@]*)?@")
LONG_HEX = re.compile(r"\b[0-9a-fA-F]{48,}\b")  # a 32-byte key written out has 64 digits
KEPT = ("summary.json", "executive.log", "simulator.log", "planner.log", "camera.log", "mission.yaml")
LOG_BYTES_MAX = 2_000_000


def redacted(text: str) -> str:
    """Without what tells who, where, or how to get in."""
    text = SECRET.sub(rf"\1{BLACK}", text)
    text = URL_USER.sub(rf"\1{BLACK}@", text)
    text = LONG_HEX.sub(BLACK, text)
    home = str(Path.home())
    if home not in ("", "/"):
        text = text.replace(home, "~")
    for word, stands in ((_user(), "[user]"), (socket.gethostname(), "[host]")):
        if len(word) > 2 and word != "root":
            text = re.sub(rf"\b{re.escape(word)}\b", stands, text)
    return text


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return ""


def write_bundle(path: Path, findings: Sequence[Finding], config: RobotConfig, runs: Path) -> list[str]:
    """Write the archive; returns the names in it.

    Args:
        path: The .zip to write.
        findings: What was found.
        config: The robot.
        runs: Folder of run folders; the newest one's words go along.

    Raises:
        BadInput: It cannot be written.
    """
    parts: dict[str, str] = {
        "doctor.json": _json({"findings": [f.as_dict() for f in findings]}),
        "doctor.txt": "\n".join(f.line for f in findings) + "\n",
        "robot.json": _json(config.model_dump(mode="json")),
        "machine.json": _json({"system": platform.platform(), **versions()}),
    }
    for file in _last_run(runs):
        parts[f"run/{file.name}"] = _read(file)
    try:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, text in parts.items():
                archive.writestr(name, redacted(text))
    except OSError as error:
        raise BadInput(
            f"{path} cannot be written: {error.strerror}", "Choose another --bundle FILE."
        ) from None
    return list(parts)


def _json(value: dict[str, Any]) -> str:
    return json.dumps(value, indent=1) + "\n"


def _last_run(runs: Path) -> list[Path]:
    folders = sorted((p for p in runs.iterdir() if p.is_dir()), key=lambda p: p.name) if runs.is_dir() else []
    if not folders:
        return []
    return [folders[-1] / name for name in KEPT if (folders[-1] / name).is_file()]


def _read(file: Path) -> str:
    """The end of a log says how it ended."""
    with file.open("rb") as stream:
        stream.seek(max(0, file.stat().st_size - LOG_BYTES_MAX))
        return stream.read().decode(errors="replace")
