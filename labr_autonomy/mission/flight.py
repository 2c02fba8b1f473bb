"""One flight: the tasks that connect the pilot to its links. It computes nothing itself."""

from __future__ import annotations

import asyncio
import gc
import logging
import math
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from labr_autonomy.air.channel import AirChannel
from labr_autonomy.clock import Clock, Ticker, utc_s
from labr_autonomy.config import RobotConfig
from labr_autonomy.console.live import LiveLine, LiveState
from labr_autonomy.errors import LabrError, LinkError
from labr_autonomy.estimation import error_state
from labr_autonomy.estimation.filter import PoseFilter
from labr_autonomy.estimation.vio_link import VioLink, udp_address
from labr_autonomy.estimation.vio_message import VioSample
from labr_autonomy.ground.channel import GroundChannel
from labr_autonomy.guard.failsafe import VIO_LATE_S, Reaction
from labr_autonomy.mission.desk import SHOW_S, Desk
from labr_autonomy.mission.instruments import look
from labr_autonomy.mission.logbook import Logbook
from labr_autonomy.mission.pilot import Actions, Look, Order, Pilot
from labr_autonomy.mission.steps import Status
from labr_autonomy.modes.transition import Command
from labr_autonomy.perception.frame_slot import FrameReader
from labr_autonomy.planner.messages import PlanResult
from labr_autonomy.planner.process import PlannerLink
from labr_autonomy.record.flight_log import FlightLog
from labr_autonomy.record.tlog import Tlog
from labr_autonomy.types import ImuSample, Mode, Odometry, WheelOdometry

TICK_S = 0.02  # set-points at 50 Hz
PLAN_PERIOD_S = 0.1
VISION_PERIOD_S = 1.0 / 30.0
LOG_PERIOD_S = 0.1
FRAME_LOG_PERIOD_S = 0.5
STATE_LOG_PERIOD_S = 0.2  # of what the console shows
MAP_PERIOD_S = 1.0  # for the console; the planner sends one as often
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
        self._line = line
        self._legs = legs
        self._logs: dict[str, FlightLog | Tlog] = {"flight.mcap": flight_log, **tlogs}
        self._logs_stopped: set[str] = set()
        self._filter = PoseFilter()
        self._planner = PlannerLink(config, config.links.depth, run_dir / "planner.log")
        self._frames: FrameReader | None = None
        self._vio: VioLink | None = None
        self._commands: asyncio.Queue[Command] = asyncio.Queue(maxsize=1)
        self._plan_sequence = 0
        self._planned_s = -math.inf
        self._result_s = -math.inf
        self._air_error = ""
        self._logged_frame_s = -math.inf
        self._actions: Actions | None = None
        self._done = asyncio.Event()
        self.record = Logbook()
        self.desk = Desk(config, pilot, self.record, self._say, waits=waits)
        self.planner_versions: dict[str, str] = {}

    # ------------------------------------------------------------------ opening and closing
    async def open(self, say: Callable[[str], None]) -> None:
        """Open every link and wait until each of them answers.

        Raises:
            LinkError: Naming the link that does not.
        """
        self._planner.start()
        error_state.warm_up()
        host, port = udp_address(self._config.links.vio)
        say(f"poses on {host}:{port}; land controller on {self._config.links.ground}")
        self._vio = VioLink(self._config.links.vio, self._take_vio, self._clock)
        await self._vio.open()
        self._frames = await asyncio.to_thread(FrameReader, self._config.links.depth, FIRST_POSE_S)
        self._ground.on_odometry = self._take_wheels
        await self._ground.open(5.0)
        self._air.on_imu = self._take_imu
        say(f"autopilot on {self._config.links.air}")
        await self._air.connect(15.0)
        say(f"autopilot: {self._air.description}")
        await self._air.check_parameters()
        await self._air.give_origin()
        say("planner: loading network, map and refiner (the first start compiles and takes a minute)")
        ready = await self._planner.wait_ready()
        self.planner_versions = ready.versions
        say(f"planner ready after {ready.load_s:.1f} s")
        await self._first_pose()

    async def _first_pose(self) -> None:
        deadline_s = self._clock.now_s() + FIRST_POSE_S
        while True:
            now_s = self._clock.now_s()
            header = self._frames.newest_header() if self._frames is not None else None
            if self._filter.ready and header is not None and self._filter.ages(now_s)["vio"] < FRESH_POSE_S:
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
        self._planner.close()
        if self._frames is not None:
            self._frames.close()
        if self._vio is not None:
            self._vio.close()
        await self._ground.close()
        await self._air.close()

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
                    tasks.create_task(self._planner_loop(), name="planner watch"),
                    tasks.create_task(self._show_loop(), name="log and live line"),
                    tasks.create_task(self._desk_loop(), name="operator's desk"),
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
            ages = self._ages(now_s)
            if self.desk.poll(self._filter.predicted(now_s), ages, now_s):
                self._show_desk(ages, now_s)  # the answer does not wait for the next showing
            seen = self._look(now_s)
            actions = self._pilot.tick(seen, now_s)
            self._send(actions)
            if seen.odometry is not None:
                self.desk.ticked(actions, seen.odometry, late_s, now_s)
                self._account(actions, seen.odometry, now_s, now_s - before_s)
            before_s = now_s
            self._plan(seen.odometry, now_s)
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
        header = self._frames.newest_header() if self._frames is not None else None
        return look(
            self._pilot,
            self._config,
            self._filter,
            self._ground.state,
            self._air.state,
            restarts=self._air.reboots,
            depth_stamp_s=None if header is None else header[1],
            plan_age_s=now_s - max(self._result_s, self.record.started_s),
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
        if self._actions is None or actions.phase is not self._actions.phase:
            self._log.mode(self._clock.now_s(), actions.mode.value, actions.phase.value, self.desk.note)
        self._actions = actions

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

    async def _planner_loop(self) -> None:
        """Notice the planner's death and replace it once."""
        ticker = Ticker(self._clock, 0.1)
        self._planner.on_result = self._take_plan
        while True:
            await ticker.wait()
            if self._planner.alive:
                continue
            if self._planner.restarts:
                self._pilot.fail("the planner process ended twice")
                return
            self._say("the planner process ended; starting it again")
            try:
                await self._planner.restart()
            except LabrError as error:
                self._pilot.fail(f"the planner could not be started again: {error.what}")
                return

    async def _show_loop(self) -> None:
        ticker = Ticker(self._clock, LOG_PERIOD_S)
        while True:
            await ticker.wait()
            now_s = self._clock.now_s()
            estimate = self._filter.predicted(now_s)
            if estimate is not None:
                self._log.odometry(estimate)
            ages = self._ages(now_s)
            self._log.link_ages(now_s, ages)
            ground, air, meter = self._ground.state, self._air.state, self.record.meter
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
            self._show(now_s, ages)
            self._check_logs()
            self._log_frame()

    async def _desk_loop(self) -> None:
        """Show the flight to whoever watches; nothing of it waits."""
        ticker = Ticker(self._clock, SHOW_S)
        log_due_s = map_due_s = -math.inf
        while True:
            await ticker.wait()
            now_s = self._clock.now_s()
            state = self._show_desk(self._ages(now_s), now_s)
            if state is not None and now_s >= log_due_s:
                log_due_s = now_s + STATE_LOG_PERIOD_S
                self._log.console(now_s, state)
            if now_s >= map_due_s:
                map_due_s = now_s + MAP_PERIOD_S
                self.desk.show_map()

    def show_end(self, outcome: str) -> None:
        """The last state that the console shows, before the links are closed."""
        self.desk.ended(outcome)
        now_s = self._clock.now_s()
        state = self._show_desk(self._ages(now_s), now_s)
        if state is not None:
            self._log.console(now_s, state)

    def _show_desk(self, ages: dict[str, float], now_s: float) -> dict[str, Any] | None:
        if self._actions is None:
            return None
        estimate, healthy = self._filter.predicted(now_s), not self._logs_stopped
        ground, air = self._ground.state, self._air.state
        return self.desk.show(self._actions, estimate, ages, ground, air, healthy, now_s)

    def _show(self, now_s: float, ages: dict[str, float]) -> None:
        actions = self._actions
        if actions is None:
            return
        self._line.update(
            LiveState(
                time_s=now_s - self.record.started_s,
                mode=actions.mode.value,
                phase=actions.phase.value,
                leg=min(self._pilot.steps.index + 1, self._legs),
                legs=self._legs,
                goal=actions.step.label if actions.step else "-",
                distance_m=actions.distance_m,
                energy_j=self.record.meter.energy_j,
                link_ages_s=ages,
                note=self.desk.note,
            )
        )

    def _check_logs(self) -> None:
        """Say once when a log has stopped; the flight goes on."""
        for name, log_file in self._logs.items():
            if log_file.fault and name not in self._logs_stopped:
                self._logs_stopped.add(name)
                self._say(f"{name} has stopped: {log_file.fault}")

    def _log_frame(self) -> None:
        header = self._frames.newest_header() if self._frames is not None else None
        if header is None or self._frames is None:
            return
        then = self._filter.at(header[1])
        if then is None or header[1] - self._logged_frame_s < FRAME_LOG_PERIOD_S:
            return
        self._logged_frame_s = header[1]
        frame = self._frames.get(header[0])
        if frame is not None:
            self._log.depth(frame, then.pose, self._config.camera)

    def _ages(self, now_s: float) -> dict[str, float]:
        header = self._frames.newest_header() if self._frames is not None else None
        return {
            "vio": self._filter.ages(now_s)["vio"],
            "depth": math.inf if header is None else now_s - header[1],
            "plan": now_s - self._result_s,
            "air": now_s - self._air.state.stamp_s,
            "stm32": self._ground.state.age_s,
        }

    # ------------------------------------------------------------------ what comes in
    def _take_vio(self, sample: VioSample) -> None:
        self._filter.add_vio(sample)

    def _take_imu(self, sample: ImuSample) -> None:
        self._filter.add_imu(sample)

    def _take_wheels(self, sample: WheelOdometry) -> None:
        standing = self._pilot.mode is Mode.LAND and self._ground.state.wheel_load
        self._filter.add_wheels(sample, standing)

    def _take_plan(self, result: PlanResult) -> None:
        now_s = self._clock.now_s()
        if math.isfinite(result.frame_stamp_s):  # a plan from a stale map does not count as news
            self._result_s = now_s
        self.record.plan_cycle_s.append(result.timings.total_s)
        if result.map_xy_m is not None:
            self.record.map_xy_m = result.map_xy_m
            self._log.map(now_s, result.map_xy_m, self._pilot.floor_z_m)
        self._pilot.accept(result, now_s)
        self.desk.take_plan(result, now_s)
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

    def _plan(self, estimate: Odometry | None, now_s: float) -> None:
        if self._planner.busy or now_s - self._planned_s < PLAN_PERIOD_S or self._frames is None:
            return
        header = self._frames.newest_header()
        if header is None or estimate is None:
            return
        then = self._filter.at(header[1])
        if then is None:
            return
        self._plan_sequence += 1
        request = self._pilot.request(self._plan_sequence, header[0], then.pose, estimate, now_s)
        if self._planner.send(self.desk.with_probe(request)):
            self._planned_s = now_s

    def _say(self, sentence: str) -> None:
        now_s = self._clock.now_s()
        self.desk.noted(sentence, now_s)
        self._log.event(now_s, sentence)
        self._line.say(f"{now_s - self.record.started_s:7.2f} s  {sentence}")
        log.info("%.3f %s", utc_s(), sentence)
