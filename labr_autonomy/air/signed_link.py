"""Signs the air link between MAVSDK, which cannot, and an autopilot that demands it.

MAVSDK talks to a local UDP socket of ours; a thread signs each frame and sends it on, and lets in only frames
that the autopilot has signed. Nothing is repeated and nothing is sent by itself: the dead-man stays.
"""

from __future__ import annotations

import contextlib
import logging
import select
import socket
import threading
from pathlib import Path

from pymavlink.dialects.v20 import development as mavlink

from labr_autonomy.air.address import opened
from labr_autonomy.air.peer import Peer
from labr_autonomy.air.signing import Signer, read_key, stamp_of, unsigned
from labr_autonomy.clock import utc_s

_log = logging.getLogger("labr.air")

DATAGRAM_MAX = 2048
BATCH_MAX = 200
WAIT_S = 0.1
SAVE_S = 5.0


class SignedLink:
    """The relay.

    Args:
        url: Where the autopilot is, as MAVSDK writes it.
        key_path: File of the key; the last stamp is kept beside it, in a file of the same name with `.stamp`.

    Raises:
        BadInput: URL or key cannot be used.
        LinkError: The address cannot be opened.
    """

    def __init__(self, url: str, key_path: Path) -> None:
        self._stamp_path = key_path.with_name(key_path.name + ".stamp")
        self.signer = Signer(read_key(key_path), max(stamp_of(utc_s()), self._saved()))
        self._far = opened(url)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._near.bind(("127.0.0.1", 0))
        self._near.setblocking(False)
        self._mavsdk = Peer()
        self._saved_s = utc_s()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="air-signing", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Where MAVSDK finds the autopilot."""
        return f"udpout://127.0.0.1:{self._near.getsockname()[1]}"

    def close(self) -> None:
        """End the thread and let go of both ends; can be called again."""
        self._closing.set()
        self._thread.join()
        self._near.close()
        with contextlib.suppress(OSError):
            self._far.close()

    def _run(self) -> None:
        try:
            while not self._closing.is_set():
                self._relay()
        except (OSError, ValueError) as error:  # unplugged or hung up; the channel sees a silent autopilot
            _log.error("the signed air link is lost: %s", error)
        self._save()

    def _relay(self) -> None:
        ready, _, _ = select.select([self._near, self._far.fd], [], [], WAIT_S)
        if self._near in ready:
            self._outward()
        if self._far.fd in ready:
            self._inward()
        if utc_s() - self._saved_s > SAVE_S:
            self._save()

    def _outward(self) -> None:
        for _ in range(BATCH_MAX):
            try:
                data, sender = self._near.recvfrom(DATAGRAM_MAX)
            except OSError:
                return
            if not self._mavsdk.admits(sender):
                continue
            signed = self.signer.sign(data, utc_s())  # MAVSDK sends one frame in a datagram
            if signed is not None:
                with contextlib.suppress(OSError):
                    self._far.write(signed)

    def _inward(self) -> None:
        for _ in range(BATCH_MAX):
            data = self._far.recv(DATAGRAM_MAX)
            if not data:
                return
            for message in self._parser.parse_buffer(bytes(data)) or ():
                frame = bytes(message.get_msgbuf())
                if message.get_type() == "BAD_DATA" or not self.signer.good(frame):
                    continue
                plain = unsigned(frame)
                if plain is not None and self._mavsdk.address is not None:
                    with contextlib.suppress(OSError):
                        self._near.sendto(plain, self._mavsdk.address)

    def _saved(self) -> int:
        try:
            return int(self._stamp_path.read_text())
        except (OSError, ValueError):
            return 0

    def _save(self) -> None:
        """Keep the stamp: after a start with a clock that was set back it must not begin before it."""
        self._saved_s = utc_s()
        with contextlib.suppress(OSError):
            self._stamp_path.write_text(f"{self.signer.stamp}\n")
