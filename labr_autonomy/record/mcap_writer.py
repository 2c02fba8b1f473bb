"""Writes an MCAP file by a thread of its own.

The caller's cost is an append to a bounded queue: it never waits for the disk. When the queue is full the
oldest entry goes, and the loss is counted and itself logged. Chunks are closed and on the disk every half
second, so that a killed process or a power cut loses no more than that; `mcap_reader` reads such a file up
to its torn end.
"""

from __future__ import annotations

import json
import math
import os
import threading
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer

from labr_autonomy.clock import Clock, utc_s
from labr_autonomy.errors import BadInput
from labr_autonomy.record.topics import TOPICS

FLUSH_S = 0.5
POLL_S = 0.05
QUEUE_MAX = 4000  # about 20 s of a flight's messages

Body = dict[str, Any]
Viewers = Mapping[str, Callable[[float], bytes]]  # by topic, what makes its message of a UTC stamp
Entry = tuple[str, float, Callable[[], Body] | None, Viewers]  # topic, stamp, what makes the message
Add = Callable[[str, str, str, bytes], None]  # topic, name of its schema, encoding, schema
NONE: Viewers = {}


class McapWriter:
    """A file, its queue and its thread.

    Args:
        path: File to write.
        clock: Source of the stamps.
        metadata: Facts about the run, text to text.
        register: Adds the topics that are no JSON.
        queue_max: Entries kept while the disk is busy.

    Raises:
        BadInput: The file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        clock: Clock,
        metadata: Mapping[str, str],
        register: Callable[[Add], None],
        queue_max: int = QUEUE_MAX,
    ) -> None:
        self._clock = clock
        self._epoch_s = utc_s() - clock.now_s()  # monotonic to UTC, for the log time
        self._queue: deque[Entry] = deque()
        self._queue_max = queue_max
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self.dropped = 0  # entries that were lost because the disk was too slow or failed
        self.fault: str | None = None  # why writing has stopped, if it has
        try:
            self._stream = path.open("wb")
        except OSError as error:
            raise BadInput(
                f"{path} cannot be written: {error.strerror}", "Choose another --out DIR"
            ) from None
        self._writer = Writer(self._stream)
        stamps = {"utc_minus_monotonic_s": f"{self._epoch_s:.6f}"}
        self._channels = self._begin({**stamps, **metadata}, register)
        self._thread = threading.Thread(target=self._run, name="flight-log", daemon=True)
        self._thread.start()

    def put(self, topic: str, stamp_s: float, body: Callable[[], Body] | None, also: Viewers = NONE) -> None:
        """Queue a message, and those that viewers know, all of the same instant. Never waits.

        Args:
            topic: Of the JSON message.
            stamp_s: On the clock.
            body: Makes it, in the thread; None for none.
            also: What makes the others.
        """
        with self._lock:
            if len(self._queue) >= self._queue_max or self._stop.is_set():
                self.dropped += 1
                if self._stop.is_set():
                    return
                self._queue.popleft()
            self._queue.append((topic, stamp_s, body, also))

    def _begin(self, metadata: Mapping[str, str], register: Callable[[Add], None]) -> dict[str, int]:
        self._writer.start(profile="", library="labr-autonomy")
        self._writer.add_metadata("run", dict(metadata))
        channels = {}
        for topic, schema in TOPICS.items():
            name = f"labr{topic.replace('/', '.')}"
            schema_id = self._writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
            channels[topic] = self._writer.register_channel(topic, "json", schema_id)

        def add(topic: str, name: str, encoding: str, data: bytes) -> None:
            schema_id = self._writer.register_schema(name, encoding, data)
            channels[topic] = self._writer.register_channel(topic, encoding, schema_id)

        register(add)
        return channels

    def _run(self) -> None:
        """The thread: drain, write, flush; ends when told to and nothing is left."""
        flush_due_s = self._clock.now_s() + FLUSH_S
        reported = 0
        try:
            while True:
                stopping = self._stop.is_set()  # read before draining, so that nothing is left behind
                while entry := self._take():
                    self._write(*entry)
                now_s = self._clock.now_s()
                if self.dropped != reported:
                    reported = self.dropped
                    self._write(
                        "/recorder", now_s, lambda: {"dropped": self.dropped, "queued": len(self._queue)}
                    )
                if now_s >= flush_due_s:
                    self._writer.flush()
                    self._stream.flush()
                    os.fdatasync(self._stream.fileno())  # on the disk, not in memory that a power cut empties
                    flush_due_s = now_s + FLUSH_S
                if stopping:
                    break
                self._stop.wait(POLL_S)
            self._writer.finish()
        except OSError as error:  # disk full or gone: the flight goes on without its log
            self.fault = f"the flight log has stopped: {error.strerror}"
        try:
            self._stream.close()
        except OSError as error:  # the last buffer did not fit either
            self.fault = self.fault or f"the flight log is not whole: {error.strerror}"

    def _take(self) -> Entry | None:
        with self._lock:
            return self._queue.popleft() if self._queue else None

    def _write(
        self, topic: str, stamp_s: float, body: Callable[[], Body] | None, also: Viewers = NONE
    ) -> None:
        utc_s = stamp_s + self._epoch_s if math.isfinite(stamp_s) else 0.0
        log_ns = max(0, int(utc_s * 1e9))
        if body is not None:
            message = _finite({"stamp_s": stamp_s, **body()})
            data = json.dumps(message, allow_nan=False, separators=(",", ":")).encode()
            self._writer.add_message(self._channels[topic], log_ns, data, log_ns)
        for name, make in also.items():
            self._writer.add_message(self._channels[name], log_ns, make(utc_s), log_ns)

    def close(self) -> None:
        """Write out what is queued and finish the file; safe to call twice."""
        self._stop.set()
        self._thread.join()


def _finite(value: Any) -> Any:
    """The same with null for numbers that JSON does not know."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_finite(v) for v in value]
    if isinstance(value, np.generic):
        return _finite(value.item())
    return value
