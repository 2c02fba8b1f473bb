"""A named ring in shared memory: one writer, any number of readers, no locks that a death could hold.

The writer stamps a slot's `begin` with the new sequence number, fills the slot, stamps `end`, and only
then publishes the number in the header. A reader checks `end`, copies, and checks `begin` (Lamport's
two counters): whatever the writer overtook, or died in the middle of, is not returned. All counters
are aligned 64-bit words, written by single stores, which x86-64 keeps in order.

Blocks live in /dev/shm (Linux). The writer's block is registered with Python's resource tracker, so it
goes away even when the writer is killed. Readers map the file by themselves: attaching through
`SharedMemory` would register it a second time before Python 3.13, and the block would vanish with the
first reader.
"""

from __future__ import annotations

import mmap
import os
import re
from contextlib import suppress
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

from labr_autonomy.clock import SystemClock, pause_s
from labr_autonomy.errors import BadInput, LinkError

_FOLDER = Path("/dev/shm")
_MAGIC = int.from_bytes(b"LABRRNG1", "little")
_ALIGN = 64  # a cache line
# words of the header
_W_MAGIC, _W_SLOTS, _W_PAYLOAD, _W_META, _W_PID, _W_BIRTH, _W_NEWEST = range(7)
_POLL_S = 0.02
_STALE_S = 0.5  # without news for so long, a reader looks whether another writer took over the name


def _aligned(size: int) -> int:
    return -(-size // _ALIGN) * _ALIGN


def _birth(pid: int) -> int:
    """Start time of a living process [clock ticks since boot], 0 when there is none (proc(5), field 22)."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0
    return 0 if fields[0] in "ZX" else int(fields[19])


def _path(name: str) -> Path:
    if not re.fullmatch(r"[A-Za-z0-9_.-]{1,200}", name) or name.startswith("."):
        raise BadInput(f"'{name}' cannot name a shared-memory slot", "Use letters, digits, _ and - only.")
    return _FOLDER / name


class RingWriter:
    """Creates the block and fills it.

    Args:
        name: Name of the block. A dead writer's block of that name is replaced, a living one's refused.
        meta: Bytes that hold for the whole life of the block.
        payload_bytes: Size of one entry.
        slots: Entries kept; a reader has `slots - 1` writing periods to copy one.
    """

    def __init__(self, name: str, meta: bytes, payload_bytes: int, slots: int = 4) -> None:
        self.name = name
        self._file = _path(name)
        self._clear_way()
        self._slots = slots
        self._first = _ALIGN + _aligned(len(meta))
        self._stride = _ALIGN + _aligned(payload_bytes)
        try:
            self._memory: SharedMemory | None = SharedMemory(
                name, create=True, size=self._first + slots * self._stride
            )
        except OSError as error:
            raise LinkError(f"shared memory '{name}' cannot be made: {error}", "Free /dev/shm.") from error
        os.chmod(self._file, 0o600)
        # Numbers start at the clock's milliseconds, so that they go on rising when a writer is restarted.
        self._newest = int(SystemClock().now_s() * 1000.0)
        pid = os.getpid()
        with self._view() as data, data.cast("Q") as words:
            data[_ALIGN : _ALIGN + len(meta)] = meta
            words[_W_SLOTS], words[_W_PAYLOAD], words[_W_META] = slots, payload_bytes, len(meta)
            words[_W_PID], words[_W_BIRTH] = pid, _birth(pid)
            words[_W_MAGIC] = _MAGIC  # last: readers take the block as absent until then

    def _view(self) -> memoryview:
        """The block's bytes, for one call only: a view kept for long would forbid the block to be closed."""
        buffer = None if self._memory is None else self._memory.buf
        if buffer is None:
            raise LinkError(f"shared memory '{self.name}' was closed", "Make a new writer.")
        return memoryview(buffer)

    def _clear_way(self) -> None:
        try:
            head = memoryview(self._file.read_bytes()[:_ALIGN].ljust(_ALIGN, b"\0")).cast("Q")
        except FileNotFoundError:
            return
        except OSError as error:
            raise LinkError(
                f"shared memory '{self.name}' belongs to someone else: {error}", "Take another name."
            ) from error
        pid = head[_W_PID]
        if head[_W_MAGIC] == _MAGIC and head[_W_BIRTH] and _birth(pid) == head[_W_BIRTH]:
            raise LinkError(
                f"shared memory '{self.name}' is being written by process {pid}", "Stop that process first."
            )
        self._file.unlink(missing_ok=True)

    def write(self, *parts: bytes | memoryview) -> int:
        """Publish the parts, laid end to end, and return their sequence number."""
        sequence = self._newest + 1
        start = self._first + (sequence % self._slots) * self._stride
        with self._view() as data, data.cast("Q") as words:
            words[start // 8] = sequence
            at = start + _ALIGN
            for part in parts:
                data[at : at + len(part)] = part
                at += len(part)
            words[start // 8 + 1] = sequence
            words[_W_NEWEST] = self._newest = sequence
        return sequence

    def close(self) -> None:
        """Remove the block; readers keep what they have mapped and see nothing new."""
        memory, self._memory = self._memory, None
        if memory is None:
            return
        memory.close()
        with suppress(FileNotFoundError):
            memory.unlink()


class RingReader:
    """Follows a block by name; when the writer is restarted it moves over to the new block by itself.

    Args:
        name: Name given to the writer.
        timeout_s: How long to wait for the writer to appear [s].
        what: What the block carries, for the error sentence.
        own: Follow this user's blocks only: another user may take the name when the writer has left it.
    """

    def __init__(self, name: str, timeout_s: float, what: str, *, own: bool = False) -> None:
        self.name = name
        self._own = own
        self._file = _path(name)
        self._map: mmap.mmap | None = None
        self._clock = SystemClock()
        deadline_s = self._clock.now_s() + timeout_s
        while not self._attach():
            left_s = deadline_s - self._clock.now_s()
            if left_s <= 0.0:
                raise LinkError(
                    f"no {what} '{name}' appeared within {timeout_s:.1f} s",
                    "Start the process that writes it.",
                )
            pause_s(min(_POLL_S, left_s))

    def _attach(self) -> bool:
        try:
            with self._file.open("rb") as file:
                stat = os.fstat(file.fileno())
                if self._own and stat.st_uid != os.getuid():
                    raise LinkError(
                        f"shared memory '{self.name}' belongs to user {stat.st_uid}",
                        "Remove it as that user.",
                    )
                if stat.st_size < _ALIGN:
                    return False  # just being made
                mapped = mmap.mmap(file.fileno(), stat.st_size, access=mmap.ACCESS_READ)
        except FileNotFoundError:
            return False
        except OSError as error:
            raise LinkError(
                f"shared memory '{self.name}' cannot be read: {error}", "Check its owner."
            ) from error
        words = memoryview(mapped).cast("Q")
        if words[_W_MAGIC] != _MAGIC:
            words.release()
            mapped.close()
            return False
        self._release()
        self._map, self._words, self._inode = mapped, words, stat.st_ino
        self._slots, self.payload_bytes = words[_W_SLOTS], words[_W_PAYLOAD]
        self.meta = bytes(mapped[_ALIGN : _ALIGN + words[_W_META]])
        self._first = _ALIGN + _aligned(words[_W_META])
        self._stride = _ALIGN + _aligned(self.payload_bytes)
        self._seen, self._news_s = 0, self._clock.now_s()
        return True

    @property
    def slots(self) -> int:
        """Entries that the block keeps."""
        return self._slots

    def newest(self) -> int | None:
        """Sequence number of the newest complete entry; None before the first.

        A block that took the place of the followed one and cannot be read, or is another user's, is ignored.
        """
        if self._map is None:
            raise LinkError(f"shared memory '{self.name}' was closed", "Make a new reader.")
        now_s = self._clock.now_s()
        newest: int = self._words[_W_NEWEST]
        if newest != self._seen:
            self._seen, self._news_s = newest, now_s
        elif now_s - self._news_s > _STALE_S:
            self._news_s = now_s
            with suppress(FileNotFoundError, LinkError):  # what cannot be read is no news
                if self._file.stat().st_ino != self._inode and self._attach():
                    newest = self._seen = self._words[_W_NEWEST]
        return newest or None

    def read(self, sequence: int, size: int | None = None) -> bytes | None:
        """Copy the first `size` bytes of an entry; None when it was overwritten or never written."""
        if self._map is None:
            raise LinkError(f"shared memory '{self.name}' was closed", "Make a new reader.")
        start = self._first + (sequence % self._slots) * self._stride
        if sequence <= 0 or self._words[start // 8 + 1] != sequence:
            return None
        copied = self._map[start + _ALIGN : start + _ALIGN + (self.payload_bytes if size is None else size)]
        return copied if self._words[start // 8] == sequence else None

    def read_newest(self, size: int | None = None) -> tuple[int, bytes] | None:
        """Sequence number and bytes of the newest entry; None before the first.

        A writer that laps this reader in the middle of a copy costs a second try, never a wait.
        """
        for _ in range(3):
            sequence = self.newest()
            if sequence is None:
                return None
            copied = self.read(sequence, size)
            if copied is not None:
                return sequence, copied
        return None

    def _release(self) -> None:
        if self._map is not None:
            self._words.release()
            self._map.close()
            self._map = None

    def close(self) -> None:
        """Let go of the block; it stays for its writer and other readers."""
        self._release()
