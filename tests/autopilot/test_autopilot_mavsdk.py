"""The real MAVSDK over loopback UDP: connect, offboard, arm, climb a metre, land."""

import asyncio
import json
import math
import socket
from contextlib import asynccontextmanager

import numpy as np
import pytest
from autopilot_rig import vision_message
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action, ActionError
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.telemetry import LandedState, Telemetry

from labr_autonomy.clock import SystemClock, Ticker
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import LinkError
from sim.autopilot import AutopilotStandIn
from sim.battery import Battery
from sim.quad import STEP_S, Quad

# A flight in real time: arm, climb, land.
pytestmark = [pytest.mark.sitl, pytest.mark.slow, pytest.mark.timeout(60)]


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Simulator:
    """Physics, battery and stand-in in real time on this loop."""

    def __init__(self, port):
        self.quad = Quad()
        self.quad.reset(np.array([0.0, 0.0, 0.12]), math.pi / 2)
        self.battery = Battery()
        self.autopilot = AutopilotStandIn(RobotConfig(), ("127.0.0.1", port), seed=3)
        self.touch_mps = 0.0

    async def run(self):
        clock = SystemClock()
        ticker = Ticker(clock, STEP_S)
        await self.autopilot.open()
        try:
            while True:
                await ticker.wait()
                before = self.quad.state
                motors = self.autopilot.step(clock.now_s(), before, self.battery)
                self.battery.draw("rotors", before.electrical_w)
                self.quad.set_volts(self.battery.step(STEP_S))
                after = self.quad.step(np.zeros(4) if motors is None else motors)
                if after.on_ground and not before.on_ground:
                    self.touch_mps = max(self.touch_mps, -float(before.velocity_mps[2]))
        finally:
            self.autopilot.close()


class Client:
    """A companion: vision poses and set-points at their rates, one message a call, nothing repeated."""

    def __init__(self, system, simulator):
        self.direct = MavlinkDirect(system)
        self.simulator = simulator
        self.height_m = None

    def send(self, name, fields):
        clean = {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in fields.items()}
        self.direct.send_message(MavlinkMessage(name, 0, 0, 0, 0, json.dumps(clean)))

    async def run(self):
        ticker = Ticker(SystemClock(), 0.02)
        while True:
            await ticker.wait()
            pose = vision_message(self.simulator.quad.state, 0).to_dict()
            pose |= {"pose_covariance": [None] * 21, "velocity_covariance": [None] * 21}
            del pose["mavpackettype"]
            self.send("ODOMETRY", pose)
            if self.height_m is not None:
                self.send(
                    "SET_POSITION_TARGET_LOCAL_NED",
                    dict(
                        time_boot_ms=0,
                        target_system=1,
                        target_component=1,
                        coordinate_frame=1,
                        type_mask=2552,
                    )
                    | dict(x=0.0, y=0.0, z=-self.height_m, vx=0.0, vy=0.0, vz=0.0, afx=0.0, afy=0.0, afz=0.0)
                    | dict(yaw=0.0, yaw_rate=0.0),
                )

    def offboard(self):
        ack = self.direct.send_command(
            MavlinkMessage(
                "COMMAND_LONG",
                0,
                0,
                0,
                0,
                json.dumps(
                    dict(target_system=1, target_component=1, command=176, confirmation=0)
                    | dict(param1=1.0, param2=6.0, param3=0.0, param4=0.0, param5=0.0, param6=0.0, param7=0.0)
                ),
            )
        )
        return json.loads(ack.fields_json)["result"]


async def until(reached, seconds):
    ticker = Ticker(SystemClock(), 0.02)
    for _ in range(round(seconds / 0.02)):
        if reached():
            return
        await ticker.wait()
    raise AssertionError(f"not reached within {seconds} s")


@asynccontextmanager
async def running(*coroutines):
    tasks = [asyncio.create_task(c) for c in coroutines]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        results = await asyncio.gather(*tasks, return_exceptions=True)
        assert all(isinstance(r, asyncio.CancelledError) for r in results), results


async def test_mavsdk_flies_it():
    port = free_port()
    simulator = Simulator(port)
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
    sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    try:
        async with running(simulator.run()):
            system = await asyncio.to_thread(sdk.first_autopilot, 10.0)
            assert system is not None
            action, telemetry = Action(system), Telemetry(system)
            client = Client(system, simulator)
            async with running(client.run()):
                await fly(client, action, telemetry, simulator)
    finally:
        sdk.destroy()


async def fly(client, action, telemetry, simulator):
    await until(lambda: telemetry.health().is_local_position_ok, 5.0)
    with pytest.raises(ActionError):
        await asyncio.to_thread(action.arm)  # in Hold, without a global position
    client.height_m = 1.12
    await until(lambda: client.simulator.autopilot.vehicle.boot_s > 2.0, 5.0)
    assert await asyncio.to_thread(client.offboard) == 0
    await asyncio.to_thread(action.arm)
    await until(telemetry.armed, 2.5)
    await until(lambda: telemetry.landed_state() is LandedState.IN_AIR, 4.0)
    await until(lambda: -telemetry.position_velocity_ned().position.down_m > 1.0, 5.0)
    assert simulator.quad.state.position_m[2] > 0.95
    client.height_m = None
    await asyncio.to_thread(action.land)
    await until(lambda: not simulator.autopilot.armed, 8.0)
    await until(lambda: not telemetry.armed(), 2.0)
    assert 0.0 < simulator.touch_mps <= 0.5
    assert simulator.quad.state.position_m == pytest.approx([0.0, 0.0, 0.12], abs=0.08)
    assert simulator.battery.used_by_j["rotors"] > 2000.0


async def test_an_open_stand_in_has_an_address_and_a_closed_one_has_none():
    stand_in = AutopilotStandIn(RobotConfig(), ("127.0.0.1", free_port()))
    with pytest.raises(LinkError, match="no socket"):
        _ = stand_in.local_address
    await stand_in.open()
    assert stand_in.local_address[0] == "127.0.0.1"
    stand_in.close()
    stand_in.close()


async def test_a_wrong_address_is_one_sentence():
    with pytest.raises(LinkError, match=r"cannot send to 256\.0\.0\.1"):
        await AutopilotStandIn(RobotConfig(), ("256.0.0.1", 14540)).open()
