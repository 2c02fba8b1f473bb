"""A land controller and a rover in a process: `python -m sim.bench.links.land_server twin|qemu LINK`.

Says `ready` in one JSON line, then one line whenever its motors begin to be driven or braked, with the time
of the machine's monotonic clock; ends with its parent or at SIGTERM.
"""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from pathlib import Path
from typing import Any

from firmware_bridge.pins import Duty, Inputs
from labr_autonomy.clock import SystemClock, Ticker
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import LabrError
from labr_autonomy.processes import die_with_parent, on_time
from sim.firmware.controller import EmulatedController
from sim.land_controller import LandController
from sim.plant import STEP_S
from sim.rover import Rover

VOLTS = 18.5


def _say(event: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(event) + "\n")
    sys.stdout.flush()


async def serve(which: str, link: Path) -> None:
    """Step controller and rover in real time until SIGTERM."""
    clock, config, stop = SystemClock(), RobotConfig(), asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stop.set)
    controller: LandController | EmulatedController
    if which == "qemu":
        controller = EmulatedController(config, clock, link_path=link)
        controller.attend(asyncio.get_running_loop())
    else:
        controller = LandController(config, clock, 1, link_path=link)
    try:
        _say({"event": "ready"})
        await _step(clock, controller, Rover(config, 1), stop)
    finally:
        controller.close()


async def _step(
    clock: SystemClock, controller: LandController | EmulatedController, rover: Rover, stop: asyncio.Event
) -> None:
    ticker, left, right, braked = Ticker(clock, STEP_S), 0.0, 0.0, True
    last_s, volts = clock.now_s(), None
    while not stop.is_set():
        await ticker.wait()
        now_s = clock.now_s()
        s = rover.step(now_s - last_s, left, right, braked=braked, volts=volts)
        last_s = now_s
        pins = Inputs(
            VOLTS,
            s.watts / VOLTS,
            True,
            False,
            s.left_ticks,
            s.right_ticks,
            left_a=s.left_a,
            right_a=s.right_a,
        )
        told = controller.step(now_s, pins)
        volts = VOLTS if isinstance(told, Duty) else None
        if told.braked != braked:
            _say({"event": "braked" if told.braked else "driven", "time_s": clock.now_s()})
        left, right, braked = told


def main() -> int:
    """Entry of the process."""
    die_with_parent(signal.SIGTERM)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with on_time():
            asyncio.run(serve(sys.argv[1], Path(sys.argv[2])))
    except LabrError as error:
        _say({"event": "refused", "what": error.what, "do": error.do})
        return int(error.exit_code)
    return 0


if __name__ == "__main__":
    sys.exit(main())
