"""The flight log `flight.mcap`: which message each event of a flight becomes.

Topics of our own are JSON; beside them stand the topics that viewers know by itself (`record.foxglove`).
Messages are made in the writer's thread (`record.mcap_writer`), not in the caller's.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.clock import Clock, SystemClock
from labr_autonomy.config import Camera
from labr_autonomy.record.depth_jpeg import depth_jpeg
from labr_autonomy.record.depth_png import DEPTH_SCALE_M, encode_depth
from labr_autonomy.record.mcap_writer import QUEUE_MAX, Body, McapWriter, Viewers
from labr_autonomy.types import DepthFrame, KeyPoints, Odometry, Pose, SetPoint, Source, Trajectory

DEPTH_PERIOD_S = 0.5  # raw depth would be 4.6 MB/s
PATH_POINTS = 24  # of a trajectory, kept for the pictures


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
        self._depth_period_s = depth_period_s
        self._depth_next_s = -math.inf
        self._writer = McapWriter(path, clock or SystemClock(), metadata or {}, foxglove.register, queue_max)
        self._put = self._writer.put

    @property
    def dropped(self) -> int:
        """Entries that were lost because the disk was too slow or failed."""
        return self._writer.dropped

    @property
    def fault(self) -> str | None:
        """Why writing has stopped, if it has."""
        return self._writer.fault

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
        self._writer.close()

    def __enter__(self) -> Self:
        """For `with`."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()


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
