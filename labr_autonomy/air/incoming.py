"""What is done at once with each kind of message that the autopilot sends; on the loop."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Protocol

from labr_autonomy.air import px4, telemetry
from labr_autonomy.air.clock_offset import ClockOffset
from labr_autonomy.air.commands import Commands, command_fields
from labr_autonomy.air.families import PX4, Family
from labr_autonomy.air.mailbox import Mailbox
from labr_autonomy.air.recorder import Recorder
from labr_autonomy.air.report import Report
from labr_autonomy.air.setpoints import Fields, origin_fields
from labr_autonomy.air.time_sync import TimeSync
from labr_autonomy.clock import Clock
from labr_autonomy.errors import LinkError
from labr_autonomy.types import ImuSample

_log = logging.getLogger("labr.air")


class Listeners(Protocol):
    """Who is told; see `AirChannel`."""

    on_imu: Callable[[ImuSample], None] | None
    on_say: Callable[[str], None] | None
    on_round_trip: Callable[[float], None] | None


class Incoming:
    """Empties the mailbox.

    Args:
        listeners: Told of measurements, sentences and round trips.
        send: Sends one message.
        commands: Told of acknowledgements.
        recorder: Writes the acknowledgements that MAVSDK does not pass on, None for none.
        report: Told of the autopilot's words.
        time_sync: Answers and asks for clocks.
        offset: Of the autopilot's clock; outlives the link.
        clock: Time.

    Attributes:
        family: What answers, once it is known.
        gives_origin: After a restart it gets its origin again.
    """

    def __init__(
        self,
        listeners: Listeners,
        send: Callable[[str, Fields], None],
        commands: Commands,
        recorder: Recorder | None,
        report: Report,
        time_sync: TimeSync,
        offset: ClockOffset,
        clock: Clock,
    ) -> None:
        self.family: Family = PX4
        self.gives_origin = False
        self._listeners = listeners
        self._send = send
        self._commands = commands
        self._recorder = recorder
        self._report = report
        self._time_sync = time_sync
        self._offset = offset
        self._clock = clock

    def take(self, mailbox: Mailbox, arrived: set[str]) -> None:
        """Act on the kinds of messages that arrived."""
        while mailbox.queues["TIMESYNC"]:
            self._take_timesync(mailbox.queues["TIMESYNC"].popleft())
        if self.family.imu in arrived:
            self._take_imu(mailbox.latest[self.family.imu])
        for name in ("STATUSTEXT", "EVENT"):
            while mailbox.queues[name]:
                self._take_words(name, mailbox.queues[name].popleft())
        while mailbox.queues["COMMAND_ACK"]:
            ack = mailbox.queues["COMMAND_ACK"].popleft().fields
            if self._recorder is not None:
                self._recorder.write_ack(ack)
            self._commands.take_ack(ack)

    def _take_words(self, name: str, message: telemetry.Message) -> None:
        sentence = self._report.take(name, message)
        if sentence and self._listeners.on_say is not None:
            self._listeners.on_say(sentence)

    def _take_imu(self, message: telemetry.Message) -> None:
        resets = self._offset.resets
        stamp_s = self._offset.local_s(message.fields["time_usec"] * 1e-6, message.arrival_s)
        if self._offset.resets != resets:
            self._ask_again()
        if stamp_s is None or self._listeners.on_imu is None:
            return
        sample = telemetry.imu_sample(message.fields, stamp_s, self.family.imu)
        if sample is not None:
            self._listeners.on_imu(sample)

    def _take_timesync(self, message: telemetry.Message) -> None:
        answer = self._time_sync.answer(message, self._clock.now_s())
        if answer is not None:
            self._try_send("TIMESYNC", answer)
        round_trip_s = self._time_sync.round_trip_s(message)
        if round_trip_s is not None and self._listeners.on_round_trip is not None:
            self._listeners.on_round_trip(round_trip_s)

    def _ask_again(self) -> None:
        """The autopilot has rebooted and sends its default rates."""
        _log.warning("the autopilot's clock started anew: it has rebooted")
        for number, rate_hz in self.family.streams.values():
            params = (float(number), 1e6 / rate_hz)
            self._try_send(
                "COMMAND_LONG", command_fields(px4.CMD_SET_MESSAGE_INTERVAL, params, 0, px4.VEHICLE_SYSTEM)
            )
        if self.gives_origin:
            self._try_send("SET_GPS_GLOBAL_ORIGIN", origin_fields(px4.VEHICLE_SYSTEM))

    def _try_send(self, name: str, fields: Fields) -> None:
        """Send what may be lost."""
        try:
            self._send(name, fields)
        except LinkError as error:
            _log.info("%s", error)
