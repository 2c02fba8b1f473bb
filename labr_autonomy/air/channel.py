"""The air channel: what the executive sees of the autopilot.

Dead-man: every set-point is one MAVLink message sent by one call. When the loop hangs, nothing sends for
it and the autopilot's offboard-loss failsafe acts (MAVSDK's offboard plugin would go on repeating).
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from labr_autonomy.air import px4, telemetry
from labr_autonomy.air.clock_offset import ClockOffset
from labr_autonomy.air.commands import Commands, command_fields
from labr_autonomy.air.link import Link
from labr_autonomy.air.mailbox import Mailbox
from labr_autonomy.air.recorder import Recorder
from labr_autonomy.air.setpoints import Fields, setpoint_fields, vision_fields
from labr_autonomy.air.telemetry import AirState
from labr_autonomy.air.vehicle import check_vehicle
from labr_autonomy.clock import Clock
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import LinkError, Refused
from labr_autonomy.record.tlog import Tlog
from labr_autonomy.types import ImuSample, Odometry, SetPoint

_log = logging.getLogger("labr.air")

EFFECT_S = 2.0  # an acknowledged request must show in the state within this; heartbeats come at 1 Hz
SETPOINT_FRESH_S = 0.5  # PX4 wants at least 2 Hz before and during offboard
TEXT_S = 3.0  # a STATUSTEXT this young belongs to the refusal
SLOTS = ("LOCAL_POSITION_NED", "ATTITUDE_QUATERNION", "EXTENDED_SYS_STATE", "BATTERY_STATUS", "STATUSTEXT")
WAKES = ("HEARTBEAT", "COMMAND_ACK", "HIGHRES_IMU", "TIMESYNC")
WARNING = 4  # MAV_SEVERITY_WARNING


class AirChannel:
    """MAVLink to PX4 on a multicopter.

    Args:
        url: MAVSDK connection URL, e.g. "udpin://127.0.0.1:14540" or "serial:///dev/ttyACM0:921600".
        config: The robot.
        clock: Stamps what arrives; `SetPoint` and `Odometry` stamps are on its scale.
        tlog: Both directions of the link are written here; it stays the caller's to close.

    Attributes:
        on_imu: Called on the loop with the newest inertial measurement.
    """

    def __init__(self, url: str, config: RobotConfig, clock: Clock, tlog: Tlog | None = None) -> None:
        self.on_imu: Callable[[ImuSample], None] | None = None
        self._url = url
        self._config = config
        self._clock = clock
        self._tlog = tlog
        self._start_s = clock.now_s()
        self._setpoint_sent_s: float | None = None
        self._offset = ClockOffset()
        self._beat = asyncio.Event()
        self._link: Link | None = None
        self._mailbox: Mailbox | None = None
        self._recorder: Recorder | None = None
        self._commands: Commands | None = None

    # -- opening and closing ------------------------------------------------------------------------

    async def connect(self, timeout_s: float) -> None:
        """Find the autopilot, check that it is ours and ask for the messages we read.

        Raises:
            BadInput: The URL cannot be read.
            LinkError: Nobody answers within `timeout_s`, or not the vehicle this stack may fly.
        """
        if self._link is not None:
            raise LinkError("the air channel is open already", "Close it first.")
        try:
            await self._open(self._clock.now_s() + timeout_s, timeout_s)
        except BaseException:
            await self.close()
            raise

    async def _open(self, deadline_s: float, timeout_s: float) -> None:
        self._link = Link()
        if self._tlog is not None:
            self._recorder = Recorder(self._tlog, self._clock)
            self._link.add(self._recorder.url, forward=True)
        self._link.add(self._url, forward=self._recorder is not None)
        system = await self._link.first_autopilot(timeout_s)
        if system is None:
            raise LinkError(
                f"no autopilot answered on {self._url} within {timeout_s:.0f} s",
                "Check its power and cable, and that nothing else listens on that address.",
            )
        number = int(system.get_system_id())
        self._commands = Commands(self._link.send, number)
        self._mailbox = Mailbox(self._link.attach(system), self._clock, SLOTS, WAKES, self._wake)
        await self._until(lambda: True, self._clock.now_s(), deadline_s, f"{self._url} sent no heartbeat")
        check_vehicle(
            number,
            telemetry.heartbeat(self._mailbox.latest["HEARTBEAT"].fields),
            self._url,
            self._config.name,
        )
        await self._ask_for_streams(self._commands)

    async def close(self) -> None:
        """End all subscriptions, sockets and threads of this channel; can be called again."""
        if self._commands is not None:
            self._commands.overtake("close the link")
        if self._mailbox is not None:
            self._mailbox.close()
        if self._link is not None:
            self._link.close()
        if self._recorder is not None:
            self._recorder.close()
        self._link = self._mailbox = self._recorder = self._commands = None

    # -- every tick ---------------------------------------------------------------------------------

    def send_setpoint(self, setpoint: SetPoint) -> None:
        """Send one set-point, once.

        Raises:
            Refused: A value is not finite.
            LinkError: The link is not open or did not take it.
        """
        fields = setpoint_fields(setpoint, self._start_s, px4.VEHICLE_SYSTEM, px4.AUTOPILOT_COMPONENT)
        self._opened().send("SET_POSITION_TARGET_LOCAL_NED", fields)
        self._setpoint_sent_s = self._clock.now_s()

    def send_vision(self, odometry: Odometry) -> None:
        """Send one pose for the autopilot's own estimator, once.

        Raises:
            Refused: A value is not finite.
            LinkError: The link is not open or did not take it.
        """
        self._opened().send("ODOMETRY", vision_fields(odometry))

    @property
    def state(self) -> AirState:
        """What is known now; reading costs about 50 us.

        Raises:
            LinkError: Not connected yet.
        """
        if self._mailbox is None:
            raise LinkError("the air link is not open", "Connect first.")
        return telemetry.air_state(self._mailbox.latest, self._mailbox.heard_s, self._clock.now_s())

    @property
    def reboots(self) -> int:
        """How often the autopilot's clock started anew since `connect`."""
        return self._offset.resets

    # -- requests -----------------------------------------------------------------------------------

    async def arm(self) -> None:
        """Start the rotors and see it in the state.

        Cancelled, it sends nothing more; a request that has left may still take effect.

        Raises:
            LinkError: Refused with the autopilot's reason, not acknowledged, or without effect within 2 s.
        """
        await self._request("arm", lambda s: s.armed, px4.CMD_ARM_DISARM, 1.0)

    async def disarm(self) -> None:
        """Stop the rotors and see it in the state. Never forced: PX4 refuses it in the air.

        Raises:
            LinkError: As for `arm`.
        """
        await self._request("disarm", lambda s: not s.armed, px4.CMD_ARM_DISARM, 0.0)

    async def start_offboard(self) -> None:
        """Hand the autopilot over to our set-points, which must be flowing already.

        Raises:
            Refused: No set-point left within the last 0.5 s, so the autopilot would fall out again.
            LinkError: As for `arm`.
        """
        sent_s = self._setpoint_sent_s
        age_s = None if sent_s is None else self._clock.now_s() - sent_s
        if age_s is None or age_s > SETPOINT_FRESH_S:
            when = "none was ever sent" if age_s is None else f"the last one left {age_s:.1f} s ago"
            raise Refused(f"offboard was not requested without set-points: {when}", "Stream them first.")
        flags, main = float(px4.CUSTOM_MODE_FLAG), float(px4.MAIN_OFFBOARD)
        await self._request(
            "start offboard", lambda s: s.mode == "offboard", px4.CMD_DO_SET_MODE, flags, main
        )

    async def land(self) -> None:
        """Have the autopilot land where it is, and see its mode change.

        It overtakes any other request that is still under way. The caller must stop its set-points: PX4
        goes back to offboard by itself only after an offboard loss, not after this.

        Raises:
            LinkError: As for `arm`.
        """
        await self._request("land", lambda s: s.mode == "land" or not s.armed, px4.CMD_NAV_LAND)

    async def _request(
        self, name: str, reached: Callable[[AirState], bool], command: int, *params: float
    ) -> None:
        if self._commands is None:
            raise LinkError(f"the request to {name} was not sent: the air link is not open", "Connect first.")
        asked_s = self._clock.now_s()
        result = await self._commands.run(name, command, *params)
        if result != px4.ACCEPTED:
            said = self._last_text(asked_s)
            reason = f'; it says "{said}"' if said else ""
            raise LinkError(f"the autopilot refused to {name}: {px4.result_name(result)}{reason}")
        limit_s = self._clock.now_s() + EFFECT_S
        await self._until(
            lambda: reached(self.state),
            asked_s,
            limit_s,
            f"the autopilot accepted the request to {name}, but {EFFECT_S:.0f} s later there is no effect",
        )

    # -- inside -------------------------------------------------------------------------------------

    def _opened(self) -> Link:
        if self._link is None:
            raise LinkError("nothing was sent: the air link is not open", "Connect first.")
        return self._link

    async def _until(
        self, reached: Callable[[], bool], since_s: float, deadline_s: float, else_say: str
    ) -> None:
        """Wait for a heartbeat younger than `since_s` with which `reached` holds."""
        while True:
            beat = self._mailbox.latest.get("HEARTBEAT") if self._mailbox else None
            if beat is not None and beat.arrival_s > since_s and reached():
                return
            self._beat.clear()
            left_s = deadline_s - self._clock.now_s()
            try:
                async with asyncio.timeout(max(0.0, left_s)):
                    await self._beat.wait()
            except TimeoutError:
                mode = f" (mode {self.state.mode})" if beat is not None else ""
                raise LinkError(f"{else_say}{mode}", "Check the autopilot and its link.") from None

    async def _ask_for_streams(self, commands: Commands) -> None:
        answered = 0
        for name, (number, rate_hz) in px4.STREAMS.items():
            try:
                result = await commands.run(
                    f"send {name}", px4.CMD_SET_MESSAGE_INTERVAL, float(number), 1e6 / rate_hz
                )
            except LinkError as error:
                _log.warning("%s", error)
                if answered == 0:
                    raise
                continue
            answered += 1
            if result != px4.ACCEPTED:
                _log.warning("the autopilot refused to send %s: %s", name, px4.result_name(result))

    def _last_text(self, since_s: float) -> str:
        text = self._mailbox.latest.get("STATUSTEXT") if self._mailbox else None
        if text is None or text.arrival_s < since_s - TEXT_S or int(text.fields["severity"]) > WARNING:
            return ""
        return str(text.fields["text"])

    def _wake(self, arrived: set[str]) -> None:
        """On the loop: act on the kinds of messages that arrived."""
        mailbox = self._mailbox
        if mailbox is None:
            return
        if "TIMESYNC" in arrived:
            self._answer_timesync(mailbox.latest["TIMESYNC"])
        if "HIGHRES_IMU" in arrived:
            self._take_imu(mailbox.latest["HIGHRES_IMU"])
        while mailbox.acks:
            ack = mailbox.acks.popleft().fields
            if self._recorder is not None:
                self._recorder.write_ack(ack)
            if self._commands is not None:
                self._commands.take_ack(ack)
        if "HEARTBEAT" in arrived:
            self._beat.set()

    def _take_imu(self, message: telemetry.Message) -> None:
        resets = self._offset.resets
        stamp_s = self._offset.local_s(message.fields["time_usec"] * 1e-6, message.arrival_s)
        if self._offset.resets != resets:
            self._ask_again()
        if stamp_s is None or self.on_imu is None:
            return
        sample = telemetry.imu_sample(message.fields, stamp_s)
        if sample is not None:
            self.on_imu(sample)

    def _answer_timesync(self, message: telemetry.Message) -> None:
        """Tell the autopilot our monotonic clock, by which it then reads the stamps of `send_vision`.

        MAVSDK could answer too, but with the wall clock, which may jump in flight.
        """
        if message.fields["tc1"] != 0:
            return  # an answer, not a question
        middle_s = 0.5 * (
            message.arrival_s + self._clock.now_s()
        )  # the hand-over must not look like an offset
        self._try_send("TIMESYNC", {"tc1": int(middle_s * 1e9), "ts1": message.fields["ts1"]})

    def _ask_again(self) -> None:
        """The autopilot has rebooted and sends its default rates."""
        _log.warning("the autopilot's clock started anew: it has rebooted")
        for number, rate_hz in px4.STREAMS.values():
            params = (float(number), 1e6 / rate_hz)
            self._try_send(
                "COMMAND_LONG", command_fields(px4.CMD_SET_MESSAGE_INTERVAL, params, 0, px4.VEHICLE_SYSTEM)
            )

    def _try_send(self, name: str, fields: Fields) -> None:
        """Send what may be lost."""
        try:
            self._opened().send(name, fields)
        except LinkError as error:
            _log.info("%s", error)
