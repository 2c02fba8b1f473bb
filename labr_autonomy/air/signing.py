"""MAVLink 2 signatures on frames; pure.

A signed frame has bit 0 of its incompatibility flags set and 13 bytes behind its checksum: link id, a 48-bit
time stamp in units of 10 us since 2015, and 48 bits of SHA-256 over key, frame, link id and stamp. Stamps
only grow, so that nothing can be played back. (MAVLink guide, "Message signing".)
"""

from __future__ import annotations

import hashlib
import secrets
import stat
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from pymavlink.dialects.v20 import development as mavlink
from pymavlink.generator.mavcrc import x25crc

from labr_autonomy.errors import BadInput

MAGIC: Final = 0xFD
SIGNED: Final = 0x01  # MAVLINK_IFLAG_SIGNED
HEADER: Final = 10
TAIL: Final = 13
KEY_BYTES: Final = 32
EPOCH_S: Final = 1_420_070_400  # 2015-01-01
UNITS_PER_S: Final = 100_000
OLD_UNITS: Final = 60 * UNITS_PER_S  # a new sender may be this much behind
# CRC_EXTRA of messages that pymavlink 2.4.50 does not know (common.xml)
_EXTRA: Final = {410: 160, 411: 106}


def read_key(path: Path) -> bytes:
    """The 32 bytes of a key file, raw or as 64 hexadecimal digits.

    Raises:
        BadInput: It cannot be read, others may read it, or it holds no key.
    """
    try:
        mode, content = path.stat().st_mode, path.read_bytes()
    except OSError as error:
        raise BadInput(
            f"the signing key {path} cannot be read: {error.strerror}", "Check links.air_key."
        ) from None
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise BadInput(f"others may read the signing key {path}", f"chmod 600 {path}")
    if len(content) == KEY_BYTES:
        return content
    try:
        key = bytes.fromhex(content.decode("ascii").strip())
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES:
        raise BadInput(
            f"{path} holds no signing key", f"It must hold {KEY_BYTES} bytes, or {2 * KEY_BYTES} hex digits."
        )
    return key


def stamp_of(utc_s: float) -> int:
    """A wall clock time as a signature's stamp."""
    return int((utc_s - EPOCH_S) * UNITS_PER_S)


def message_id(frame: bytes) -> int:
    """Number of the message in a MAVLink 2 frame."""
    return int.from_bytes(frame[7:10], "little")


def _checksummed(body: bytes) -> bytes | None:
    """Header and payload with their checksum; None for a message whose seed is not known."""
    number = message_id(body)
    known = mavlink.mavlink_map.get(number)
    extra = _EXTRA.get(number) if known is None else known.crc_extra
    if extra is None:
        return None
    crc = x25crc(body[1:])
    crc.accumulate(bytes([extra]))
    return body + int(crc.crc).to_bytes(2, "little")


def _digest(key: bytes, signed_part: bytes) -> bytes:
    return hashlib.sha256(key + signed_part).digest()[:6]


def unsigned(frame: bytes) -> bytes | None:
    """The same frame without its signature; None for a message whose checksum's seed is not known."""
    body = bytearray(frame[: HEADER + frame[1]])
    body[2] &= ~SIGNED
    return _checksummed(bytes(body))


@dataclass
class Signer:
    """Signs what goes out and judges what comes in.

    Args:
        key: 32 bytes.
        stamp: The last stamp that was used, or the present.
        link: Link id.
    """

    key: bytes = field(repr=False)
    stamp: int
    link: int = 0
    refused: int = 0  # frames without a good signature
    _seen: dict[tuple[int, int, int], int] = field(default_factory=dict)

    def sign(self, frame: bytes, utc_s: float) -> bytes | None:
        """A MAVLink 2 frame, signed; None for what cannot be signed.

        Args:
            frame: Complete, unsigned.
            utc_s: Wall clock; a clock that was set back does not set the stamps back.
        """
        if len(frame) < HEADER or frame[0] != MAGIC or frame[2] & SIGNED:
            return None
        body = bytearray(frame[: HEADER + frame[1]])
        body[2] |= SIGNED
        checked = _checksummed(bytes(body))
        if checked is None:
            return None
        self.stamp = max(self.stamp + 1, stamp_of(utc_s))
        part = checked + bytes([self.link]) + self.stamp.to_bytes(6, "little")
        return part + _digest(self.key, part)

    def good(self, frame: bytes) -> bool:
        """Whether a frame was signed with our key, and later than the last one of its sender."""
        fine = self._good(frame)
        self.refused += not fine
        return fine

    def _good(self, frame: bytes) -> bool:
        size = HEADER + frame[1] + 2 if len(frame) >= HEADER else 0
        if not size or frame[0] != MAGIC or not frame[2] & SIGNED or len(frame) != size + TAIL:
            return False
        part, digest = frame[: size + 7], frame[size + 7 :]
        if not secrets.compare_digest(_digest(self.key, part), digest):
            return False
        stamp = int.from_bytes(frame[size + 1 : size + 7], "little")
        sender = frame[5], frame[6], frame[size]
        last = self._seen.get(sender, self.stamp - OLD_UNITS)
        if stamp <= last:
            return False
        self._seen[sender] = stamp
        self.stamp = max(self.stamp, stamp)
        return True
