"""The ground channel: handshake, velocity commands, telemetry, odometry, emergency stop.

Dead-man: no task in here repeats a velocity command. Each call of `send_velocity` makes one frame with a
deadline 200 ms ahead on the controller's clock; when the calls stop, the wheels stop.

Engaging is deliberate: after `open` and after every reconnection, one call with `engaged=False` must come
before calls with `engaged=True` have any effect. The same holds after an emergency stop, a stalled wheel or
a second of silence; `may_engage` tells.
"""

from __future__ import annotations

import math
import secrets
from collections.abc import Callable

from firmware_bridge.dialect import labr_land as dialect
from firmware_bridge.link import Counters, Message, text_of
from labr_autonomy.clock import Clock, Ticker
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import LinkError
from labr_autonomy.ground.clock_map import ClockMap
from labr_autonomy.ground.handshake import Identity, refusal
from labr_autonomy.ground.requests import Requests
from labr_autonomy.ground.state import GroundState, Telemetry, describe
from labr_autonomy.ground.wire import FrameLog, Wire
from labr_autonomy.types import WheelOdometry

VALID_MS = 200  # life of a velocity command; the controller's own watchdog is as long
HEARTBEAT_PERIOD_S = 0.1
HELLO_PERIOD_S = 0.1
POLL_S = 0.01
SILENT_S = 1.0  # then the device is given up and opened again
RETRY_MIN_S, RETRY_MAX_S = 0.1, 1.0
INT16 = 32767


class GroundChannel:
    """Computer's end of the link to the land controller.

    Args:
        device: Serial device of the controller.
        baud: Symbol rate [1/s].
        config: The robot.
        clock: Our monotonic clock.
        tlog: Where the frames of both directions are kept, None for nowhere.
    """

    def __init__(
        self, device: str, baud: int, config: RobotConfig, clock: Clock, tlog: FrameLog | None = None
    ) -> None:
        self.config = config
        self.on_odometry: Callable[[WheelOdometry], None] | None = None
        self.on_log: Callable[[str], None] | None = None  # a sentence of the controller
        self.on_round_trip: Callable[[float], None] | None = None  # [s] of each time synchronisation
        self._device = device
        self._clock = clock
        self._wire = Wire(device, baud, clock, tlog, self._on_message, self._on_lost)
        self._map = ClockMap()
        self._requests = Requests(self._wire.send, clock, self._session, self._mode)
        self._identity: Identity | None = None
        self._first_serial: str | None = None
        self._nonce = 0
        self._ready = False  # handshake done on the port that is open now
        self._telemetry: Telemetry | None = None
        self._reason = "the link was not opened"
        self._may_engage = False
        self._engaged_wish = False
        self._air_lock = False
        self._sent_s = -math.inf
        self._retry_s = 0.0
        self._back_off_s = RETRY_MIN_S
        self.round_trip_s: float | None = None  # of the last time synchronisation
        self.reconnections = 0

    # -- life ------------------------------------------------------------------------------------------

    async def open(self, timeout_s: float = 3.0) -> Identity:
        """Take the device and shake hands; returns who answered.

        Raises:
            LinkError: Absent, busy, silent, or of another protocol; the sentence says what to do.
        """
        return await self._connect(timeout_s)

    async def run(self) -> None:
        """Heartbeats and reconnection, until cancelled."""
        ticker = Ticker(self._clock, HEARTBEAT_PERIOD_S)
        beats = 0
        while True:
            await ticker.wait()
            now_s = self._clock.now_s()
            if not self._wire.is_open:
                await self._try_again(now_s)
            elif self._telemetry is None or now_s - self._telemetry.received_s > SILENT_S:
                self._give_up(f"no telemetry for {SILENT_S:.1f} s")
            else:
                self._beat(now_s)
                if beats % 10 == 0:
                    self.ping()
                beats += 1

    async def close(self) -> None:
        """Stop the wheels and give the device back."""
        self.stop()
        self._wire.close()
        self._ready = False
        self._reason = "the link was closed"

    # -- commands --------------------------------------------------------------------------------------

    def send_velocity(self, v_mps: float, w_rps: float, *, engaged: bool, air_lock: bool) -> bool:
        """Send one command; it drives for at most 200 ms.

        Args:
            v_mps: Forward speed, body [m/s].
            w_rps: Yaw rate, positive to the left [rad/s].
            engaged: The executive means to drive.
            air_lock: The robot flies or is about to: the wheels stay braked.

        Returns:
            False if nothing was sent: no link, not finite, or engaged before a disengaged command.
        """
        if not (math.isfinite(v_mps) and math.isfinite(w_rps)):
            return False
        v_mmps, w_mradps = round(v_mps * 1000.0), round(w_rps * 1000.0)
        if max(abs(v_mmps), abs(w_mradps)) > INT16:
            return False
        self._air_lock = air_lock
        if not self._ready or self._identity is None:
            return False
        if engaged and not self._may_engage:
            return False
        now_s = self._clock.now_s()
        flags = dialect.LAND_FLAG_ENGAGED * engaged | dialect.LAND_FLAG_AIR_LOCK * air_lock
        sent = self._wire.send(
            dialect.MAVLink_land_velocity_message(
                session=self._identity.session,
                deadline_ms=(self._map.controller_ms(now_s) + VALID_MS) % (1 << 32),
                v=v_mmps if engaged else 0,
                w=w_mradps if engaged else 0,
                cmd_seq=self._requests.next_sequence(),
                flags=flags,
            )
        )
        if sent:
            self._sent_s = now_s
            self._engaged_wish = engaged
            self._may_engage = self._may_engage or not engaged
        return sent

    def stop(self) -> bool:
        """Disengage: the wheels brake at once and the air lock stays as it was."""
        return self.send_velocity(0.0, 0.0, engaged=False, air_lock=self._air_lock)

    def ping(self) -> bool:
        """Ask for a time synchronisation; `on_round_trip` is told how long it took. False if not sent."""
        now_us = int(self._clock.now_s() * 1e6)
        return self._wire.send(dialect.MAVLink_land_timesync_message(now_us, 0))

    async def estop(self) -> None:
        """Latch the emergency stop and see it latched.

        Raises:
            LinkError: The controller did not confirm within 1 s.
        """
        self._engaged_wish = self._may_engage = False
        await self._requests.estop()

    async def request_release(self) -> int:
        """First step out of the emergency stop: ask for the token that the second step returns.

        Raises:
            LinkError: No answer.
            Refused: There is no emergency stop to end.
        """
        return await self._requests.request_release()

    async def confirm_release(self, token: int) -> None:
        """Second step, within 5 s of the first. The controller is idle afterwards, not engaged.

        Raises:
            LinkError: The controller stayed in the emergency stop.
        """
        self._may_engage = False
        await self._requests.confirm_release(token)

    async def release_estop(self) -> None:
        """Both steps; for callers that have asked the operator twice themselves."""
        await self.confirm_release(await self.request_release())

    async def read_parameters(self) -> dict[str, float]:
        """All parameters of the controller by name, SI units.

        Raises:
            LinkError: No answer.
        """
        return await self._requests.read_parameters()

    async def write_parameter(self, name: str, value: float) -> None:
        """Set one parameter; only while not engaged.

        Raises:
            LinkError: No answer.
            Refused: Unknown name, value outside its limits, or the controller is engaged.
        """
        await self._requests.write_parameter(name, value)

    # -- what is known ---------------------------------------------------------------------------------

    @property
    def state(self) -> GroundState:
        """The newest state, aged to now."""
        return describe(self._telemetry, self._ready, self._reason, self._clock.now_s())

    @property
    def telemetry(self) -> Telemetry | None:
        """The newest telemetry with all its fields; None before the first."""
        return self._telemetry

    @property
    def may_engage(self) -> bool:
        """False while a disengaged command must come before the wheels can be engaged (again)."""
        return self._ready and self._may_engage

    @property
    def identity(self) -> Identity | None:
        """Who answered last."""
        return self._identity

    @property
    def counters(self) -> Counters:
        """What the link has seen."""
        return self._wire.counters

    # -- connection ------------------------------------------------------------------------------------

    async def _connect(self, timeout_s: float) -> Identity:
        begun_s = self._clock.now_s()
        self._ready = self._may_engage = self._engaged_wish = False
        self._identity = self._telemetry = None
        self._map.reset()
        self._nonce = secrets.randbits(32)
        before = self._wire.received_bytes, self._wire.counters.good
        self._wire.open()
        try:
            identity = await self._shake_hands(begun_s + timeout_s)
        except LinkError as error:
            self._reason = error.what
            raise
        finally:
            if not self._ready:
                self._wire.close()
        if identity is not None:
            self._first_serial = identity.serial
            return identity
        came = self._wire.received_bytes - before[0], self._wire.counters.good - before[1]
        self._reason = f"The land controller at {self._device} did not answer within {timeout_s:.1f} s"
        raise LinkError(*self._silence(*came))

    async def _shake_hands(self, deadline_s: float) -> Identity | None:
        """Repeat the hello until identity and telemetry have come; None at the deadline."""
        due_s = -math.inf
        while (now_s := self._clock.now_s()) < deadline_s and self._wire.is_open:
            if self._identity is not None:
                wrong = refusal(self._identity, self._first_serial)
                if wrong is not None:
                    raise wrong
                if self._telemetry is not None:
                    self._ready = True
                    self._back_off_s = RETRY_MIN_S
                    return self._identity
            elif now_s >= due_s:
                due_s = now_s + HELLO_PERIOD_S
                self._wire.send(
                    dialect.MAVLink_land_hello_message(self._nonce, dialect.DIALECT_HASH, dialect.PROTOCOL)
                )
            await self._clock.sleep_until(now_s + POLL_S)
        return None

    def _silence(self, received_bytes: int, good: int) -> tuple[str, str]:
        if received_bytes == 0:
            return self._reason, "Check its power and cable, and that links.ground names the right device."
        if good == 0:
            return (
                f"{self._reason}; {received_bytes} bytes came, none of them a frame of this dialect",
                "Check links.ground_baud, and that links.ground names the land controller.",
            )
        return (
            f"{self._reason}, though it sent {good} frames",
            "Check the cable's other direction, or reset it.",
        )

    async def _try_again(self, now_s: float) -> None:
        if now_s < self._retry_s:
            return
        try:
            await self._connect(SILENT_S)
            self.reconnections += 1
        except LinkError as error:
            self._reason = error.what
            self._retry_s = self._clock.now_s() + self._back_off_s
            self._back_off_s = min(RETRY_MAX_S, 2.0 * self._back_off_s)

    def _give_up(self, reason: str) -> None:
        self._wire.close()
        self._on_lost(reason)

    def _on_lost(self, reason: str) -> None:
        """The device is gone, or the one behind it forgot us: nothing is engaged any more."""
        self._ready = self._may_engage = self._engaged_wish = False
        self._reason = reason
        self._retry_s = self._clock.now_s() + self._back_off_s

    def _beat(self, now_s: float) -> None:
        # Twice a command's life: the controller's own watchdog is to bite first and say so.
        fresh = now_s - self._sent_s <= 2e-3 * VALID_MS
        self._wire.send(
            dialect.MAVLink_land_heartbeat_message(
                self._session(), int(now_s * 1000.0) % (1 << 32), 0, int(self._engaged_wish and fresh)
            )
        )

    def _session(self) -> int:
        return self._identity.session if self._identity is not None else 0

    def _mode(self) -> int | None:
        return self._telemetry.message.mode if self._telemetry is not None else None

    # -- what comes in ---------------------------------------------------------------------------------

    def _on_message(self, message: Message, received_s: float) -> None:
        if isinstance(message, dialect.MAVLink_land_state_message):
            self._on_state(message, received_s)
        elif isinstance(message, dialect.MAVLink_land_identity_message):
            if message.nonce == self._nonce:
                self._on_identity(message)
        elif isinstance(message, dialect.MAVLink_land_heartbeat_message):
            if self._ready and message.session != self._session():
                self._give_up("the land controller has restarted")
        elif isinstance(message, dialect.MAVLink_land_ack_message):
            self._requests.on_ack(message)
        elif isinstance(message, dialect.MAVLink_land_param_message):
            self._requests.on_param(message)
        elif isinstance(message, dialect.MAVLink_land_timesync_message):
            self.round_trip_s = max(0.0, received_s - message.computer_us * 1e-6)
            if self.on_round_trip is not None:
                self.on_round_trip(self.round_trip_s)
        elif isinstance(message, dialect.MAVLink_land_log_message) and self.on_log is not None:
            self.on_log(text_of(message.text))

    def _on_identity(self, message: dialect.MAVLink_land_identity_message) -> None:
        if not self._ready:
            self._identity = Identity.of(message)
            self._telemetry = None  # what came before may have waited in a buffer for long
            self._map.reset()

    def _on_state(self, message: dialect.MAVLink_land_state_message, received_s: float) -> None:
        restarts = self._map.restarts
        stamp_s = self._map.add(message.time_ms, received_s)
        self._telemetry = Telemetry(stamp_s, received_s, message)
        if self._map.restarts != restarts and self._ready:
            self._give_up("the land controller has restarted")
            return
        if message.last_result == dialect.LAND_RESULT_ENGAGE:
            self._may_engage = False  # after a latched fault or a lost heartbeat the controller asks again
        if self._ready and self.on_odometry is not None:
            self.on_odometry(
                WheelOdometry(
                    stamp_s=stamp_s,
                    speed_mps=message.v * 1e-3,
                    yaw_rate_rps=message.w * 1e-3,
                    left_ticks=message.ticks_left,
                    right_ticks=message.ticks_right,
                )
            )
