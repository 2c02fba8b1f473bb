"""The stand-in of ArduCopter without its socket: bytes in, bytes out, motor duties out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from pymavlink.dialects.v20 import development as mavlink

from sim.autopilot.brain import DT_MAX_S, Motors, Pack, truth_ned
from sim.autopilot.controller import Controller, Target
from sim.autopilot.copter import rules
from sim.autopilot.copter.parameters import Parameters
from sim.autopilot.copter.rules import Answer, Mode, Result
from sim.autopilot.copter.telemetry import BUILDERS, RATES_HZ, Snapshot
from sim.autopilot.estimator import FRAME_BODY_FRD, FRAME_LOCAL_FRD, Estimate, Estimator
from sim.autopilot.imu import Imu
from sim.autopilot.setpoint import target_of
from sim.autopilot.vectors import Vector
from sim.autopilot.vision import ClockOffset, pose_of_odometry
from sim.quad.state import QuadState

LAND_MPS = 0.5  # LAND_SPEED; "SIM Hit ground at 0.500050 m/s"
TOUCH_MPS = 0.25
BOUNCE_S = 0.2  # wheels that leave the floor for less than this have only trembled
TOUCH_LANDED_S = 1.9  # from touch-down to "landed", as recorded
RAMP_S = 1.5  # thrust from idle to hovering at the end of spinning up
CUSTOM_MODE = 1


class Copter:
    """Autopilot of one quad.

    Args:
        send: Takes the bytes of each outgoing message.
        seed: Of the IMU.
        boot_s: How long ago it was started [s]; in its first 23 s it does not arm.
    """

    def __init__(self, send: Callable[[bytes], None], *, seed: int = 0, boot_s: float = 30.0) -> None:
        self._boot_s = boot_s
        self._send_bytes = send
        self._codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._inbox: list[bytes] = []
        self._start_s: float | None = None
        self._now_s = 0.0
        self._stepped = False
        self._imu = Imu(seed)
        self._offset = ClockOffset()
        self._periods_s = {number: 1.0 / rate for number, rate in RATES_HZ.items()}
        self._due_s: dict[int, float] = {}
        self._truth: QuadState | None = None
        self._pack: Pack | None = None
        self._positioned = False
        self._setpoint: Target | None = None
        self._setpoint_s = -math.inf
        self._hold: Vector | None = None  # where it stays without set-points
        self._landing_from: Vector | None = None
        self._home_down_m = 0.0
        self._contact_s = -math.inf  # when a wheel last carried something
        self._touch_s: float | None = 0.0  # since when it stands
        self._target = Target()
        self._lift_s: float | None = None
        self._controller = Controller()
        self.estimator = Estimator()
        self.estimate = Estimate()
        self.parameters = Parameters()
        self.origin: tuple[int, int, int] | None = None
        self.state = rules.State()
        self._shown_mode = self.state.mode

    @property
    def armed(self) -> bool:
        """Whether the rotors may turn."""
        return self.state.armed

    @property
    def mode_name(self) -> str:
        """Mode that runs, in a word."""
        return self.state.mode.name.lower()

    def receive(self, data: bytes) -> None:
        """Take bytes off the link; they are looked at in the next step."""
        self._inbox.append(data)

    def step(self, now_s: float, truth: QuadState, pack: Pack) -> Motors | None:
        """One tick of 4 ms; (4,) duties, None while disarmed."""
        if self._start_s is None:
            self._start_s = now_s - self._boot_s
        dt_s = max(0.0, now_s - self._start_s - self._now_s) if self._stepped else 0.004
        self._stepped = True
        self._now_s = now_s - self._start_s
        self._truth, self._pack = truth, pack
        self.estimate = self.estimator.step(truth_ned(self._now_s, truth))
        was = self.state
        inbox, self._inbox = self._inbox, []
        for data in inbox:
            for message in self._parser.parse_buffer(data) or ():
                self._handle(message)
        self.state = rules.step(self.state, self._inputs(), self._now_s)
        self._announce(was)
        motors = self._fly(min(dt_s, DT_MAX_S))
        self._talk()
        return motors

    # --- flying ---------------------------------------------------------------------------------------

    def _inputs(self) -> rules.Inputs:
        landed = self._touch_s is not None and self._now_s - self._touch_s >= TOUCH_LANDED_S
        up = self._home_down_m - self.estimate.position_m[2]
        height = up if math.isfinite(up) else 0.0
        known = self._positioned and self.estimate.position_valid
        return rules.Inputs(self._now_s, known, landed, height)

    def _fly(self, dt_s: float) -> Motors | None:
        truth, pack = self._truth, self._pack
        assert truth is not None
        assert pack is not None
        if truth.on_ground:
            self._contact_s = self._now_s
        slow = abs(float(truth.velocity_mps[2])) < TOUCH_MPS
        touching = slow and self._now_s - self._contact_s < BOUNCE_S
        self._touch_s = (self._now_s if self._touch_s is None else self._touch_s) if touching else None
        if not self.state.armed:
            self._controller.reset()
            self._lift_s = self._setpoint = self._hold = self._landing_from = None
            return None
        if touching and not rules.lifts(self.state, self._now_s) and self._may_idle():
            self._lift_s = None
            return tuple(self._controller.idle(pack.volts))
        self._lift_s = self._now_s if self._lift_s is None else self._lift_s
        share = 100.0 if not truth.on_ground else min(1.6, (self._now_s - self._lift_s) / RAMP_S)
        self._target = self._wanted()
        return tuple(self._controller.step(dt_s, self.estimate, self._target, share=share, volts=pack.volts))

    def _may_idle(self) -> bool:
        """On the floor only a take-off lifts; a landing idles once it stands."""
        standing = self._touch_s is not None and self._now_s - self._touch_s > 1.0
        return standing or not self.state.flown

    def _wanted(self) -> Target:
        here = self.estimate.position_m
        if self.state.mode is Mode.LAND:
            if self._landing_from is None:
                self._landing_from = here
            north, east, _ = self._landing_from
            return Target((north, east, math.nan), (0.0, 0.0, LAND_MPS), yaw_rad=self._yaw())
        self._landing_from = None
        if self.state.take_off_m is not None:
            self._hold = self._hold or here
            top = self._home_down_m - self.state.take_off_m
            return Target((self._hold[0], self._hold[1], top), yaw_rad=self._yaw())
        fresh = self._now_s - self._setpoint_s <= self.parameters["GUID_TIMEOUT"]
        if self.state.mode is Mode.GUIDED and self._setpoint is not None and fresh:
            self._hold = None
            return self._setpoint
        self._hold = self._hold or here
        return Target(self._hold, yaw_rad=self._yaw())

    def _yaw(self) -> float:
        last = self._target.yaw_rad
        return last if math.isfinite(last) else self.estimate.yaw_rad

    # --- what comes in --------------------------------------------------------------------------------

    def _handle(self, m: mavlink.MAVLink_message) -> None:
        if getattr(m, "target_system", self._codec.srcSystem) not in (0, self._codec.srcSystem):
            return
        match m.get_type():
            case "SET_POSITION_TARGET_LOCAL_NED":
                self._take_setpoint(m)
            case "ODOMETRY":
                self._take_pose(m)
            case "SET_GPS_GLOBAL_ORIGIN" if self.origin is None:
                self.origin = (m.latitude, m.longitude, m.altitude)
                self._send_origin()
                self._say("EKF3 IMU0 origin set", 6)
            case "TIMESYNC" if m.tc1 == 0:
                self.send(mavlink.MAVLink_timesync_message(int(self._now_s * 1e9), m.ts1))
            case "TIMESYNC":
                self._offset.answer(m.tc1, m.ts1, self._now_s)
            case "COMMAND_LONG" | "COMMAND_INT":
                self._answer(m, self._carry_out(m))
            case "PARAM_REQUEST_READ":
                self._tell(self.parameters.read(m.param_id))
            case "PARAM_SET":
                self._tell(self.parameters.write(m.param_id, m.param_value))
            case "PARAM_REQUEST_LIST":
                for row in self.parameters.everything():
                    self.send(row)

    def _take_setpoint(self, m: mavlink.MAVLink_message) -> None:
        flying = self.state.mode is Mode.GUIDED and self.state.flown and not self._inputs().landed
        target = target_of(m, self.estimate) if flying else None
        if target is not None:
            self._setpoint, self._setpoint_s = target, self._now_s
            if self.state.take_off_m is not None:  # it ends a take-off where it is
                self.state = replace(self.state, take_off_m=None)

    def _take_pose(self, m: mavlink.MAVLink_message) -> None:
        """Only LOCAL_FRD with BODY_FRD, and only with an origin."""
        if self.origin is None or (m.frame_id, m.child_frame_id) != (FRAME_LOCAL_FRD, FRAME_BODY_FRD):
            return
        pose = pose_of_odometry(m, self._offset.local_s(m.time_usec, self._now_s))
        if pose is None or not self.estimator.fuse(pose):
            return
        if not self._positioned:
            self._positioned = True
            self._say("EKF3 IMU0 is using external nav data", 6)

    def _carry_out(self, m: mavlink.MAVLink_message) -> Answer:
        i, now_s = self._inputs(), self._now_s
        match m.command:
            case mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
                if m.param1 >= 0.5:
                    was = self.state.armed
                    self.state, answer = rules.arm(self.state, i, now_s)
                    if self.state.armed and not was:
                        self._home_down_m = self.estimate.position_m[2]
                        self._target = Target(yaw_rad=self.estimate.yaw_rad)
                else:
                    self.state, answer = rules.disarm(self.state, i)
            case mavlink.MAV_CMD_DO_SET_MODE if int(m.param1) & CUSTOM_MODE:
                self.state, answer = self._change_mode(int(m.param2))
            case mavlink.MAV_CMD_NAV_LAND:
                self.state, answer = self._change_mode(Mode.LAND)
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                self.state, answer = rules.take_off(self.state, m.param7, i, now_s)
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                answer = self._set_interval(int(m.param1), m.param2)
            case mavlink.MAV_CMD_REQUEST_MESSAGE:
                answer = self._one_message(int(m.param1))
            case _:
                answer = Answer(Result.UNSUPPORTED)
        return answer

    def _change_mode(self, number: int) -> tuple[rules.State, Answer]:
        was = self.state.mode
        state, answer = rules.change_mode(self.state, number, self._inputs())
        if state.mode is not was:
            self._setpoint, self._hold = None, None
        return state, answer

    def _set_interval(self, number: int, interval_us: float) -> Answer:
        if number not in BUILDERS:
            return Answer(Result.DENIED, f"No ap_message for mavlink id ({number})")
        self._due_s.pop(number, None)
        if interval_us > 0.0:
            self._periods_s[number] = interval_us * 1e-6
        elif interval_us < 0.0:
            self._periods_s.pop(number, None)
        return Answer(Result.ACCEPTED)

    def _one_message(self, number: int) -> Answer:
        if number == mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN and self.origin is not None:
            self._send_origin()
        elif number in BUILDERS:
            self.send(BUILDERS[number](self._snapshot()))
        elif number != mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN:
            return Answer(Result.DENIED, f"No ap_message for mavlink id ({number})")
        return Answer(Result.ACCEPTED)

    # --- what goes out --------------------------------------------------------------------------------

    def send(self, message: mavlink.MAVLink_message) -> None:
        """Pack and send one message now."""
        data = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) & 255
        self._send_bytes(data)

    def _answer(self, asked: mavlink.MAVLink_message, answer: Answer) -> None:
        to = asked.get_srcSystem(), asked.get_srcComponent()
        self.send(mavlink.MAVLink_command_ack_message(asked.command, int(answer.result), 0, 0, *to))
        if answer.text:  # after the acknowledgement, as recorded
            self._say(answer.text, 6 if answer.result is Result.DENIED else 2)

    def _say(self, text: str, severity: int) -> None:
        self.send(mavlink.MAVLink_statustext_message(severity, text.encode()))

    def _tell(self, message: mavlink.MAVLink_message | None) -> None:
        if message is not None:
            self.send(message)

    def _send_origin(self) -> None:
        if self.origin is not None:
            self.send(mavlink.MAVLink_gps_global_origin_message(*self.origin, int(self._now_s * 1e6)))

    def _announce(self, was: rules.State) -> None:
        if was.armed is not self.state.armed:
            self._say("Arming motors" if self.state.armed else "Disarming motors", 6)

    def _talk(self) -> None:
        heartbeat = mavlink.MAVLINK_MSG_ID_HEARTBEAT
        shown = self.state.mode
        if shown is not self._shown_mode:
            self._shown_mode = shown
            self._due_s[heartbeat] = self._now_s
        for number, period_s in self._periods_s.items():
            due_s = self._due_s.setdefault(number, self._now_s + min(period_s, 1.0))
            if self._now_s >= due_s:
                self._due_s[number] = max(due_s + period_s, self._now_s)
                self.send(BUILDERS[number](self._snapshot()))

    def _snapshot(self) -> Snapshot:
        truth, pack = self._truth, self._pack
        assert truth is not None
        assert pack is not None
        i = self._inputs()
        return Snapshot(
            boot_s=self._now_s,
            truth=truth,
            estimate=self.estimate if i.positioned else Estimate(attitude=self.estimate.attitude),
            imu=self._imu.measure(truth.specific_force_mps2, truth.angular_velocity_rps),
            base_mode=rules.base_mode(self.state, i),
            custom_mode=int(self.state.mode),
            system_status=rules.system_status(self.state, i, self._now_s),
            landed_state=self._landed_state(i),
            volts=pack.volts,
            current_a=pack.current_a,
            remaining=pack.remaining,
            used_j=pack.used_j,
        )

    def _landed_state(self, i: rules.Inputs) -> int:
        if i.landed and not (self.state.armed and rules.lifts(self.state, self._now_s)):
            return 1
        if self.state.mode is Mode.LAND:
            return 4
        return 3 if self.state.take_off_m is not None else 2
