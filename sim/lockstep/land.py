"""The ground channel without a serial line: the land controller's own core, seen through its telemetry."""

from __future__ import annotations

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.parameters import Parameters
from firmware_bridge.pins import Inputs
from labr_autonomy.config import RobotConfig
from labr_autonomy.ground.channel import VALID_MS
from labr_autonomy.ground.state import GroundState
from labr_autonomy.ground.words import fault_words, mode_word
from labr_autonomy.types import WheelOdometry
from sim import land_core as core
from sim.plant import WheelDrive

BOOT_MS = 1000


class LandSeam:
    """The land controller as the flight sees it; telemetry at 50 Hz, a heartbeat at 10 Hz.

    Args:
        config: The robot; its limits become the controller's parameters.
    """

    def __init__(self, config: RobotConfig) -> None:
        self._parameters = Parameters.of(config)
        self._core = core.on_hello(core.State(), 1, wire.PROTOCOL, wire.DIALECT_HASH, BOOT_MS)
        self._inputs = Inputs(0.0, 0.0, True, False, 0, 0)
        self._sequence = 0
        self._may_engage = False
        self._engaged_wish = False
        self._beat_due_s = 0.0

    def step(self, now_s: float, dt_s: float, inputs: Inputs) -> WheelDrive:
        """One physics step; returns what the motors are told."""
        self._inputs = inputs
        now_ms = _ms(now_s)
        if now_s >= self._beat_due_s:
            self._beat_due_s += 0.1
            self._core = core.on_heartbeat(self._core, self._core.session, self._engaged_wish, now_ms)
        self._core = core.tick(self._core, inputs, self._parameters, now_ms, dt_s)
        drive = self._core.drive
        return WheelDrive(drive.left_mps, drive.right_mps, drive.braked)

    def send_velocity(
        self, now_s: float, v_mps: float, w_rps: float, *, engaged: bool, air_lock: bool
    ) -> bool:
        """One command, with `GroundChannel.send_velocity`'s rule on engaging; False when it was not sent."""
        if self._core.last_result == wire.LAND_RESULT_ENGAGE:
            self._may_engage = False
        if engaged and not self._may_engage:
            return False
        self._sequence = (self._sequence + 1) & 0xFFFF
        self._engaged_wish = engaged
        self._may_engage = self._may_engage or not engaged
        command = core.Command(
            session=self._core.session,
            deadline_ms=_ms(now_s) + VALID_MS,
            v_mmps=round(v_mps * 1000.0) if engaged else 0,
            w_mradps=round(w_rps * 1000.0) if engaged else 0,
            sequence=self._sequence,
            engaged=engaged,
            air_lock=air_lock,
        )
        self._core = core.on_velocity(self._core, command, self._parameters, _ms(now_s))
        return True

    def odometry(self, now_s: float) -> WheelOdometry:
        """What the encoders say, rounded as on the wire."""
        i = self._inputs
        return WheelOdometry(now_s, self._speed_mps(), self._yaw_rate_rps(), i.left_ticks, i.right_ticks)

    def _speed_mps(self) -> float:
        return round(500.0 * (self._core.left_mps + self._core.right_mps)) * 1e-3

    def _yaw_rate_rps(self) -> float:
        return round(1000.0 * (self._core.right_mps - self._core.left_mps) / self._parameters.track) * 1e-3

    def state(self, now_s: float) -> GroundState:
        """What the flight knows of it."""
        s = self._core
        return GroundState(
            stamp_s=now_s,
            connected=True,
            engaged=s.engaged,
            mode=mode_word(s.mode),
            faults=fault_words(s.faults, s.last_result),
            wheel_load=s.wheel_load,
            battery_v=self._inputs.battery_v,
            current_a=self._inputs.current_a,
            speed_mps=self._speed_mps(),
            yaw_rate_rps=self._yaw_rate_rps(),
            age_s=0.0,
        )


def _ms(now_s: float) -> int:
    return BOOT_MS + round(now_s * 1000.0)
