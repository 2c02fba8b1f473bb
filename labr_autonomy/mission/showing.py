"""What a flight shows while it goes on: the flight log, the live line, the operator's desk. Nothing waits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from labr_autonomy.air.channel import AirChannel
from labr_autonomy.clock import Clock, Ticker
from labr_autonomy.config import Camera
from labr_autonomy.console.live import LiveLine, LiveState
from labr_autonomy.estimation.filter import PoseFilter
from labr_autonomy.ground.channel import GroundChannel
from labr_autonomy.mission.desk import SHOW_S, Desk
from labr_autonomy.mission.logbook import Logbook
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.mission.pilot_io import Actions
from labr_autonomy.mission.planning import Planning
from labr_autonomy.record.flight_log import FlightLog
from labr_autonomy.record.tlog import Tlog

LOG_PERIOD_S = 0.1
FRAME_LOG_PERIOD_S = 0.5
STATE_LOG_PERIOD_S = 0.2  # of what the console shows
MAP_PERIOD_S = 1.0  # for the console; the planner sends one as often


class Showing:
    """Everything that watches a flight.

    Args:
        clock: Time.
        pilot: Where in the mission it is.
        poses: The estimate.
        planning: Frames and the age of plans.
        air: The autopilot.
        ground: The land controller.
        camera: For the logged frames.
        desk: The operator's.
        record: Figures.
        flight_log: Where everything is written.
        line: Shows the flight.
        legs: Number of steps, for the live line.
        tlogs: The links' logs by name, watched for a full disk.

    Attributes:
        actions: The last ones, None before the first tick.
    """

    def __init__(
        self,
        clock: Clock,
        pilot: Pilot,
        poses: PoseFilter,
        planning: Planning,
        air: AirChannel,
        ground: GroundChannel,
        camera: Camera,
        desk: Desk,
        record: Logbook,
        flight_log: FlightLog,
        line: LiveLine,
        legs: int,
        tlogs: Mapping[str, Tlog],
    ) -> None:
        self._clock = clock
        self._pilot = pilot
        self._poses = poses
        self._planning = planning
        self._air = air
        self._ground = ground
        self._camera = camera
        self._desk = desk
        self._record = record
        self._log = flight_log
        self._line = line
        self._legs = legs
        self._logs: dict[str, FlightLog | Tlog] = {"flight.mcap": flight_log, **tlogs}
        self._stopped: set[str] = set()  # of the logs
        self._logged_frame_s = -math.inf
        self.actions: Actions | None = None

    def say(self, sentence: str) -> None:
        """A sentence for the desk, the log and the live line."""
        now_s = self._clock.now_s()
        self._desk.noted(sentence, now_s)
        self._log.event(now_s, sentence)
        self._line.say(f"{now_s - self._record.started_s:7.2f} s  {sentence}")

    def ages(self, now_s: float) -> dict[str, float]:
        """Seconds since the last word of each link."""
        frame = self._planning.newest_frame()
        return {
            "vio": self._poses.ages(now_s)["vio"],
            "depth": math.inf if frame is None else now_s - frame[1],
            "plan": self._planning.result_age_s(now_s),
            "air": now_s - self._air.state.stamp_s,
            "stm32": self._ground.state.age_s,
        }

    async def log_loop(self) -> None:
        """Write the log and move the live line."""
        ticker = Ticker(self._clock, LOG_PERIOD_S)
        while True:
            await ticker.wait()
            now_s = self._clock.now_s()
            estimate = self._poses.predicted(now_s)
            if estimate is not None:
                self._log.odometry(estimate)
            ages = self.ages(now_s)
            self._log.link_ages(now_s, ages)
            self._log_battery(now_s)
            self._move_line(now_s, ages)
            self._check_logs()
            self._log_frame()

    async def desk_loop(self) -> None:
        """Show the flight to whoever watches at the console."""
        ticker = Ticker(self._clock, SHOW_S)
        log_due_s = map_due_s = -math.inf
        while True:
            await ticker.wait()
            now_s = self._clock.now_s()
            state = self.desk(now_s)
            if state is not None and now_s >= log_due_s:
                log_due_s = now_s + STATE_LOG_PERIOD_S
                self._log.console(now_s, state)
            if now_s >= map_due_s:
                map_due_s = now_s + MAP_PERIOD_S
                self._desk.show_map()

    def end(self, outcome: str) -> None:
        """The last state that the console shows, before the links are closed."""
        self._desk.ended(outcome)
        now_s = self._clock.now_s()
        state = self.desk(now_s)
        if state is not None:
            self._log.console(now_s, state)

    def desk(self, now_s: float) -> dict[str, Any] | None:
        """Show the desk the present; what it was shown, None before the first tick."""
        if self.actions is None:
            return None
        estimate, healthy = self._poses.predicted(now_s), not self._stopped
        ground, air = self._ground.state, self._air.state
        return self._desk.show(self.actions, estimate, self.ages(now_s), ground, air, healthy, now_s)

    def _log_battery(self, now_s: float) -> None:
        ground, air, meter = self._ground.state, self._air.state, self._record.meter
        volts, amps = air.battery_v, air.current_a
        self._log.battery(
            now_s,
            voltage_v=ground.battery_v,
            power_w=ground.battery_v * ground.current_a,
            energy_land_j=meter.energy_land_j,
            energy_air_j=meter.energy_air_j,
            energy_transition_j=meter.energy_transition_j,
            air_voltage_v=volts,
            air_power_w=None if volts is None or amps is None else volts * amps,
        )

    def _move_line(self, now_s: float, ages: dict[str, float]) -> None:
        actions = self.actions
        if actions is None:
            return
        self._line.update(
            LiveState(
                time_s=now_s - self._record.started_s,
                mode=actions.mode.value,
                phase=actions.phase.value,
                leg=min(self._pilot.steps.index + 1, self._legs),
                legs=self._legs,
                goal=actions.step.label if actions.step else "-",
                distance_m=actions.distance_m,
                energy_j=self._record.meter.energy_j,
                link_ages_s=ages,
                note=self._desk.note,
            )
        )

    def _check_logs(self) -> None:
        """Say once when a log has stopped; the flight goes on."""
        for name, log_file in self._logs.items():
            if log_file.fault and name not in self._stopped:
                self._stopped.add(name)
                self.say(f"{name} has stopped: {log_file.fault}")

    def _log_frame(self) -> None:
        newest = self._planning.newest_frame()
        if newest is None or self._planning.frames is None:
            return
        sequence, stamp_s = newest
        then = self._poses.at(stamp_s)
        if then is None or stamp_s - self._logged_frame_s < FRAME_LOG_PERIOD_S:
            return
        self._logged_frame_s = stamp_s
        frame = self._planning.frames.get(sequence)
        if frame is not None:
            self._log.depth(frame, then.pose, self._camera)
