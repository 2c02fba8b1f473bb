"""The flight log: MCAP, written by a thread of its own.

Topics of our own are JSON; beside them stand the topics that viewers know by itself (`record.foxglove`).

The caller's cost is an append to a bounded queue: it never waits for the disk. When the queue is full the
oldest entry goes, and the loss is counted and itself logged. Chunks are closed and on the disk every half
second, so that a killed process or a power cut loses no more than that; `read_log` reads such a file up
to its torn end.
"""

from __future__ import annotations

import base64
import json
import math
import os
import struct
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, McapRecord, Message
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from numpy.typing import NDArray
from zstandard import ZstdError  # mcap's own compression

from labr_autonomy.clock import Clock, SystemClock, utc_s
from labr_autonomy.config import Camera
from labr_autonomy.errors import BadInput
from labr_autonomy.record.depth_jpeg import depth_jpeg
from labr_autonomy.record.topics import TOPICS
from labr_autonomy.types import (
    DepthFrame,
    Image,
    KeyPoints,
    Odometry,
    Pose,
    SetPoint,
    Source,
    Trajectory,
)

FLUSH_S = 0.5
POLL_S = 0.05
QUEUE_MAX = 4000  # about 20 s of a flight's messages
DEPTH_PERIOD_S = 0.5  # raw depth would be 4.6 MB/s
DEPTH_SCALE_M = 0.001
PATH_POINTS = 24  # of a trajectory, kept for the pictures
RECORD_MAX_BYTES = 64 * 1024 * 1024

Body = dict[str, Any]
Viewers = Mapping[str, Callable[[float], bytes]]  # by topic, what makes its message of a UTC stamp
Entry = tuple[str, float, Callable[[], Body] | None, Viewers]  # topic, stamp, what makes the message
NONE: Viewers = {}


class FlightLog:
    """Writes `flight.mcap`.

    Args:
        path: File to write.
        clock: Source of the stamps.
        metadata: Facts about the run, text to text.
        queue_max: Entries kept while the disk is busy.
        depth_period_s: Depth frames nearer to each other than this are left out.
    """

    def __init__(
        self,
        path: Path,
        *,
        clock: Clock | None = None,
        metadata: Mapping[str, str] | None = None,
        queue_max: int = QUEUE_MAX,
        depth_period_s: float = DEPTH_PERIOD_S,
    ) -> None:
        # Here and not in the thread: while cv2 loads, its folder stands in sys.path, which a process spawned
        # at that moment would inherit; and loading it with the first frame would stall the flight by 0.3 s.
        import cv2  # noqa: F401

        from labr_autonomy.record import foxglove

        self._viewers = foxglove

        self._clock = clock or SystemClock()
        self._epoch_s = utc_s() - self._clock.now_s()  # monotonic to UTC, for the log time
        self._queue: deque[Entry] = deque()
        self._queue_max = queue_max
        self._lock = threading.Lock()
        self._depth_period_s = depth_period_s
        self._depth_next_s = -math.inf
        self._dropped = 0
        self._fault: str | None = None
        self._stop = threading.Event()
        try:
            self._stream = path.open("wb")
        except OSError as error:
            raise BadInput(
                f"{path} cannot be written: {error.strerror}", "Choose another --out DIR"
            ) from None
        self._writer = Writer(self._stream)
        self._channels = self._begin({"utc_minus_monotonic_s": f"{self._epoch_s:.6f}", **(metadata or {})})
        self._thread = threading.Thread(target=self._run, name="flight-log", daemon=True)
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Entries that were lost because the disk was too slow or failed."""
        return self._dropped

    @property
    def fault(self) -> str | None:
        """Why writing has stopped, if it has."""
        return self._fault

    def odometry(self, odometry: Odometry) -> None:
        """The estimate of one instant."""

        def body() -> Body:
            variance = float(np.trace(odometry.covariance[:3, :3])) / 3.0
            return {
                "position_m": _list(odometry.pose.position_m),
                "quaternion": _list(odometry.pose.quaternion, 6),
                "velocity_mps": _list(odometry.velocity_mps),
                "angular_velocity_rps": _list(odometry.angular_velocity_rps),
                "sigma_m": math.sqrt(variance) if variance >= 0.0 else None,
            }

        pose, make = odometry.pose, self._viewers
        also: Viewers = {
            "/tf": lambda utc_s: make.transforms(utc_s, pose),
            "/pose": lambda utc_s: make.pose_in_odom(utc_s, pose),
        }
        self._put("/odometry", odometry.stamp_s, body, also)

    def setpoint(self, setpoint: SetPoint) -> None:
        """What was sent to a channel."""

        def body() -> Body:
            return {
                "mode": setpoint.mode.value,
                "position_m": _list(setpoint.position_m),
                "velocity_mps": _list(setpoint.velocity_mps),
                "yaw_rad": setpoint.yaw_rad,
                "yaw_rate_rps": setpoint.yaw_rate_rps,
                "speed_mps": setpoint.speed_mps,
            }

        self._put("/setpoint", setpoint.stamp_s, body)

    def plan(
        self,
        stamp_s: float,
        *,
        frame_stamp_s: float,
        network: KeyPoints | None,
        followed: KeyPoints | None,
        trajectory: Trajectory | None,
        source: Source,
        clearance_m: float = math.nan,
        reason: str = "",
        timings_s: Mapping[str, float] | None = None,
    ) -> None:
        """Outcome of one planning cycle."""

        def body() -> Body:
            path: list[list[float]] = []
            if trajectory is not None:
                last = len(trajectory.position_m) - 1
                steps = np.unique(np.linspace(0, last, PATH_POINTS).astype(int))
                path = [_list(trajectory.position_m[i]) for i in steps]
            return {
                "frame_stamp_s": frame_stamp_s,
                "network": _key_points(network),
                "followed": _key_points(followed),
                "path_m": path,
                "mode": "" if trajectory is None else trajectory.mode.value,
                "source": source.value,
                "clearance_m": clearance_m,
                "reason": reason,
                "timings_s": dict(timings_s or {}),
            }

        make = self._viewers
        self._put(
            "/plan", stamp_s, body, {"/plan/scene": lambda utc_s: make.scene(utc_s, network, trajectory)}
        )

    def mode(self, stamp_s: float, mode: str, phase: str, why: str = "") -> None:
        """A change of the mode or of the transition's phase."""
        self._put("/mode", stamp_s, lambda: {"mode": mode, "phase": phase, "why": why})

    def event(self, stamp_s: float, text: str, *, level: str = "info", **figures: float) -> None:
        """Something worth a line, with its figures."""
        make = self._viewers
        also: Viewers = {"/log": lambda utc_s: make.line_of_log(utc_s, text, level)}
        self._put("/event", stamp_s, lambda: {"level": level, "text": text, "figures": figures}, also)

    def link_ages(self, stamp_s: float, ages_s: Mapping[str, float]) -> None:
        """How old the last datum of each link is [s]."""
        kept = dict(ages_s)
        self._put("/link_ages", stamp_s, lambda: {"ages_s": kept})

    def battery(
        self,
        stamp_s: float,
        *,
        voltage_v: float,
        power_w: float,
        energy_land_j: float,
        energy_air_j: float,
        energy_transition_j: float,
        air_voltage_v: float | None = None,
        air_power_w: float | None = None,
    ) -> None:
        """The pack by both channels, and the joules spent so far in each mode."""
        body = {
            "voltage_v": voltage_v,
            "power_w": power_w,
            "air_voltage_v": air_voltage_v,
            "air_power_w": air_power_w,
            "energy_land_j": energy_land_j,
            "energy_air_j": energy_air_j,
            "energy_transition_j": energy_transition_j,
        }
        self._put("/battery", stamp_s, lambda: body)

    def depth(self, frame: DepthFrame, pose: Pose, camera: Camera) -> bool:
        """A depth frame and the body's pose when it was taken; False when it came too soon after the last."""
        if frame.stamp_s < self._depth_next_s:
            return False
        self._depth_next_s = frame.stamp_s + self._depth_period_s
        k = frame.intrinsics

        def body() -> Body:
            return {
                "sequence": frame.sequence,
                "width": k.width,
                "height": k.height,
                "intrinsics": {"fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy},
                "camera_in_body_m": [camera.x_m, 0.0, camera.z_m],
                "position_m": _list(pose.position_m),
                "quaternion": _list(pose.quaternion, 6),
                "format": "png16",
                "scale_m": DEPTH_SCALE_M,
                "data": base64.b64encode(encode_depth(frame.depth_m)).decode("ascii"),
            }

        make = self._viewers
        also: Viewers = {
            "/tf": lambda utc_s: make.camera_mount(utc_s, camera),
            "/depth/calibration": lambda utc_s: make.calibration(utc_s, k),
            "/depth/image": lambda utc_s: make.picture(utc_s, depth_jpeg(frame.depth_m)),
        }
        self._put("/depth", frame.stamp_s, body, also)
        return True

    def map(self, stamp_s: float, cells_xy_m: NDArray[Any], floor_z_m: float) -> None:
        """Obstacle cells (n, 2) odom that the planner knows of."""
        make = self._viewers
        self._put("/map", stamp_s, None, {"/map": lambda utc_s: make.cloud(utc_s, cells_xy_m, floor_z_m)})

    def pilot(self, stamp_s: float, body: Callable[[], Body]) -> None:
        """A call of the pilot, with all that it was given and all that it answered, for `replay --check`."""
        self._put("/pilot", stamp_s, body)

    def facts(self, stamp_s: float, facts: Body) -> None:
        """What holds for the whole flight, as the console shows it."""
        self._put("/facts", stamp_s, lambda: facts)

    def console(self, stamp_s: float, state: Body) -> None:
        """What the operator's console shows, for replay."""
        self._put("/console", stamp_s, lambda: state)

    def close(self) -> None:
        """Write out what is queued and finish the file; safe to call twice."""
        self._stop.set()
        self._thread.join()

    def __enter__(self) -> Self:
        """For `with`."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def _put(self, topic: str, stamp_s: float, body: Callable[[], Body] | None, also: Viewers = NONE) -> None:
        with self._lock:
            if len(self._queue) >= self._queue_max or self._stop.is_set():
                self._dropped += 1
                if self._stop.is_set():
                    return
                self._queue.popleft()
            self._queue.append((topic, stamp_s, body, also))

    def _begin(self, metadata: Mapping[str, str]) -> dict[str, int]:
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

        self._viewers.register(add)
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
                if self._dropped != reported:
                    reported = self._dropped
                    self._write(
                        "/recorder", now_s, lambda: {"dropped": self._dropped, "queued": len(self._queue)}
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
            self._fault = f"the flight log has stopped: {error.strerror}"
        try:
            self._stream.close()
        except OSError as error:  # the last buffer did not fit either
            self._fault = self._fault or f"the flight log is not whole: {error.strerror}"

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


def encode_depth(depth_m: Image) -> bytes:
    """16-bit PNG of a depth image (h, w) [m] in units of DEPTH_SCALE_M; 0 = invalid."""
    import cv2  # heavy; only the thread needs it

    units = np.nan_to_num(depth_m / DEPTH_SCALE_M, nan=0.0, posinf=0.0, neginf=0.0)
    scaled = np.clip(np.rint(units), 0, 65535).astype(np.uint16)
    return bytes(cv2.imencode(".png", scaled)[1])


def decode_depth(message: Mapping[str, Any]) -> Image:
    """The depth image (h, w) float32 [m] of a `/depth` message."""
    import cv2

    raw = np.frombuffer(base64.b64decode(message["data"]), dtype=np.uint8)
    return np.asarray(cv2.imdecode(raw, cv2.IMREAD_UNCHANGED), dtype=np.float32) * np.float32(
        message["scale_m"]
    )


def read_log(path: Path) -> Iterator[tuple[str, Body]]:
    """JSON messages (topic, body) in the order written, up to the end or to where the file is torn.

    Raises:
        BadInput: when it is no MCAP file at all.
    """
    for topic, encoding, data in read_raw(path):
        if encoding == "json":
            yield topic, json.loads(data)


def read_raw(path: Path) -> Iterator[tuple[str, str, bytes]]:
    """Messages (topic, encoding, bytes) in the order written, up to the end or to where the file is torn.

    Raises:
        BadInput: when it is no MCAP file at all.
    """
    channels: dict[int, Channel] = {}
    for record in records_of(path):
        if isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message) and record.channel_id in channels:
            channel = channels[record.channel_id]
            yield channel.topic, channel.message_encoding, record.data


def records_of(path: Path) -> Iterator[McapRecord]:
    """All records, up to the end or to where the file is torn.

    Raises:
        BadInput: when it is no MCAP file at all.
    """
    try:
        stream = path.open("rb")
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}", "Check the path") from None
    with stream:
        records = StreamReader(stream, record_size_limit=RECORD_MAX_BYTES).records
        any_read = False
        while True:
            try:
                record = next(records, None)
            except (McapError, ZstdError, struct.error, ValueError, EOFError) as error:
                if not any_read:
                    raise BadInput(f"{path} is not an MCAP file", "Name a flight.mcap of a run") from error
                return  # torn: the process was killed while writing
            if record is None:
                return
            any_read = True
            yield record


def _key_points(points: KeyPoints | None) -> Body | None:
    if points is None:
        return None
    return {
        "points_m": [_list(p) for p in points.points_m],
        "air": [bool(a) for a in points.air],
        "mu": points.mu,
        "source": points.source.value,
    }


def _list(values: Any, digits: int = 4) -> list[float]:
    return [round(float(v), digits) for v in values]


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
