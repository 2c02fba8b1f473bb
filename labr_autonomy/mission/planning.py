"""Planning in flight: newest depth frames go to the planner's process, its plans come back to the pilot."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from pathlib import Path

from labr_autonomy.clock import Clock, Ticker
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import LabrError
from labr_autonomy.estimation.filter import PoseFilter
from labr_autonomy.mission.desk import Desk
from labr_autonomy.mission.logbook import Logbook
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.perception.frame_slot import FrameReader
from labr_autonomy.planner.messages import PlanResult
from labr_autonomy.planner.process import PlannerLink
from labr_autonomy.record.flight_log import FlightLog
from labr_autonomy.types import Odometry

PLAN_PERIOD_S = 0.1
WATCH_PERIOD_S = 0.1
FRAMES_S = 10.0


class Planning:
    """The planner's process and the frames that it plans from.

    Args:
        config: The robot, with its links.
        pilot: Says what to plan and follows what comes.
        clock: Time.
        poses: Where the body was when a frame was taken.
        desk: Is shown the plans.
        record: Counts them.
        flight_log: Where they are written.
        say: Says a sentence to whoever watches.
        log_path: What the process itself says.

    Attributes:
        frames: The camera's frames, None before `open_frames`.
        versions: Of what plans, known after `ready`.
    """

    def __init__(
        self,
        config: RobotConfig,
        pilot: Pilot,
        clock: Clock,
        poses: PoseFilter,
        desk: Desk,
        record: Logbook,
        flight_log: FlightLog,
        say: Callable[[str], None],
        log_path: Path,
    ) -> None:
        self._depth = config.links.depth
        self._pilot = pilot
        self._clock = clock
        self._poses = poses
        self._desk = desk
        self._record = record
        self._log = flight_log
        self._say = say
        self._link = PlannerLink(config, self._depth, log_path)
        self._sequence = 0
        self._asked_s = -math.inf
        self._result_s = -math.inf  # of the last plan from a fresh frame
        self.frames: FrameReader | None = None
        self.versions: dict[str, str] = {}

    # ------------------------------------------------------------------ opening and closing
    def start(self) -> None:
        """Start the process; it loads while the other links are opened."""
        self._link.start()

    async def open_frames(self) -> None:
        """Find the camera's frames.

        Raises:
            LinkError: There are none within 10 s.
        """
        self.frames = await asyncio.to_thread(FrameReader, self._depth, FRAMES_S)

    async def ready(self) -> float:
        """Wait until the process can plan; how long it loaded [s].

        Raises:
            LabrError: It ended, or takes too long.
        """
        ready = await self._link.wait_ready()
        self.versions = ready.versions
        return ready.load_s

    def close(self) -> None:
        """End the process and let go of the frames."""
        self._link.close()
        if self.frames is not None:
            self.frames.close()

    # ------------------------------------------------------------------ what is known
    def newest_frame(self) -> tuple[int, float] | None:
        """Sequence number and exposure stamp [s] of the newest frame."""
        return self.frames.newest_header() if self.frames is not None else None

    def result_age_s(self, now_s: float, since_s: float = -math.inf) -> float:
        """Time since the newest plan from a fresh frame, at most since `since_s` [s]."""
        return now_s - max(self._result_s, since_s)

    # ------------------------------------------------------------------ in flight
    def ask(self, estimate: Odometry | None, now_s: float) -> None:
        """Send the newest frame, when the planner is free and one is due."""
        if self._link.busy or now_s - self._asked_s < PLAN_PERIOD_S:
            return
        frame = self.newest_frame()
        if frame is None or estimate is None:
            return
        then = self._poses.at(frame[1])
        if then is None:
            return
        self._sequence += 1
        request = self._pilot.request(self._sequence, frame[0], then.pose, estimate, now_s)
        if self._link.send(self._desk.with_probe(request)):
            self._asked_s = now_s

    async def watch(self) -> None:
        """Take what comes, notice the process's death and replace it once."""
        ticker = Ticker(self._clock, WATCH_PERIOD_S)
        self._link.on_result = self._take
        while True:
            await ticker.wait()
            if self._link.alive:
                continue
            if self._link.restarts:
                self._pilot.fail("the planner process ended twice")
                return
            self._say("the planner process ended; starting it again")
            try:
                await self._link.restart()
            except LabrError as error:
                self._pilot.fail(f"the planner could not be started again: {error.what}")
                return

    def _take(self, result: PlanResult) -> None:
        now_s = self._clock.now_s()
        if math.isfinite(result.frame_stamp_s):  # a plan from a stale map does not count as news
            self._result_s = now_s
        self._record.plan_cycle_s.append(result.timings.total_s)
        if result.map_xy_m is not None:
            self._record.map_xy_m = result.map_xy_m
            self._log.map(now_s, result.map_xy_m, self._pilot.floor_z_m)
        self._pilot.accept(result, now_s)
        self._desk.take_plan(result, now_s)
        self._log.plan(
            now_s,
            frame_stamp_s=result.frame_stamp_s,
            network=result.network,
            followed=result.followed,
            trajectory=result.trajectory,
            source=result.source,
            clearance_m=result.clearance_m,
            reason=result.reason,
            timings_s={
                "map": result.timings.map_s,
                "network": result.timings.network_s,
                "route": result.timings.route_s,
                "refine": result.timings.refine_s,
                "total": result.timings.total_s,
            },
        )
