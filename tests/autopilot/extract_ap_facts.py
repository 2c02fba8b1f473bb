"""Distil the recorded ArduCopter flight into `ap_facts.json`, the fixture of its stand-in's conformance test.

Run by hand when the recording changes: `python tests/autopilot/extract_ap_facts.py`. It reads the transcript
`ap_ev.table.txt` in `../shared/data/px4_flights` beside the repository, or LABR_SHARED.
"""

from __future__ import annotations

import json
import os
import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve()
SHARED = Path(os.environ.get("LABR_SHARED", HERE.parents[2].parent / "shared"))
RESULTS = {"ACCEPTED": 0, "TEMPORARILY_REJECTED": 1, "DENIED": 2, "UNSUPPORTED": 3, "FAILED": 4}
LINE = re.compile(r"\s*(?P<t>[\d.]+) (?P<who>\d+/\d+) (?P<what>\w+) (?P<rest>.*)")
STREAM = re.compile(r"\s*(?P<who>\d+/\d+)\s+\d+ (?P<name>\w+)\s+(?P<count>\d+)\s+(?P<hz>[\d.]+)")


def numbers(text: str) -> list[float | None]:
    """The list in brackets; None for NaN."""
    inside = text[text.index("[") + 1 : text.index("]")]
    return [None if v.strip() == "nan" else float(v) for v in inside.split(",")]


def distil(text: str) -> dict[str, object]:
    facts: dict[str, list[list[object]]] = {
        name: [] for name in ("client", "acks", "heartbeats", "landed", "texts", "parameters")
    }
    rates: dict[str, float] = {}
    for line in text.splitlines():
        stream = STREAM.fullmatch(line.rsplit(None, 4)[0]) if line.count(" ") > 10 else None
        if stream and stream["who"] == "1/1":
            rates[stream["name"]] = float(stream["hz"])
        found = LINE.fullmatch(line)
        if found is None:
            continue
        t, what, rest = float(found["t"]), found["what"], found["rest"]
        ours = found["who"] == "1/1"
        match what:
            case "COMMAND_LONG":
                facts["client"].append([t, int(rest.split()[0]), numbers(rest)])
            case "COMMAND_ACK" if "MAV_RESULT_" in rest:
                result = re.search(r"MAV_RESULT_(\w+)", rest)
                assert result is not None
                facts["acks"].append([t, int(rest.split()[0]), RESULTS[result[1]]])
            case "HEARTBEAT" if ours:
                words = dict(word.split("=") for word in rest.split())
                row = [int(words["base_mode"], 16), int(words["custom_mode"], 16), int(words["status"])]
                facts["heartbeats"].append([t, *row])
            case "EXTENDED_SYS_STATE":
                facts["landed"].append([t, int(rest.split()[0].split("=")[1])])
            case "STATUSTEXT":
                severity, said = rest.split(" ", 1)
                facts["texts"].append([t, int(severity.split("=")[1]), said.strip("'")])
            case "PARAM_VALUE":
                name, value, kind, *_ = rest.split()
                facts["parameters"].append([t, name, float(value), int(kind.split("=")[1])])
    asked = {
        line.split()[3] for line in text.splitlines() if " PARAM_REQUEST_READ " in line and "idx=" in line
    }
    facts["parameters"] = [row for row in facts["parameters"] if row[1] in asked]
    return {**facts, "asked": sorted(asked), "rates_hz": rates}


def main() -> int:
    path = SHARED / "data" / "px4_flights" / "ap_ev.table.txt"
    if not path.exists():
        sys.stderr.write(f"{path} is missing. Set LABR_SHARED to the folder that holds data/px4_flights.\n")
        return 2
    target = HERE.with_name("ap_facts.json")
    text = json.dumps(distil(path.read_text()), separators=(",", ":"), allow_nan=False)
    target.write_text(text.replace("],[", "],\n[") + "\n")
    sys.stdout.write(f"{target.name}: {target.stat().st_size} bytes\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
