"""One flight: the tasks that connect the pilot to its links. It computes nothing itself."""

from __future__ import annotations

import asyncio
import gc
import logging
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from labr_autonomy.air.channel import AirChannel
from labr_autonomy.clock import Clock, Ticker, utc_s
from labr_autonomy.config import RobotConfig
from labr_autonomy.console.live import LiveLine
from labr_autonomy.errors import LabrError, LinkError
from labr_autonomy.estimation import error_state
from labr_autonomy.estimation.filter import PoseFilter
from labr_autonomy.estimation.vio_link import VioLink, udp_address
from labr_autonomy.estimation.vio_message import VioSample
from labr_autonomy.ground.channel import GroundChannel
from labr_autonomy.guard.failsafe import VIO_LATE_S, Reaction
from labr_autonomy.mission.desk import Desk
from labr_autonomy.mission.instruments import look
from labr_autonomy.mission.logbook import Logbook
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.mission.pilot_io import Actions, Look, Order
from labr_autonomy.mission.planning import Planning
from labr_autonomy.mission.showing import Showing
from labr_autonomy.mission.steps import Status
from labr_autonomy.mission.watchers import Watchers
from labr_autonomy.modes.transition import Command, Phase
from labr_autonomy.record.flight_log import FlightLog
from labr_autonomy.record.tlog import Tlog
from labr_autonomy.types import ImuSample, Mode, Odometry, WheelOdometry

TICK_S = 0.02  # set-points at 50 Hz
VISION_PERIOD_S = 1.0 / 30.0
FIRST_POSE_S = 10.0
FRESH_POSE_S = 0.15
END_LATE_S = 90.0  # a flight that is over must be down by then; later there is nothing left to wait for

log = logging.getLogger("labr.flight")


class Flight:
    """Links, tasks and records of one mission.

    Args:
        config: The robot, with its links.
        pilot: Decides; fed at 50 Hz.
        clock: Time.
        air: The autopilot.
        ground: The land controller.
        flight_log: Where everything is written.
        line: Shows the flight.
        legs: Number of steps, for the live line.
        tlogs: The links' logs by name, watched for a full disk.
        run_dir: Folder of the run.
        waits: The mission begins when its operator says so.
    """

    def __init__(
        self,
        config: RobotConfig,
        pilot: Pilot,
        clock: Clock,
        air: AirChannel,
        ground: GroundChannel,
        flight_log: FlightLog,
        line: LiveLine,
        legs: int,
        tlogs: Mapping[str, Tlog],
        run_dir: Path,
        *,
        waits: bool = False,
    ) -> None:
        self._config = config
        self._pilot = pilot
        self._clock = clock
        self._air = air
        self._ground = ground
        self._log = flight_log
        self._filter = PoseFilter()
        self._watchers = Watchers()
        self._vio: VioLink | None = None
        self._commands: asyncio.Queue[Command] = asyncio.Queue(maxsize=1)
        self._air_error = ""
        self._phase: Phase | None = None
        self._done = asyncio.Event()
        self.record = Logbook()
        self.desk = Desk(config, pilot, self.record, self._say, waits=waits)
        self._planning = Planning(
            config,
            pilot,
            clock,
            self._filter,
            self.desk,
            self.record,
            flight_log,
            self._say,
            run_dir / "planner.log",
        )
        self._showing = Showing(
            clock,
            pilot,
            self._filter,
            self._planning,
            air,
            ground,
            config.camera,
            self.desk,
            self.record,
            flight_log,
            line,
            legs,
            tlogs,
        )

    # ------------------------------------------------------------------ opening and closing
    async def open(self, say: Callable[[str], None]) -> None:
        """Open every link and wait until each of them answers.

        Raises:
            LinkError: Naming the link that does not.
        """
        self._planning.start()
        error_state.warm_up()
        host, port = udp_address(self._config.links.vio)
        say(f"poses on {host}:{port}; land controller on {self._config.links.ground}")
        self._vio = VioLink(self._config.links.vio, self._take_vio, self._clock)
        await self._vio.open()
        await self._planning.open_frames()
        self._ground.on_odometry = self._take_wheels
        await self._ground.open(5.0)
        self._air.on_imu = self._take_imu
        say(f"autopilot on {self._config.links.air}")
        await self._air.connect(15.0)
        say(f"autopilot: {self._air.description}")
        await self._air.check_parameters()
        await self._air.give_origin()
        say("planner: loading network, map and refiner (the first start compiles and takes a minute)")
        say(f"planner ready after {await self._planning.ready():.1f} s")
        await self._first_pose()

    async def _first_pose(self) -> None:
        deadline_s = self._clock.now_s() + FIRST_POSE_S
        while True:
            now_s = self._clock.now_s()
            frame = self._planning.newest_frame()
            if self._filter.ready and frame is not None and self._filter.ages(now_s)["vio"] < FRESH_POSE_S:
                return
            if now_s > deadline_s:
                raise LinkError(
                    f"no pose on {self._config.links.vio} within {FIRST_POSE_S:.0f} s",
                    "Start the VIO and look at its output",
                )
            await self._clock.sleep_until(now_s + 0.05)

    def odometry(self) -> Odometry:
        """The present estimate; only after `open`."""
        estimate = self._filter.predicted(self._clock.now_s())
        if estimate is None:
            raise LinkError("there is no pose yet", "Start the VIO and look at its output")
        return estimate

    async def close(self) -> None:
        """Wheels to rest, processes and ports gone."""
        self._ground.send_velocity(0.0, 0.0, engaged=False, air_lock=False)
        self._planning.close()
        if self._vio is not None:
            self._vio.close()
        await self._ground.close()
        await self._air.close()

    @property
    def planner_versions(self) -> dict[str, str]:
        """Of what plans; only after `open`."""
        return self._planning.versions

    def show_end(self, outcome: str) -> None:
        """The last state that the console shows, before the links are closed."""
        self._showing.end(outcome)

    @property
    def aborted(self) -> bool:
        """Whether the operator ended the flight."""
        return self.desk.order is Order.LAND

    # ------------------------------------------------------------------ the tasks
    async def run(self) -> None:
        """Fly until the mission is over and the robot stands."""
        gc.collect()
        gc.freeze()  # a full collection over the loaded modules would stall the set-points by 150 ms
        await self._first_pose()  # what arrived meanwhile
        self.record.started_s = self._clock.now_s()
        self._air.on_say = lambda words: self._say(f"autopilot: {words}")
        try:
            async with asyncio.TaskGroup() as tasks:
                running = [
                    tasks.create_task(self._ground.run(), name="ground link"),
                    tasks.create_task(self._tick_loop(), name="set-points"),
                    tasks.create_task(self._vision_loop(), name="vision to autopilot"),
                    tasks.create_task(self._command_loop(), name="commands"),
                    tasks.create_task(self._planning.watch(), name="planner watch"),
                    tasks.create_task(self._showing.log_loop(), name="log and live line"),
                    tasks.create_task(self._showing.desk_loop(), name="operator's desk"),
                ]
                await self._done.wait()
                for task in running:
                    task.cancel()
        finally:
            gc.unfreeze()
            self.record.ended_s = self._clock.now_s()

    async def _tick_loop(self) -> None:
        ticker = Ticker(self._clock, TICK_S)
        before_s = self._clock.now_s()
        over_s: float | None = None
        while True:
            late_s = await ticker.wait()
            now_s = self._clock.now_s()
            self.record.tick_late_s.append(late_s)
            self.record.ticks_missed = ticker.missed
            if self.desk.poll(self._filter.predicted(now_s), self._showing.ages(now_s), now_s):
                self._showing.desk(now_s)  # the answer does not wait for the next showing
            seen = self._look(now_s)
            actions = self._pilot.tick(seen, now_s)
            self._send(actions)
            if seen.odometry is not None:
                self.desk.ticked(actions, seen.odometry, late_s, now_s)
                self._account(actions, seen.odometry, now_s, now_s - before_s)
            before_s = now_s
            self._planning.ask(seen.odometry, now_s)
            ending = self._pilot.steps.status in (Status.DONE, Status.FAILED)
            if over_s is None and (self.aborted or ending or actions.reaction >= Reaction.LAND):
                over_s = now_s
            landed = (
                self.aborted and actions.phase.value == "driving" and abs(self._ground.state.speed_mps) < 0.05
            )
            late = over_s is not None and now_s - over_s > END_LATE_S
            yielded = actions.reaction is Reaction.YIELD and not self._air.state.armed
            if actions.finished or landed or late or yielded:
                self._done.set()
                return

    def _look(self, now_s: float) -> Look:
        frame = self._planning.newest_frame()
        return look(
            self._pilot,
            self._watchers,
            self._config,
            self._filter,
            self._ground.state,
            self._air.state,
            restarts=self._air.reboots,
            depth_stamp_s=None if frame is None else frame[1],
            plan_age_s=self._planning.result_age_s(now_s, self.record.started_s),
            order=self.desk.order,
            now_s=now_s,
        )

    def _send(self, actions: Actions) -> None:
        speed, turn, lock = actions.speed_mps, actions.yaw_rate_rps, actions.air_lock
        taken = self._ground.send_velocity(speed, turn, engaged=actions.engaged, air_lock=lock)
        if actions.engaged and not taken:  # after a pause the controller wants to see us let go first
            self._ground.send_velocity(0.0, 0.0, engaged=False, air_lock=lock)
        if actions.air is not None:
            self._air_says(partial(self._air.send_setpoint, actions.air))
        if actions.reaction is Reaction.YIELD:
            self._air.yield_control()
        if actions.command is not None:
            if self._commands.full():  # the newest command counts
                self._commands.get_nowait()
            self._commands.put_nowait(actions.command)
        for sentence in actions.events:
            self._say(sentence)
        if actions.reference is not None:
            self._log.setpoint(actions.reference)
        if actions.phase is not self._phase:
            self._phase = actions.phase
            self._log.mode(self._clock.now_s(), actions.mode.value, actions.phase.value, self.desk.note)
        self._showing.actions = actions

    def _air_says(self, send: Callable[[], None]) -> None:
        """Send to the autopilot; what it cannot take is said once, until it can again."""
        try:
            send()
            self._air_error = ""
        except LabrError as error:
            if error.what != self._air_error:
                self._say(f"air: {error}")
            self._air_error = error.what

    def _account(self, actions: Actions, estimate: Odometry, now_s: float, dt_s: float) -> None:
        ground = self._ground.state
        power_w = ground.battery_v * ground.current_a
        self.record.tick(self._pilot, actions, estimate, power_w, now_s, dt_s)

    async def _vision_loop(self) -> None:
        ticker = Ticker(self._clock, VISION_PERIOD_S)
        while True:
            await ticker.wait()
            now_s = self._clock.now_s()
            estimate = self._filter.predicted(now_s)
            if estimate is None or self._filter.ages(now_s)["vio_accepted"] > VIO_LATE_S:
                continue  # the autopilot has its own way with a lost pose, and must learn of it
            self._air_says(partial(self._air.send_vision, estimate))

    async def _command_loop(self) -> None:
        requests = {
            Command.OFFBOARD: self._air.start_offboard,
            Command.ARM: self._air.arm,
            Command.TAKE_OFF: lambda: self._air.take_off(self._pilot.take_off_m),
            Command.LAND: self._air.land,
            Command.DISARM: self._air.disarm,
        }

        async def carry_out(command: Command) -> None:
            try:
                await requests[command]()
            except LabrError as error:
                self._say(f"air: {error}")

        async with asyncio.TaskGroup() as tasks:
            current: asyncio.Task[None] | None = None
            while True:
                command = await self._commands.get()
                if current is not None:
                    current.cancel()  # the newest request counts; a cancelled one is not repeated
                current = tasks.create_task(carry_out(command), name=f"request {command.value}")

    # ------------------------------------------------------------------ what comes in
    def _take_vio(self, sample: VioSample) -> None:
        self._filter.add_vio(sample)

    def _take_imu(self, sample: ImuSample) -> None:
        self._filter.add_imu(sample)

    def _take_wheels(self, sample: WheelOdometry) -> None:
        standing = self._pilot.mode is Mode.LAND and self._ground.state.wheel_load
        self._filter.add_wheels(sample, standing)

    def _say(self, sentence: str) -> None:
        self._showing.say(sentence)
        log.info("%.3f %s", utc_s(), sentence)
