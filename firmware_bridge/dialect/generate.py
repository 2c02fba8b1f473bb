"""Generate `labr_land.py` from `labr_land.xml` with pymavlink: `python -m firmware_bridge.dialect.generate`.

The generated file also carries `PROTOCOL` and `DIALECT_HASH`, which both sides compare in their handshake.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from pymavlink.generator import mavgen, mavparse

from labr_autonomy.errors import BadInput

HERE = Path(__file__).resolve().parent
XML = HERE / "labr_land.xml"
NAME = "labr_land"


def definition_text(xml: Path) -> str:
    """The meaning of the definitions in a canonical form; comments, spaces and order do not count."""
    root = ElementTree.parse(xml).getroot()
    lines: list[str] = []
    for enum in sorted(root.iter("enum"), key=lambda e: e.get("name", "")):
        entries = sorted((int(e.get("value", "0"), 0), e.get("name", "")) for e in enum.iter("entry"))
        lines.extend(f"enum {enum.get('name')} {name}={value}" for value, name in entries)
    for message in sorted(root.iter("message"), key=lambda m: int(m.get("id", "0"))):
        fields = " ".join(
            f"{part.get('type')}:{part.get('name')}" if part.tag == "field" else "|"
            for part in message
            if part.tag in ("field", "extensions")
        )
        lines.append(f"message {message.get('id')} {message.get('name')} {fields}")
    return "\n".join(lines)


def dialect_hash(xml: Path = XML) -> int:
    """First 32 bits of the SHA-256 of `definition_text`."""
    return int.from_bytes(hashlib.sha256(definition_text(xml).encode()).digest()[:4], "big")


def protocol_version(xml: Path = XML) -> int:
    """The single value of the enum LAND_PROTOCOL."""
    for entry in ElementTree.parse(xml).getroot().iter("entry"):
        if entry.get("name") == "LAND_PROTOCOL_VERSION":
            return int(entry.get("value", "0"), 0)
    raise BadInput(f"{xml.name} has no LAND_PROTOCOL_VERSION", "Restore the enum LAND_PROTOCOL.")


def generate(out_dir: Path, xml: Path = XML) -> Path:
    """Write `labr_land.py` into `out_dir` and return its path.

    Raises:
        BadInput: The XML cannot be turned into a dialect.
    """
    with tempfile.TemporaryDirectory() as scratch:
        raw = Path(scratch) / f"{NAME}.py"
        options = mavgen.Opts(
            str(raw.with_suffix("")), wire_protocol=mavparse.PROTOCOL_2_0, language="Python3", validate=True
        )
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            done = mavgen.mavgen(options, [str(xml)])
        if not done or not raw.exists():
            last = said.getvalue().strip().splitlines()[-1:] or ["nothing"]
            raise BadInput(f"mavgen refused {xml.name}: {last[0]}", "Correct the XML.")
        text = raw.read_text(encoding="utf-8")
    head = "# mypy: ignore-errors\n# ruff: noqa\n"
    tail = (
        f"\n\n# added by firmware_bridge/dialect/generate.py\n"
        f"PROTOCOL = {protocol_version(xml)}\nDIALECT_HASH = 0x{dialect_hash(xml):08X}\n"
    )
    lines = "\n".join(line.rstrip() for line in text.rstrip().splitlines())
    out = out_dir / f"{NAME}.py"
    out.write_text(head + lines + tail, encoding="utf-8")
    return out


if __name__ == "__main__":
    sys.stdout.write(f"{generate(HERE)}\n")
