"""`planner.mcap`: every request, the depth image it was planned from, and the result, for `replay --check`.

The planner's process writes it, so that it costs the set-points nothing; about 0.6 MB a second, nearly all of
it depth images, which Foxglove shows as they are.
"""

from __future__ import annotations

import json
import logging
import math
import os
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from mcap.writer import Writer

from labr_autonomy.clock import SystemClock, utc_s
from labr_autonomy.config import RobotConfig
from labr_autonomy.planner.messages import PlanRequest, PlanResult
from labr_autonomy.record import foxglove
from labr_autonomy.record.codec import pack
from labr_autonomy.types import DepthFrame

FLUSH_S = 0.5
REQUEST, RESULT, START, FRAME = "/planner/request", "/planner/result", "/planner/start", "/planner/depth"
_OBJECT = b'{"type":"object"}'

log = logging.getLogger("labr.planner")


class PlannerLog:
    """Writes `planner.mcap`; a disk that is full ends the log, never the planning.

    Args:
        path: File to write; one that is there, of a planner that died, is left as it is.
        config: The robot that is planned for.
    """

    def __init__(self, path: Path, config: RobotConfig) -> None:
        self._clock = SystemClock()
        self._epoch_s = utc_s() - self._clock.now_s()
        self._stopped = False
        self._flush_due_s = self._clock.now_s() + FLUSH_S
        self._seen = -1
        self._syncing = ThreadPoolExecutor(1, thread_name_prefix="planner log to disk")
        self._synced: Future[None] | None = None
        self._stream = path.open("wb")
        self._writer = Writer(self._stream)
        self._writer.start(profile="", library="labr-autonomy")
        schema = self._writer.register_schema("labr.planner", "jsonschema", _OBJECT)
        self._channels = {
            topic: self._writer.register_channel(topic, "json", schema) for topic in (REQUEST, RESULT, START)
        }
        raw = foxglove.DEPTH
        image = self._writer.register_schema(raw.DESCRIPTOR.full_name, "protobuf", foxglove.schema(raw))
        self._channels[FRAME] = self._writer.register_channel(FRAME, "protobuf", image)
        self._put(START, self._clock.now_s(), _json({"robot": config.model_dump(mode="json")}))

    def cycle(self, request: PlanRequest, frame: DepthFrame | None, result: PlanResult) -> None:
        """One planning cycle; its depth image is written when it is another one than before."""
        if self._stopped:
            return
        try:
            if frame is not None and frame.sequence != self._seen:
                self._seen = frame.sequence
                self._put(FRAME, frame.stamp_s, foxglove.raw_depth(frame.stamp_s + self._epoch_s, frame))
            k = None if frame is None else pack(frame.intrinsics)
            shown = None if frame is None else {"sequence": frame.sequence, "stamp_s": frame.stamp_s, "k": k}
            now_s = self._clock.now_s()
            self._put(REQUEST, now_s, _json({"request": pack(request), "frame": shown}))
            self._put(RESULT, now_s, _json({"result": pack(result)}))
            if now_s >= self._flush_due_s:
                self._flush_due_s = now_s + FLUSH_S
                self._writer.flush()
                self._stream.flush()
                self._sync()
        except OSError as error:
            self._stopped = True
            log.warning("planner.mcap has stopped: %s", error.strerror)

    def _sync(self) -> None:
        """Have it on the disk, not in memory that a power cut empties; planning does not wait for it."""
        if self._synced is None or self._synced.done():
            done, self._synced = self._synced, self._syncing.submit(os.fdatasync, self._stream.fileno())
            if done is not None:
                done.result()  # raises what the disk said last time

    def close(self) -> None:
        """Finish the file."""
        self._syncing.shutdown()
        try:
            if not self._stopped:
                self._writer.finish()
            self._stream.close()
        except OSError as error:
            log.warning("planner.mcap is not whole: %s", error.strerror)

    def _put(self, topic: str, stamp_s: float, data: bytes) -> None:
        log_ns = max(0, int((stamp_s + self._epoch_s) * 1e9)) if math.isfinite(stamp_s) else 0
        self._writer.add_message(self._channels[topic], log_ns, data, log_ns)


def _json(value: dict[str, Any]) -> bytes:
    return json.dumps(value, allow_nan=False, separators=(",", ":")).encode()
