"""Between the executive and an autopilot that somebody else has started; also the plant's flying body."""

from __future__ import annotations

import logging
import math
import socket
from collections.abc import Sequence

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import LinkError
from labr_autonomy.frames import quaternion_multiply, yaw_of
from labr_autonomy.types import Array
from sim.autopilot.brain import Pack
from sim.autopilot.vectors import Vector
from sim.external.alignment import Alignment
from sim.external.endpoint import BATCH_MAX, Endpoint
from sim.external.truth import NAMES, Truth, TruthReader
from sim.external.turned import GRAVITY_MPS2, add_rover, specific_force_mps2, to_autopilot, to_executive
from sim.quad.state import QuadState

WAIT_S = 20.0  # for the autopilot and its truth
PACE_LOOK_S = 1.2
PACE_ERROR_MAX = 0.3  # a busy machine reads a burst late
ASK_S = 1.0
TRUTH_LATE_S = 0.5
TRUTH_HZ = 50.0
STANDS_M = 0.03  # no higher above its floor than this it stands
STANDS_MPS = 0.15
LIFTED_M = 0.05  # higher than this it flies, whatever its heartbeat says
FORCE_SHARE = 0.05  # of each new measurement in the smoothed specific force
IDLE_SHARE = 0.12  # of the hovering power, rotors idling on the floor
SYSTEM, COMPONENT = 1, 196  # who asks for the truth; its acknowledgements are not the executive's
DATAGRAM_MAX = 2048
QUIET = "its own simulator's truth (HIL_STATE_QUATERNION, SIM_STATE or SIMSTATE)"

log = logging.getLogger("labr.sim.external")


class Bridge:
    """Looks like the autopilot stand-in to the simulator, and like an autopilot to the executive.

    Args:
        robot: Mass and hovering power.
        remote: Host and port where the executive listens.
        url: Where the autopilot is, as MAVSDK writes it.
        truth_url: Another address on which its simulator publishes the truth; None where it comes with the
            autopilot's own messages.
    """

    def __init__(
        self, robot: RobotConfig, remote: tuple[str, int], url: str, truth_url: str | None = None
    ) -> None:
        self._energy = robot.energy
        self.mass_kg = robot.body.mass_kg
        self._remote = remote
        self._url = url
        self._truth_url = truth_url
        self._clock = SystemClock()
        self._autopilot: Endpoint | None = None
        self._truth_link: Endpoint | None = None
        self._reader = TruthReader()
        self._executive = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._executive.setblocking(False)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._beat: mavlink.MAVLink_message | None = None
        self._asked_s = -math.inf
        self._rest_up_m = 0.0  # of the floor in the autopilot's own world
        self.force_mps2 = GRAVITY_MPS2  # felt by the autopilot, smoothed
        self._rover: tuple[Vector, Vector] | None = None  # specific force and rates of a robot on its wheels
        self._truth_late = False
        self.alignment = Alignment()
        self.body = ExternalBody(self)

    @property
    def armed(self) -> bool:
        """Whether its rotors may turn, by its heartbeat."""
        return self._beat is not None and bool(self._beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    @property
    def truth(self) -> Truth:
        """The newest truth, in the autopilot's own world; only after `open`."""
        if self._reader.latest is None:
            raise LinkError(f"the autopilot on {self._url} has not sent {QUIET}", "Await open() first.")
        return self._reader.latest

    async def open(self) -> None:
        """Wait for the autopilot and its truth.

        Raises:
            LinkError: Naming what does not come.
        """
        self._autopilot = Endpoint(self._url)
        if self._truth_url is not None:
            self._truth_link = Endpoint(self._truth_url)
        deadline_s = self._clock.now_s() + WAIT_S
        while self._beat is None or self._reader.latest is None:
            now_s = self._clock.now_s()
            if now_s > deadline_s:
                raise self._missing()
            self._pump(now_s)
            await self._clock.sleep_until(now_s + 0.01)
        await self._in_real_time()
        self._rest_up_m = self.truth.position_m[2]

    async def _in_real_time(self) -> None:
        """Our wheels and camera run in real time; so must the autopilot, where its truth tells the time."""
        deadline_s = self._clock.now_s() + PACE_LOOK_S
        while self._reader.pace is None and (now_s := self._clock.now_s()) < deadline_s:
            self._pump(now_s)
            await self._clock.sleep_until(now_s + 0.01)
        pace = self._reader.pace
        if pace is not None and abs(pace - 1.0) > PACE_ERROR_MAX:
            raise LinkError(
                f"the autopilot on {self._url} runs at {pace:.1f} times real time",
                "Run its simulator in real time (PX4_SIM_SPEED_FACTOR=1).",
            )

    def _missing(self) -> LinkError:
        if self._beat is None:
            return LinkError(
                f"no autopilot answered on {self._url} within {WAIT_S:.0f} s",
                "Start it first, and check the address and that nothing else listens there.",
            )
        also = f" or on {self._truth_url}" if self._truth_url else ""
        return LinkError(
            f"the autopilot on {self._url} answers, but {QUIET} did not come there{also} "
            f"within {WAIT_S:.0f} s",
            "Name its address with --truth (PX4's SIH: udpin://127.0.0.1:19410), "
            "or fly a simulator that publishes it.",
        )

    def step(self, now_s: float, state: QuadState, _pack: Pack) -> Array | None:
        """Pass on what has arrived; returns duties that mean nothing while the autopilot moves the robot.

        Args:
            now_s: The present.
            state: Where the robot is.

        Returns:
            (4,) zeros from arming to disarming and in the air, None while the rover moves it.
        """
        if state.on_wheels:
            force, rates = state.specific_force_mps2.tolist(), state.angular_velocity_rps.tolist()
            self._rover = (force, rates)
            self.align(state.position_m, yaw_of(state.quaternion), now_s)
        else:
            self._rover = None
        self._pump(now_s)
        self._watch(now_s)
        lifted = self.height_m > LIFTED_M
        if state.on_wheels and not self.armed and not lifted:
            self._rest_up_m = self.truth.position_m[2]
        return np.zeros(4) if self.armed or lifted else None

    def align(self, position_m: Array, yaw_rad: float, now_s: float) -> None:
        """Lay the autopilot's world so that it is where the robot is."""
        x, y, z = position_m.tolist()
        truth = self.truth
        self.alignment = Alignment.of((x, y, z), yaw_rad, truth.at(now_s), truth.yaw_rad)

    @property
    def blind(self) -> bool:
        """Its truth has stopped: what a VIO would see is not known."""
        return self._truth_late

    @property
    def height_m(self) -> float:
        """Of the autopilot above the floor of its own world."""
        return self.truth.position_m[2] - self._rest_up_m

    @property
    def power_w(self) -> float:
        """Of the rotors, by momentum theory from the thrust that is felt: P ~ T^1.5."""
        if not self.armed:
            return 0.0
        hover_w = self._energy.air_w - self._energy.idle_w
        if self.height_m < STANDS_M:
            return IDLE_SHARE * hover_w
        return float(hover_w * (self.force_mps2 / GRAVITY_MPS2) ** 1.5)

    def close(self) -> None:
        """Let go of all addresses; may be called twice."""
        for endpoint in (self._autopilot, self._truth_link):
            if endpoint is not None:
                endpoint.close()
        self._autopilot = self._truth_link = None
        self._executive.close()

    # -- what passes --------------------------------------------------------------------------------

    def _pump(self, now_s: float) -> None:
        autopilot = self._autopilot
        if autopilot is None:
            return
        for message in autopilot.read():
            data = self._taken(autopilot, message, now_s)
            if data is not None:
                self._executive_gets(data)
        if self._truth_link is not None:
            for message in self._truth_link.read():
                self._reader.take(message, now_s)
        for message in self._executive_says():
            changed = to_autopilot(message, self.alignment)
            autopilot.write_bytes(autopilot.packed(message) if changed else bytes(message.get_msgbuf()))
        if now_s - self._asked_s > ASK_S and self._beat is not None and self._silent_s(now_s) > TRUTH_LATE_S:
            self._asked_s = now_s
            self._ask_for_truth(autopilot)

    def _silent_s(self, now_s: float) -> float:
        latest = self._reader.latest
        return math.inf if latest is None else now_s - latest.stamp_s

    def _taken(self, autopilot: Endpoint, message: mavlink.MAVLink_message, now_s: float) -> bytes | None:
        """Look at one message of the autopilot and turn it; None when it is not for the executive.

        What is not changed passes as the very bytes: integers of parameters look like any float.
        """
        name, frame = message.get_type(), bytes(message.get_msgbuf())
        if name in NAMES:
            self._reader.take(message, now_s)
            return None  # nobody in flight sees the truth
        if message.get_srcComponent() != mavlink.MAV_COMP_ID_AUTOPILOT1:
            return frame
        if name == "HEARTBEAT":
            self._beat = message
        elif name == "COMMAND_ACK":
            return None if message.target_component == COMPONENT else frame
        force = specific_force_mps2(message)
        if force is not None:
            self.force_mps2 += FORCE_SHARE * (force - self.force_mps2)
            if self._rover is None:
                return frame
            add_rover(message, *self._rover)
            return autopilot.packed(message)
        return autopilot.packed(message) if to_executive(message, self.alignment) else frame

    def _executive_gets(self, data: bytes) -> None:
        try:
            self._executive.sendto(data, self._remote)
        except (BlockingIOError, ConnectionRefusedError):
            log.debug("the executive does not listen")

    def _executive_says(self) -> list[mavlink.MAVLink_message]:
        out: list[mavlink.MAVLink_message] = []
        for _ in range(BATCH_MAX):
            try:
                data = self._executive.recv(DATAGRAM_MAX)
            except (BlockingIOError, ConnectionRefusedError):
                break
            out.extend(m for m in self._parser.parse_buffer(data) or () if m.get_type() != "BAD_DATA")
        return out

    def _ask_for_truth(self, autopilot: Endpoint) -> None:
        assert self._beat is not None
        ardupilot = self._beat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        wanted = (
            mavlink.MAVLINK_MSG_ID_SIM_STATE if ardupilot else mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION
        )
        system = self._beat.get_srcSystem()
        interval = mavlink.MAVLink_command_long_message(
            system, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, float(wanted), 1e6 / TRUTH_HZ, 0, 0, 0, 0, 0
        )
        autopilot.say(interval, SYSTEM, COMPONENT)

    def _watch(self, now_s: float) -> None:
        late = self._silent_s(now_s) > TRUTH_LATE_S
        if late and not self._truth_late:
            log.error("the autopilot's truth has stopped: no more poses are made of it")
        self._truth_late = late


class ExternalBody:
    """The flying body whose physics are somebody else's; stands where `sim.quad.Quad` does in the plant."""

    def __init__(self, bridge: Bridge) -> None:
        self._bridge = bridge
        self._clock = SystemClock()

    def reset(
        self,
        position_m: Array,
        yaw_rad: float,
        *,
        quaternion: Array | None = None,
        velocity_mps: Array | None = None,
    ) -> None:
        """The rover hands the robot over: from here on the alignment stays as it is."""
        yaw = yaw_rad if quaternion is None else yaw_of(quaternion)
        self._bridge.align(position_m, yaw, self._clock.now_s())

    def set_floor(self, z_m: float) -> None:
        """The autopilot's own world has its own, flat floor."""

    def set_wind(self, wind_mps: Array) -> None:
        """The autopilot's own world has its own air."""

    def set_volts(self, volts: float) -> None:
        """The autopilot's own world has its own battery."""

    def step(self, _motor_commands: Array | Sequence[float]) -> QuadState:
        """Where the autopilot's truth has the robot now."""
        bridge, truth = self._bridge, self._bridge.truth
        a = bridge.alignment
        up_mps = truth.velocity_mps[2]
        stands = bridge.height_m < STANDS_M and abs(up_mps) < STANDS_MPS
        cosine, sine = a.half_turn
        weight_n = bridge.mass_kg * GRAVITY_MPS2
        return QuadState(
            position_m=np.array(a.ours(truth.at(self._clock.now_s()))),
            velocity_mps=np.array(a.ours_vector(truth.velocity_mps)),
            quaternion=quaternion_multiply(np.array([cosine, 0.0, 0.0, sine]), truth.attitude),
            angular_velocity_rps=np.array(truth.rates_rps),
            specific_force_mps2=np.array([0.0, 0.0, bridge.force_mps2]),
            electrical_w=bridge.power_w,
            wheel_load_n=np.full(4, 0.25 * weight_n if stands else 0.0),
        )
