"""`python -m sim.bench.air_server PORT`: a stand-in that tells when each set-point reaches its socket.

It stands on the floor and answers as PX4 or ArduPilot does. One JSON line on standard output for each
set-point: its `time_boot_ms` and the monotonic time of its arrival, taken by a thread that does nothing else.
"""

from __future__ import annotations

import argparse
import json
import math
import queue
import signal
import socket
import sys
import threading
from types import FrameType

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from labr_autonomy.clock import SystemClock, pause_s
from sim.autopilot.copter import Copter
from sim.autopilot.vehicle import Vehicle
from sim.battery import Battery
from sim.quad.quad import STEP_S
from sim.quad.state import QuadState

DATAGRAM_MAX = 2048
GRAVITY_MPS2 = 9.80665


def _parked() -> QuadState:
    return QuadState(
        position_m=np.array([0.0, 0.0, 0.12]),
        velocity_mps=np.zeros(3),
        quaternion=np.array([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]),
        angular_velocity_rps=np.zeros(3),
        specific_force_mps2=np.array([0.0, 0.0, GRAVITY_MPS2]),
        electrical_w=0.0,
        wheel_load_n=np.full(4, 8.34),
        on_wheels=True,
    )


class Server:
    """One stand-in at rest behind a socket.

    Args:
        kind: "px4" or "ardupilot".
        port: Where the companion listens on this machine.
    """

    def __init__(self, kind: str, port: int) -> None:
        self._clock = SystemClock()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._remote = ("127.0.0.1", port)
        self._inbox: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._vehicle = Copter(self._send) if kind == "ardupilot" else Vehicle(self._send)
        self.stopped = threading.Event()

    def _send(self, data: bytes) -> None:
        self._socket.sendto(data, self._remote)

    def listen(self) -> None:
        """Take each datagram as it comes, and its time."""
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        while True:
            data = self._socket.recv(DATAGRAM_MAX)
            now_s = self._clock.now_s()
            self._inbox.put(data)
            for message in parser.parse_buffer(data) or ():
                if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
                    sys.stdout.write(json.dumps({"boot_ms": message.time_boot_ms, "time_s": now_s}) + "\n")
                    sys.stdout.flush()

    def run(self) -> None:
        """Step at 250 Hz until stopped."""
        truth, battery = _parked(), Battery()
        while not self.stopped.is_set():
            while not self._inbox.empty():
                self._vehicle.receive(self._inbox.get())
            self._vehicle.step(self._clock.now_s(), truth, battery)
            pause_s(STEP_S)


def main(argv: list[str] | None = None) -> int:
    """Entry of `python -m sim.bench.air_server`."""
    parser = argparse.ArgumentParser(prog="sim.bench.air_server")
    parser.add_argument("port", type=int)
    parser.add_argument("--kind", choices=("px4", "ardupilot"), default="px4")
    arguments = parser.parse_args(argv)
    server = Server(arguments.kind, arguments.port)

    def stop(_number: int, _frame: FrameType | None) -> None:
        server.stopped.set()

    signal.signal(signal.SIGTERM, stop)
    threading.Thread(target=server.listen, daemon=True).start()
    server.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
