"""Bad bytes for both parsers, a damaged wire, bursts of noise: `python -m firmware_bridge.fuzz [--bytes N]`.

The C side runs with address and undefined-behaviour sanitizers. Exit 4 if anything was obeyed that was not
said, or if a burst cost more than one good frame.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
from collections.abc import Callable
from typing import Any

from firmware_bridge import build
from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.framing import START, Framer
from firmware_bridge.link import COMPUTER, Link
from labr_autonomy.errors import ExitCode, LabrError

BYTES, FRAMES, BURSTS = 10_000_000, 1_000_000, 100_000
PROGRESS_BYTES = 1_000_000


def fuzz_c(mode: str, count: int, seed: int) -> dict[str, Any]:
    """One run of `land_fuzz`; its findings.

    Args:
        mode: bytes, errors or bursts.
        count: How many of them.
        seed: Of the noise.

    Raises:
        LabrError: It crashed, with what the sanitizer said.
    """
    command = [str(build.fuzz_program()), mode, str(count), str(seed)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if not done.stdout:
        raise LabrError(f"land_fuzz ended with {done.returncode}: {done.stderr.strip()[-2000:]}")
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def fuzz_python(count: int, seed: int, progress: Callable[[int], None] | None = None) -> dict[str, Any]:
    """Noise, cut and damaged frames between good ones for `framing.Framer`.

    Args:
        count: Bytes.
        seed: Of the noise.
        progress: Told the bytes so far, every million.
    """
    rng = random.Random(seed)
    framer, link = Framer(), Link(COMPUTER)
    fed = frames = wrong = 0
    said: set[bytes] = set()
    due = PROGRESS_BYTES
    while fed < count:
        kind = rng.randrange(8)
        raw = link.encode(_command(rng))
        if kind < 4:
            data = bytearray(rng.randbytes(rng.randint(1, 300)))
            if kind == 1:  # many false beginnings
                for i in range(0, len(data), rng.randint(2, 9)):
                    data[i] = START
        elif kind == 4:
            data = bytearray(raw[: rng.randint(1, len(raw) - 1)])
            said.add(raw)  # noise may happen to complete it
        elif kind == 5:
            data = bytearray(raw)
            data[rng.randrange(len(data))] ^= rng.randint(1, 255)
        else:
            data = bytearray(raw)
            said.add(raw)
        for frame in framer.feed(bytes(data), 1e-9 * fed):
            frames += 1
            wrong += frame.raw not in said
        fed += len(data)
        if progress is not None and fed >= due:
            progress(fed)
            due += PROGRESS_BYTES
    return {"mode": "bytes", "bytes": fed, "accepted": frames, "wrong": wrong, "bad_crc": framer.bad_crc}


def _command(rng: random.Random) -> wire.MAVLink_land_velocity_message:
    return wire.MAVLink_land_velocity_message(
        rng.getrandbits(32), rng.getrandbits(32), rng.randint(-800, 800), 0, rng.getrandbits(16), 1
    )


def _count(fed: int) -> None:
    sys.stderr.write(f"python: {fed:,} bytes\n")


def main(argv: list[str] | None = None) -> int:
    """Entry of `python -m firmware_bridge.fuzz`."""
    parser = argparse.ArgumentParser(prog="firmware_bridge.fuzz", description="Bad bytes for both parsers.")
    parser.add_argument("--bytes", type=int, default=BYTES, help="for each parser")
    parser.add_argument("--frames", type=int, default=FRAMES, help="over a wire with bit errors")
    parser.add_argument("--bursts", type=int, default=BURSTS)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args(argv)
    good = True

    def tell(side: str, found: dict[str, Any]) -> None:
        nonlocal good
        good &= (
            not found["wrong"] and not found.get("moved_without") and found.get("lost_after_burst", 0) <= 1
        )
        sys.stdout.write(json.dumps({"side": side, **found}) + "\n")
        sys.stdout.flush()

    try:
        for mode, count in (
            ("bytes", arguments.bytes),
            ("errors", arguments.frames),
            ("bursts", arguments.bursts),
        ):
            tell("c", fuzz_c(mode, count, arguments.seed))
    except LabrError as error:
        sys.stderr.write(f"{error}\n")
        return int(error.exit_code)
    tell("python", fuzz_python(arguments.bytes, arguments.seed, _count))
    return int(ExitCode.DONE if good else ExitCode.EXPECTATION_MISSED)


if __name__ == "__main__":
    sys.exit(main())
