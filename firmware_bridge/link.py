"""Messages of the dialect over a byte stream: encoding, decoding and counting. No I/O and no clock inside."""

from __future__ import annotations

import io
from dataclasses import dataclass

from firmware_bridge.dialect import labr_land
from firmware_bridge.framing import Framer, Guards

SYSTEM = 1
COMPUTER = 191  # MAV_COMP_ID_ONBOARD_COMPUTER
CONTROLLER = 68  # MAV_COMP_ID_USER44

Message = labr_land.MAVLink_message


@dataclass(frozen=True, slots=True)
class Counters:
    """What a link has seen since it was made."""

    good: int
    bad_crc: int
    resyncs: int
    lost: int  # missing by sequence number
    foreign: int  # good frames of somebody else
    sent: int


@dataclass(frozen=True, slots=True)
class Received:
    """One message and the frame it came in."""

    message: Message
    raw: bytes


def text_of(value: str | bytes) -> str:
    """A char[] field as text; undecodable bytes are shown as such."""
    raw = value.encode() if isinstance(value, str) else value
    return raw.rstrip(b"\x00").decode(errors="backslashreplace")


class Link:
    """One end of the wire.

    Args:
        component: Own component number; the other end's follows from it.
        guards: Parser guards, all on by default.
    """

    def __init__(self, component: int = COMPUTER, guards: Guards | None = None) -> None:
        self._peer = CONTROLLER if component == COMPUTER else COMPUTER
        self._framer = Framer(guards)
        self._codec = labr_land.MAVLink(io.BytesIO(), srcSystem=SYSTEM, srcComponent=component)
        self._next_sequence: int | None = None
        self._good = 0
        self._lost = 0
        self._foreign = 0
        self._sent = 0

    def encode(self, message: Message) -> bytes:
        """The frame of `message`, with the next sequence number."""
        frame: bytes = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        self._sent += 1
        return frame

    def feed(self, data: bytes, now_s: float) -> list[Received]:
        """Messages of the other end completed by `data`, which came at `now_s` [s]."""
        out: list[Received] = []
        for frame in self._framer.feed(data, now_s):
            if (frame.system, frame.component) != (SYSTEM, self._peer):
                self._foreign += 1
                continue
            if self._next_sequence is not None:
                self._lost += (frame.sequence - self._next_sequence) % 256
            self._next_sequence = (frame.sequence + 1) % 256
            self._good += 1
            out.append(Received(self._codec.decode(bytearray(frame.raw)), frame.raw))
        return out

    def restart(self) -> None:
        """The stream was interrupted: forget a half-received frame and the other end's sequence."""
        self._framer.reset()
        self._next_sequence = None

    @property
    def counters(self) -> Counters:
        """A copy of the counters."""
        return Counters(
            good=self._good,
            bad_crc=self._framer.bad_crc,
            resyncs=self._framer.resyncs,
            lost=self._lost,
            foreign=self._foreign,
            sent=self._sent,
        )
