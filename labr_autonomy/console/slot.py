"""Small JSON messages between two processes of this machine, in shared memory: no wait, no queue, no socket.

The writer never learns whether anybody reads. A reader that is slow sees the newest message next, and one
that reads a short history sees what the ring still holds.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from labr_autonomy.errors import BadInput
from labr_autonomy.perception.shared_ring import RingReader, RingWriter

_LENGTH = struct.Struct("=I")
_FOLDER = Path("/dev/shm")

Body = dict[str, Any]


class JsonWriter:
    """Publishes JSON objects under a name.

    Args:
        name: Name of the slot, unique per run.
        meta: What holds for the whole life of the slot.
        size_max: Largest message [bytes].
        slots: Messages kept.
    """

    def __init__(self, name: str, meta: Body, size_max: int, slots: int) -> None:
        self._size_max = size_max
        self._ring = RingWriter(name, encode(meta), _LENGTH.size + size_max, slots)

    def write(self, message: Body) -> int:
        """Publish one object; returns its number.

        Raises:
            BadInput: when it is larger than the slot, or holds a figure that is not finite.
        """
        data = encode(message)
        if len(data) > self._size_max:
            raise BadInput(f"a message of {len(data)} bytes was given to a slot of {self._size_max}")
        return self._ring.write(_LENGTH.pack(len(data)), data)

    def close(self) -> None:
        """Remove the slot."""
        self._ring.close()


class JsonReader:
    """Looks at what a writer publishes.

    Args:
        name: Name given to the writer.
        timeout_s: How long to wait for the writer to appear [s]; LinkError afterwards.

    Raises:
        LinkError: when there is none, or it belongs to another user.
    """

    def __init__(self, name: str, timeout_s: float = 0.0) -> None:
        self._name = name
        self._ring = RingReader(name, timeout_s, "slot", own=True)
        self._last = 0

    @property
    def meta(self) -> Body:
        """What holds for the whole life of the slot."""
        return decode(self._ring.meta)

    def newest(self) -> tuple[int, Body] | None:
        """Number and content of the newest message; None before the first."""
        found = self._ring.read_newest()
        return None if found is None else (found[0], _content(found[1]))

    def number(self) -> int | None:
        """Number of the newest message, without reading it."""
        return self._ring.newest()

    def since(self) -> list[Body]:
        """Messages not yet returned, oldest first; one that was overwritten in the meantime is lost."""
        newest = self._ring.newest()
        if newest is None or newest == self._last:
            return []
        first = max(self._last + 1, newest - self._ring.slots + 1)
        self._last = newest
        payloads = [self._ring.read(number) for number in range(first, newest + 1)]
        return [_content(payload) for payload in payloads if payload is not None]

    def close(self) -> None:
        """Let go of the slot."""
        self._ring.close()


def exists(name: str) -> bool:
    """Whether a slot of that name is there."""
    return (_FOLDER / name).exists()


def encode(value: Body) -> bytes:
    """Compact JSON.

    Raises:
        BadInput: when a figure is not finite; it must have been made null.
    """
    try:
        return json.dumps(value, allow_nan=False, separators=(",", ":")).encode()
    except ValueError as error:
        raise BadInput(f"a message for shared memory is not JSON: {error}") from None


def decode(data: bytes) -> Body:
    """A JSON object.

    Raises:
        BadInput: when it is none.
    """
    try:
        value = json.loads(data)
    except ValueError:
        raise BadInput("a message in shared memory is not JSON") from None
    if not isinstance(value, dict):
        raise BadInput("a message in shared memory is no object")
    return value


def _content(payload: bytes) -> Body:
    (length,) = _LENGTH.unpack_from(payload)
    return decode(payload[_LENGTH.size : _LENGTH.size + length])
