"""One MAVLink address, read without waiting: messages in, messages out."""

from __future__ import annotations

from pymavlink.dialects.v20 import development as mavlink

from labr_autonomy.air.address import opened
from labr_autonomy.errors import LinkError

BATCH_MAX = 200  # datagrams taken at one look
BYTES_MAX = 4096


class Endpoint:
    """A socket or port, and the parser of what comes from it.

    Args:
        url: As MAVSDK writes it.

    Raises:
        BadInput: The URL cannot be read.
        LinkError: It cannot be opened.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        self._link = opened(url)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._codecs: dict[tuple[int, int], mavlink.MAVLink] = {}

    def read(self) -> list[mavlink.MAVLink_message]:
        """What has arrived; frames of unknown messages are among it, spoilt ones are not."""
        out: list[mavlink.MAVLink_message] = []
        for data in self.read_bytes():
            found = self._parser.parse_buffer(data) or ()
            out.extend(m for m in found if m.get_type() != "BAD_DATA")
        return out

    def read_bytes(self) -> list[bytes]:
        """What has arrived, unread.

        Raises:
            LinkError: It was unplugged, or hung up.
        """
        out: list[bytes] = []
        for _ in range(BATCH_MAX):
            try:
                data = self._link.recv(BYTES_MAX)
            except OSError as error:
                raise LinkError(f"{self._url} is lost: {error}", "Start the autopilot anew.") from None
            if not data:
                break
            out.append(bytes(data))
        return out

    def write_bytes(self, data: bytes) -> None:
        """Send a frame that is packed already."""
        self._link.write(data)

    def packed(self, message: mavlink.MAVLink_message) -> bytes:
        """The frame of a message that was changed, with its sender and sequence number."""
        sender = message.get_srcSystem(), message.get_srcComponent()
        codec = self._codecs.setdefault(sender, mavlink.MAVLink(None, *sender))
        codec.seq = message.get_seq()
        return bytes(message.pack(codec))

    def say(self, message: mavlink.MAVLink_message, system: int, component: int) -> None:
        """Send a message of our own."""
        codec = self._codecs.setdefault((system, component), mavlink.MAVLink(None, system, component))
        self._link.write(bytes(message.pack(codec)))
        codec.seq = (codec.seq + 1) & 0xFF

    def close(self) -> None:
        """Close it; may be called twice."""
        self._link.close()
