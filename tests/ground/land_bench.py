"""A computer's side written by hand, a land controller of any tier, and two wheels on bare motors."""

from __future__ import annotations

from collections.abc import Callable

from land_tiers import CONFIG

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.link import Link
from firmware_bridge.parameters import Parameters
from firmware_bridge.pins import Duty, Inputs
from labr_autonomy.ground.clock_map import ClockMap
from sim import motor
from sim.rover import Rover

PARAMETERS = Parameters.of(CONFIG)
VOLTS = 18.5
COMMAND_S = 0.02
BEAT_S = 0.1


class Bench:
    def __init__(self, tier) -> None:
        self.tier = tier
        self.rover = Rover(CONFIG, 3)
        self.link = Link()
        self.map = ClockMap()
        self.got = []
        self.session = 0
        self.sequence = 0
        self.duty = Duty()
        self.moved_s = -1.0  # when a wheel was last not braked
        # what may be wrong with the robot
        self.pins = {}  # overrides of Inputs
        self.blocked = False
        self.encoder_gain = 1.0
        self.nonce = 1
        self.beat_s = 0.0

    # -- time ------------------------------------------------------------------------------------------

    def step(self) -> None:
        dt = self.tier.advance()
        d = self.duty
        if self.blocked:
            amps = (
                (0.0, 0.0) if d.braked else tuple(motor.current_a(x, VOLTS, 0.0) for x in (d.left, d.right))
            )
        else:
            s = self.rover.step(dt, d.left, d.right, braked=d.braked, volts=VOLTS)
            amps = (s.left_a, s.right_a)
        s = self.rover.state
        values = {
            "battery_v": VOLTS,
            "current_a": s.watts / VOLTS,
            "wheel_load": True,
            "rotors_possible": False,
            "left_ticks": int(self.encoder_gain * s.left_ticks),
            "right_ticks": int(self.encoder_gain * s.right_ticks),
            "left_a": amps[0],
            "right_a": amps[1],
        }
        self.duty = self.tier.step(Inputs(**(values | self.pins)))
        if not self.duty.braked:
            self.moved_s = self.tier.now_s()
        for received in self.link.feed(self.tier.read(), self.tier.now_s()):
            m = received.message
            self.got.append(m)
            if m.get_type() == "LAND_STATE":
                self.map.add(m.time_ms, self.tier.now_s())
            elif m.get_type() == "LAND_IDENTITY":
                self.session = m.session

    def run(self, duration_s: float) -> None:
        until_s = self.tier.now_s() + duration_s
        while self.tier.now_s() < until_s:
            self.step()

    def until(self, condition: Callable[[], object], what: str, timeout_s: float = 3.0):
        """Step until a condition holds; its value."""
        until_s = self.tier.now_s() + timeout_s
        while not (value := condition()):
            assert self.tier.now_s() < until_s, f"{what}: not within {timeout_s} s"
            self.step()
        return value

    # -- what was heard --------------------------------------------------------------------------------

    def of(self, name: str) -> list:
        return [m for m in self.got if m.get_type() == name]

    @property
    def state(self):
        return self.of("LAND_STATE")[-1]

    def next(self, name: str, timeout_s: float = 3.0):
        """The next message of this kind."""
        seen = len(self.of(name))
        self.until(lambda: len(self.of(name)) > seen, name, timeout_s)
        return self.of(name)[seen]

    # -- what is said ----------------------------------------------------------------------------------

    def say(self, message) -> None:
        self.tier.write(self.link.encode(message))

    def hello(self, nonce: int = 1, dialect: int = wire.DIALECT_HASH, protocol: int = wire.PROTOCOL):
        """Say hello until somebody answers, as early bytes may be lost."""
        seen = len(self.of("LAND_IDENTITY"))
        for _ in range(30):
            self.say(wire.MAVLink_land_hello_message(nonce, dialect, protocol))
            self.run(0.1)
            if len(self.of("LAND_IDENTITY")) > seen:
                self.until(lambda: self.map.known, "telemetry")
                return self.of("LAND_IDENTITY")[-1]
        raise AssertionError("no identity")

    def beat(self, engaged: bool = True, session: int | None = None) -> None:
        self.beat_s = self.tier.now_s()
        session = self.session if session is None else session
        self.say(wire.MAVLink_land_heartbeat_message(session, 0, 0, int(engaged)))

    def velocity(
        self, v: float = 0.0, w: float = 0.0, *, engaged: bool = True, air_lock: bool = False, **changes
    ):
        """A velocity command with a fresh sequence and a deadline 200 ms ahead."""
        self.sequence = (self.sequence + 1) & 0xFFFF
        fields = {
            "session": self.session,
            "deadline_ms": (self.map.controller_ms(self.tier.now_s()) + 200) % 2**32,
            "v": round(1000 * v),
            "w": round(1000 * w),
            "cmd_seq": self.sequence,
            "flags": wire.LAND_FLAG_ENGAGED * engaged | wire.LAND_FLAG_AIR_LOCK * air_lock,
        }
        return wire.MAVLink_land_velocity_message(**(fields | changes))

    def command(self, v: float = 0.0, w: float = 0.0, **options) -> None:
        """One velocity command, and a heartbeat if one is due."""
        if self.tier.now_s() - self.beat_s > BEAT_S:
            self.beat(options.get("engaged", True))
        self.say(self.velocity(v, w, **options))

    def drive(self, v: float, w: float, duration_s: float, **options) -> None:
        """The same command at 50 Hz."""
        until_s = self.tier.now_s() + duration_s
        while self.tier.now_s() < until_s:
            self.command(v, w, **options)
            self.run(COMMAND_S)

    def engage(self) -> None:
        """Hello, and the disengaged command that must come first."""
        self.hello(self.nonce)
        self.say(self.velocity(engaged=False))
        self.beat()
        self.until(lambda: self.state.cmd_seq == self.sequence, "the neutral command")

    def drive_until(
        self, condition, what: str, v: float = 0.4, w: float = 0.0, timeout_s: float = 5.0, **options
    ):
        """Say the same command at 50 Hz until a condition holds."""
        until_s = self.tier.now_s() + timeout_s
        while not condition():
            assert self.tier.now_s() < until_s, f"{what}: not within {timeout_s} s"
            self.drive(v, w, COMMAND_S, **options)

    def moving(self, v: float = 0.4, w: float = 0.0) -> None:
        """Engaged and at speed, however long a busy machine needs for it."""
        self.engage()
        self.drive_until(lambda: not self.duty.braked and self.rover.state.v_mps > 0.8 * v, "speed", v, w)

    def ask(self, message, of: int):
        """Send a request until it is acknowledged; the acknowledgement."""
        seen = len(self.of("LAND_ACK"))

        def answered():
            return [a for a in self.of("LAND_ACK")[seen:] if a.of == of and a.cmd_seq == message.cmd_seq]

        self.say(message)
        return self.until(answered, "an answer")[0]

    def refusal(self, message) -> int:
        """LAND_RESULT of a velocity command that must be refused."""
        return self.ask(message, wire.MAVLINK_MSG_ID_LAND_VELOCITY).result
