"""The air channel: what the executive sees of the autopilot.

Dead-man: every set-point is one MAVLink message sent by one call. When the loop hangs, nothing sends for
it and the autopilot's offboard-loss failsafe acts (MAVSDK's offboard plugin would go on repeating).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from labr_autonomy.air import px4, telemetry
from labr_autonomy.air.clock_offset import ClockOffset
from labr_autonomy.air.commands import Commands
from labr_autonomy.air.effects import EFFECT_S, Effects
from labr_autonomy.air.families import PX4, Family
from labr_autonomy.air.handshake import ANSWERS, Handshake
from labr_autonomy.air.incoming import Incoming
from labr_autonomy.air.link import Link
from labr_autonomy.air.mailbox import Mailbox
from labr_autonomy.air.parameters import compare, refuse, wanted
from labr_autonomy.air.recorder import Recorder
from labr_autonomy.air.report import Report
from labr_autonomy.air.setpoints import setpoint_fields, vision_fields
from labr_autonomy.air.signed_link import SignedLink
from labr_autonomy.air.telemetry import AirState
from labr_autonomy.air.time_sync import TimeSync
from labr_autonomy.air.vehicle import Release, check_release, check_vehicle, release_of
from labr_autonomy.air.watch import Watch, WatchAt
from labr_autonomy.clock import Clock
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import LinkError, Refused
from labr_autonomy.record.tlog import Tlog
from labr_autonomy.types import ImuSample, Odometry, SetPoint

LIFT_S = 8.0  # ArduPilot spins up for 4 s before it leaves the floor (recorded)
SETPOINT_FRESH_S = 0.5  # PX4 wants at least 2 Hz before and during offboard
SLOTS = ("LOCAL_POSITION_NED", "ATTITUDE_QUATERNION", "EXTENDED_SYS_STATE", "BATTERY_STATUS", "CURRENT_MODE")
WAKES = ("HEARTBEAT", "HIGHRES_IMU", "RAW_IMU")
QUEUES = ("COMMAND_ACK", "STATUSTEXT", "EVENT", "TIMESYNC")


class AirChannel:
    """MAVLink to PX4 or ArduPilot on a multicopter.

    Args:
        url: MAVSDK connection URL, e.g. "udpin://127.0.0.1:14540" or "serial:///dev/ttyACM0:921600".
        config: The robot.
        clock: Stamps what arrives; `SetPoint` and `Odometry` stamps are on its scale.
        tlog: Both directions of the link are written here; it stays the caller's to close.
        watch: A ground station that is shown the same; only together with `tlog`.

    Attributes:
        on_imu: Called on the loop with the newest inertial measurement.
        on_say: Called on the loop with each sentence of the autopilot that an operator should read.
        on_round_trip: Called on the loop with each round trip [s] that a `ping` began.
        family: What answers, known after `connect`.
        release: Its firmware, None when it does not say.
    """

    def __init__(
        self,
        url: str,
        config: RobotConfig,
        clock: Clock,
        tlog: Tlog | None = None,
        watch: WatchAt | None = None,
    ) -> None:
        self.on_imu: Callable[[ImuSample], None] | None = None
        self.on_say: Callable[[str], None] | None = None
        self.on_round_trip: Callable[[float], None] | None = None
        self._time_sync = TimeSync()
        self.family: Family = PX4
        self.release: Release | None = None
        self._report = Report()
        self._url = url
        self._config = config
        self._clock = clock
        self._tlog = tlog
        self._watch = watch
        self._start_s = clock.now_s()
        self._setpoint_sent_s: float | None = None
        self._offset = ClockOffset()
        self._link: Link | None = None
        self._mailbox: Mailbox | None = None
        self._recorder: Recorder | None = None
        self._signed: SignedLink | None = None
        self._commands: Commands | None = None
        self._hello: Handshake | None = None
        self._incoming: Incoming | None = None
        self._effects: Effects | None = None

    # -- opening and closing ------------------------------------------------------------------------

    async def connect(self, timeout_s: float) -> None:
        """Find the autopilot, check that it is ours and ask for the messages we read. Nothing is set on it.

        Raises:
            BadInput: The URL cannot be read.
            WrongVehicle: Not a vehicle or firmware that this stack may fly.
            LinkError: Nobody answers within `timeout_s`.
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
            watch = None if self._watch is None else Watch(self._watch)
            self._recorder = Recorder(self._tlog, self._clock, watch)
            self._link.add(self._recorder.url, forward=True)
        url = self._url
        if self._config.links.air_key is not None:
            self._signed = SignedLink(url, self._config.links.air_key)
            url = self._signed.url
        self._link.add(url, forward=self._recorder is not None)
        system = await self._link.first_autopilot(timeout_s)
        if system is None:
            raise LinkError(
                f"no autopilot answered on {self._url} within {timeout_s:.0f} s",
                "Check its power and cable, and that nothing else listens on that address.",
            )
        number = int(system.get_system_id())
        self._commands = Commands(self._link.send, number)
        self._incoming = Incoming(
            self,
            self._link.send,
            self._commands,
            self._recorder,
            self._report,
            self._time_sync,
            self._offset,
            self._clock,
        )
        self._mailbox = Mailbox(
            self._link.attach(system), self._clock, (*SLOTS, *ANSWERS), WAKES, QUEUES, self._wake
        )
        self._effects = Effects(self._commands, self._mailbox, self._report, lambda: self.state, self._clock)
        await self._effects.until(
            lambda: True, self._clock.now_s(), deadline_s, f"{self._url} sent no heartbeat"
        )
        beat = self._mailbox.latest["HEARTBEAT"].fields
        self.family = self._incoming.family = check_vehicle(number, beat, self._url, self._config.name)
        self._hello = hello = Handshake(self._link.send, self._commands, self._mailbox, self._clock)
        await hello.ask_for_streams(self.family.streams)
        answer = await hello.ask_for_message("AUTOPILOT_VERSION", px4.MSG_AUTOPILOT_VERSION)
        self.release = None if answer is None else release_of(answer)
        if self.release is not None:
            check_release(self.family, self.release, self._url)

    async def give_origin(self) -> None:
        """Give an autopilot that wants one the origin of its position, now and after a restart of it.

        For flights only: whoever just looks leaves the autopilot as it is.

        Raises:
            LinkError: It does not confirm, or the link is not open.
        """
        if self._hello is None or self._incoming is None:
            raise LinkError("no origin was set: the air link is not open", "Connect first.")
        if self.family.wants_origin:
            await self._hello.set_origin()
            self._incoming.gives_origin = True

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
        if self._signed is not None:
            self._signed.close()
        self._link = self._mailbox = self._recorder = self._commands = self._signed = None
        self._hello = self._incoming = self._effects = None

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

    def ping(self) -> None:
        """Ask the autopilot for its clock (TIMESYNC); `on_round_trip` hears of the answer.

        Raises:
            LinkError: The link is not open or did not take it.
        """
        self._opened().send("TIMESYNC", self._time_sync.ask(self._clock.now_s()))

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
    def description(self) -> str:
        """What answers, and what it does when set-points stop."""
        version = self.release.text if self.release is not None else "of unknown version"
        return f"{self.family.name} {version}; when set-points stop it {self.family.on_silence}"

    @property
    def forged(self) -> int | None:
        """Frames that came without a good signature; None on a link that is not signed."""
        return None if self._signed is None else self._signed.signer.refused

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
        """Have the autopilot follow our set-points, which must be flowing already (ArduPilot: guided).

        Raises:
            Refused: No set-point left within the last 0.5 s, so the autopilot would fall out again.
            LinkError: As for `arm`.
        """
        sent_s = self._setpoint_sent_s
        age_s = None if sent_s is None else self._clock.now_s() - sent_s
        if age_s is None or age_s > SETPOINT_FRESH_S:
            when = "none was ever sent" if age_s is None else f"the last one left {age_s:.1f} s ago"
            raise Refused(f"offboard was not requested without set-points: {when}", "Stream them first.")
        mode = self.family.follow_mode
        await self._request(
            f"start {mode}", lambda s: s.mode == mode, px4.CMD_DO_SET_MODE, *self.family.follow_request
        )

    async def take_off(self, height_m: float) -> None:
        """Lift off to `height_m` above the floor by the autopilot's own take-off, and see it leave the floor.

        For autopilots that ignore set-points on the floor (ArduPilot). PX4 lifts off by set-points: its
        NAV_TAKEOFF is accepted without a global position and ends in a landing.

        Raises:
            Refused: This autopilot lifts off by set-points.
            LinkError: As for `arm`.
        """
        if not self.family.lifts_by_command:
            raise Refused(f"{self.family.name} lifts off by set-points, not by command", "Stream them.")
        height = (0.0,) * 6 + (height_m,)
        await self._request(
            "take off",
            lambda s: s.landed in ("takeoff", "in_air"),
            px4.CMD_NAV_TAKEOFF,
            *height,
            effect_s=LIFT_S,
        )

    async def land(self) -> None:
        """Have the autopilot land where it is, and see its mode change.

        It overtakes any other request that is still under way. The caller must stop its set-points: PX4
        goes back to offboard by itself only after an offboard loss, not after this.

        Raises:
            LinkError: As for `arm`.
        """
        await self._request("land", lambda s: s.mode == "land" or not s.armed, px4.CMD_NAV_LAND)

    async def read_parameter(self, name: str, whole: bool) -> float | None:
        """One parameter; None when there is none of that name. Takes seconds for a name ArduPilot lacks.

        Args:
            name: As the autopilot calls it.
            whole: It is an integer.

        Raises:
            LinkError: The link is not open.
        """
        return await asyncio.to_thread(self._opened().read_parameter, name, whole=whole)

    async def write_parameter(self, name: str, value: float, whole: bool) -> None:
        """Set one parameter and see it acknowledged.

        Raises:
            Refused: The rotors are armed.
            LinkError: It was not taken.
        """
        if self.state.armed:
            raise Refused(f"{name} was not written: the autopilot is armed", "Disarm it first.")
        await asyncio.to_thread(self._opened().write_parameter, name, value, whole=whole)

    async def check_parameters(self) -> None:
        """Refuse an autopilot whose parameters do not fit this robot.

        Raises:
            Refused: Naming each with what it is and what it should be.
            LinkError: They cannot be read.
        """
        table = [want for want in wanted(self.family, self._config.air) if want.must]
        refuse(await compare(table, self.read_parameter))

    def yield_control(self) -> None:
        """Somebody else flies: what was asked for is not asked for again."""
        if self._commands is not None:
            self._commands.overtake("yield")

    async def _request(
        self,
        name: str,
        reached: Callable[[AirState], bool],
        command: int,
        *params: float,
        effect_s: float = EFFECT_S,
    ) -> None:
        if self._effects is None:
            raise LinkError(f"the request to {name} was not sent: the air link is not open", "Connect first.")
        await self._effects.request(name, reached, command, *params, effect_s=effect_s)

    # -- inside -------------------------------------------------------------------------------------

    def _opened(self) -> Link:
        if self._link is None:
            raise LinkError("nothing was sent: the air link is not open", "Connect first.")
        return self._link

    def _wake(self, arrived: set[str]) -> None:
        """On the loop: messages of these kinds arrived."""
        if self._mailbox is None or self._incoming is None:
            return
        self._incoming.take(self._mailbox, arrived)
        if "HEARTBEAT" in arrived and self._effects is not None:
            self._effects.beat()
