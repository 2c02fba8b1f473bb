"""The C core in a lock-step flight: `sim.lockstep.land.LandSeam`, but by bytes, and with bare motors."""

from __future__ import annotations

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.host.library import HostController, Library
from firmware_bridge.link import Link
from firmware_bridge.pins import Inputs
from labr_autonomy.ground.channel import VALID_MS
from labr_autonomy.ground.state import GroundState, Telemetry, describe
from labr_autonomy.types import WheelOdometry
from sim.plant import WheelDuty

BOOT_MS = 1000
BEAT_S = 0.1


class FirmwareSeam:
    def __init__(self, config) -> None:
        self.core = HostController(Library())
        self.link = Link()
        self.seen: Telemetry | None = None
        self.session = self.sequence = 0
        self.may_engage = self.engaged_wish = False
        self.beat_due_s = 0.0
        self.say(wire.MAVLink_land_hello_message(1, wire.DIALECT_HASH, wire.PROTOCOL), 0.0)

    def say(self, message, now_s: float) -> None:
        self.core.receive(self.link.encode(message), self.ms(now_s))

    def ms(self, now_s: float) -> int:
        return BOOT_MS + round(now_s * 1000.0)

    def step(self, now_s: float, dt_s: float, inputs: Inputs) -> WheelDuty:
        if now_s >= self.beat_due_s:
            self.beat_due_s += BEAT_S
            self.say(wire.MAVLink_land_heartbeat_message(self.session, 0, 0, int(self.engaged_wish)), now_s)
        duty = self.core.step(inputs, self.ms(now_s))
        for received in self.link.feed(self.core.take(), now_s):
            m = received.message
            if m.get_type() == "LAND_IDENTITY":
                self.session = m.session
            elif m.get_type() == "LAND_STATE":
                self.seen = Telemetry(now_s, now_s, m)
                if m.last_result == wire.LAND_RESULT_ENGAGE:
                    self.may_engage = False
        return WheelDuty(*duty)

    def send_velocity(
        self, now_s: float, v_mps: float, w_rps: float, *, engaged: bool, air_lock: bool
    ) -> bool:
        if engaged and not self.may_engage:
            return False
        self.sequence = (self.sequence + 1) & 0xFFFF
        self.engaged_wish = engaged
        self.may_engage = self.may_engage or not engaged
        flags = wire.LAND_FLAG_ENGAGED * engaged | wire.LAND_FLAG_AIR_LOCK * air_lock
        v, w = (round(1000.0 * x) if engaged else 0 for x in (v_mps, w_rps))
        deadline = self.ms(now_s) + VALID_MS
        self.say(
            wire.MAVLink_land_velocity_message(self.session, deadline, v, w, self.sequence, flags), now_s
        )
        return True

    def odometry(self, now_s: float) -> WheelOdometry:
        m = self.seen.message
        return WheelOdometry(self.seen.stamp_s, m.v * 1e-3, m.w * 1e-3, m.ticks_left, m.ticks_right)

    def state(self, now_s: float) -> GroundState:
        return describe(self.seen, True, "", now_s)
