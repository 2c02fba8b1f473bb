"""Both directions of the air link into a tlog, without Python in the flight path.

MAVSDK forwards every frame to a UDP socket of ours. Two of its routing rules need an answer. Frames for
system 1 go only to links on which system 1 was heard: so the recorder announces itself there as what it
is, the vehicle's logging component (1/155). And frames addressed to the companion itself are not passed
on: their acknowledgements are encoded anew here (same fields; the sequence number is the recorder's own).

The socket is emptied 20 times a second by a thread: one wake-up for some 25 frames, none on the event
loop, and the log goes on while the loop hangs. The kernel's receive stamps keep the frames' true times.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from collections import deque

from pymavlink.dialects.v20 import common as mavlink

from labr_autonomy.air.peer import Address, Peer
from labr_autonomy.air.px4 import AUTOPILOT_COMPONENT, VEHICLE_SYSTEM
from labr_autonomy.air.telemetry import Received
from labr_autonomy.air.watch import Watch
from labr_autonomy.clock import Clock, utc_s
from labr_autonomy.record.tlog import Tlog

LOGGER_COMPONENT = 155  # MAV_COMP_ID_LOG
ANNOUNCE_S = 1.0
DRAIN_S = 0.05
BATCH_MAX = 2000  # frames at once; PX4's onboard link carries 25 in DRAIN_S
BUFFER_BYTES = 1 << 20  # wished for; what Linux gives by default (208 kB) holds half a second of the link
DATAGRAM_MAX = 2048
SO_TIMESTAMPNS = 35  # Linux, asm-generic/socket.h; also the type of the control message it gives
TIMESPEC = struct.Struct("@ll")


class Recorder:
    """A local UDP socket and the thread that writes what it is sent, and shows it to a watcher."""

    def __init__(self, tlog: Tlog, clock: Clock, watch: Watch | None = None) -> None:
        self._tlog = tlog
        self._clock = clock
        self._watch = watch
        self._mavsdk = Peer()  # where MAVSDK forwards from
        self._announced_s = -ANNOUNCE_S
        self._own = mavlink.MAVLink(None, VEHICLE_SYSTEM, LOGGER_COMPONENT)
        self._autopilot = mavlink.MAVLink(None, VEHICLE_SYSTEM, AUTOPILOT_COMPONENT)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="air-recorder", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Where MAVSDK shall forward to."""
        return f"udpout://127.0.0.1:{self._socket.getsockname()[1]}"

    def write_ack(self, fields: Received) -> None:
        """Log a COMMAND_ACK that was addressed to us."""
        names = ("command", "result", "progress", "result_param2", "target_system", "target_component")
        ack = self._autopilot.command_ack_encode(*(int(fields[name]) for name in names))
        self._waiting.append((utc_s(), bytes(ack.pack(self._autopilot))))
        self._autopilot.seq = (self._autopilot.seq + 1) & 0xFF

    def close(self) -> None:
        """Write what has arrived and close the socket; the tlog stays its owner's. Can be called again."""
        self._closing.set()
        self._thread.join()
        self._socket.close()
        if self._watch is not None:
            self._watch.close()

    def _run(self) -> None:
        while not self._closing.wait(DRAIN_S):
            self._drain()
        self._drain()

    def _drain(self) -> None:
        """Write what has arrived, in the order of its stamps."""
        batch = self._receive()
        while self._waiting:
            batch.append(self._waiting.popleft())
        if self._watch is not None:
            for _, data in sorted(batch):
                self._watch.show(data)
            for data in self._watch.heard():
                self._inject(data)
                batch.append((utc_s(), data))
        for stamp_utc_s, data in sorted(batch):
            self._tlog.write(stamp_utc_s, data)

    def _receive(self) -> list[tuple[float, bytes]]:
        batch: list[tuple[float, bytes]] = []
        for _ in range(BATCH_MAX):
            try:
                data, control, _, address = self._socket.recvmsg(
                    DATAGRAM_MAX, socket.CMSG_SPACE(TIMESPEC.size)
                )
            except BlockingIOError:
                break
            if self._mavsdk.admits(address):
                batch.append((_received_s(control), data))
                self._announce(address)
        return batch

    def _inject(self, data: bytes) -> None:
        """Hand a watcher's words to MAVSDK, which forwards them to the autopilot."""
        if self._mavsdk.address is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(data, self._mavsdk.address)

    def _announce(self, address: Address) -> None:
        now_s = self._clock.now_s()
        if now_s - self._announced_s < ANNOUNCE_S:
            return
        self._announced_s = now_s
        beat = self._own.heartbeat_encode(
            mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE
        )
        with contextlib.suppress(OSError):  # the next announcement makes good for it
            self._socket.sendto(bytes(beat.pack(self._own)), address)
        self._own.seq = (self._own.seq + 1) & 0xFF


def _received_s(control: list[tuple[int, int, bytes]]) -> float:
    """When the kernel received the datagram [s since the epoch]."""
    for level, kind, stamp in control:
        if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS:
            seconds, nanoseconds = TIMESPEC.unpack(stamp[: TIMESPEC.size])
            return float(seconds + nanoseconds * 1e-9)
    return utc_s()
