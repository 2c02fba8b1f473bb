"""The simulator process: quad, rover, autopilot, land controller and VIO on one clock, camera beside it.

`python -m sim.server --spec FILE --out DIR` writes `DIR/robot.yaml` with the links filled in, says so in
one JSON line on standard output, and runs in real time until SIGTERM. Then it leaves `truth.npz` and
`referee.json` in DIR.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import math
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from firmware_bridge.pins import Duty
from labr_autonomy.clock import Clock, SystemClock
from labr_autonomy.config import Links, RobotConfig
from labr_autonomy.errors import BadInput, LabrError
from labr_autonomy.estimation.vio_link import udp_address
from labr_autonomy.estimation.vio_message import encode_vio
from labr_autonomy.perception.frame_slot import FrameReader
from labr_autonomy.processes import die_with_parent, on_time
from labr_autonomy.types import Pose
from sim.autopilot.link import AutopilotStandIn
from sim.camera.process import CameraSpec
from sim.external.bridge import Bridge
from sim.firmware.controller import EmulatedController
from sim.land_controller import LandController
from sim.movers.crowd import Crowd
from sim.movers.place import movers_for
from sim.pace import due_steps
from sim.plant import STEP_S, Plant, WheelDrive, WheelDuty
from sim.pose_slot import PoseSlotWriter
from sim.referee import Referee
from sim.spec import SimSpec
from sim.vio import VioStandIn
from sim.worlds.build import build_world
from sim.worlds.surface import Surface

VIO_PERIOD_S = 1.0 / 30.0
CAMERA_TIMEOUT_S = 60.0

log = logging.getLogger("labr.sim")


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _land_controller(
    which: str, robot: RobotConfig, clock: Clock, seed: int, link_path: Path
) -> LandController | EmulatedController:
    """The twin, or the firmware itself.

    Raises:
        BadInput: Neither of them.
        Refused: What builds or emulates the firmware is not installed.
    """
    if which == "twin":
        return LandController(robot, clock, seed, link_path=link_path)
    if which == "qemu":
        return EmulatedController(robot, clock, link_path=link_path)
    raise BadInput(f"there is no land controller {which!r}", "Take twin or qemu")


class Simulator:
    """All parts of one simulated robot.

    Args:
        spec: World, start, seed and robot.
        out: Folder for `robot.yaml`, logs and the truth.
    """

    def __init__(self, spec: SimSpec, out: Path) -> None:
        self._clock = SystemClock()
        self._out = out
        tag = f"labr_{os.getpid()}"
        links = Links(
            air=f"udpin://127.0.0.1:{_free_udp_port()}",
            ground=str(out / "land_controller"),
            vio=f"udp://127.0.0.1:{_free_udp_port()}",
            depth=f"{tag}_depth",
        )
        self.robot: RobotConfig = spec.robot.model_copy(update={"links": links})
        folder = Path(spec.worlds_dir) if spec.worlds_dir else None
        self._world = build_world(spec.world, seed=spec.seed, clear_m=spec.keep_clear_m, worlds_dir=folder)
        self.surface = Surface(self._world, self.robot.body)
        disturbances = spec.drawn()
        air_remote = udp_address("udp://" + links.air.split("://")[1])
        self._autopilot: AutopilotStandIn | Bridge
        if spec.autopilot is None:
            self._autopilot = AutopilotStandIn(self.robot, air_remote, spec.seed)
            self.plant = Plant(self.robot, self.surface, spec.start, spec.seed, disturbances)
        else:
            self._autopilot = Bridge(self.robot, air_remote, spec.autopilot, spec.truth)
            body = self._autopilot.body
            self.plant = Plant(self.robot, self.surface, spec.start, spec.seed, disturbances, body)
        movers = movers_for(spec.movers, spec.seed, spec.ask_m, self._world, self.surface, self.robot)
        if len(movers) < spec.movers:
            log.warning("only %d of %d movers fit beside the way", len(movers), spec.movers)
        self._crowd = Crowd(movers, self.robot) if movers else None
        self.referee = Referee(crowd=self._crowd)
        self._vio = VioStandIn(spec.seed, disturbances.vio)
        self._vio_remote = udp_address(links.vio)
        self._vio_socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._vio_socket.setblocking(False)
        self._vio_due_s = 0.0
        self._vio_sent = 0
        self._land = _land_controller(spec.ground, self.robot, self._clock, spec.seed, Path(links.ground))
        self._pose_slot = PoseSlotWriter(f"{tag}_pose", len(movers))
        self._camera_spec = CameraSpec(
            world=self._world.spec,
            pose_slot=f"{tag}_pose",
            frame_slot=links.depth,
            camera=self.robot.camera,
            seed=spec.seed,
            parent_pid=os.getpid(),
            movers=tuple(mover.as_dict() for mover in movers),
        )
        self._camera: subprocess.Popen[bytes] | None = None
        self.stop = asyncio.Event()

    async def open(self) -> None:
        """Start the camera and wait for its first frame; open the autopilot's socket."""
        self._publish_pose(self._clock.now_s())
        log_file = (self._out / "camera.log").open("ab")
        self._camera = subprocess.Popen(  # noqa: ASYNC220 - starts once, before the loop has a clock to keep
            [sys.executable, "-m", "sim.camera.process", "--spec", self._camera_spec.to_json()],
            stdout=log_file,
            stderr=log_file,
        )
        log_file.close()
        reader = await asyncio.to_thread(FrameReader, self.robot.links.depth, CAMERA_TIMEOUT_S)
        reader.close()
        await self._autopilot.open()
        if isinstance(self._land, EmulatedController):
            self._land.attend(asyncio.get_running_loop())

    def _publish_pose(self, now_s: float) -> None:
        state = self.plant.state
        along_m = self._crowd.along_m if self._crowd is not None else ()
        self._pose_slot.write(now_s, Pose(state.position_m, state.quaternion), along_m)

    def _step(self, now_s: float) -> None:
        plant = self.plant
        motors = self._autopilot.step(now_s, plant.state, plant.battery)
        targets = self._land.step(now_s, plant.pins(armed=self._autopilot.armed))
        if isinstance(targets, Duty):
            plant.step(motors, WheelDuty(targets.left, targets.right, targets.braked))
        else:
            plant.step(motors, WheelDrive(targets.left_mps, targets.right_mps, targets.braked))
        if self._crowd is not None:
            self._crowd.watch(STEP_S, plant.state)
        self.referee.watch(now_s, plant)
        self._publish_pose(now_s)
        self._see(now_s)

    def _see(self, now_s: float) -> None:
        if isinstance(self._autopilot, Bridge) and self._autopilot.blind and not self.plant.state.on_wheels:
            return  # a frozen pose would be worse than none
        if now_s >= self._vio_due_s:
            self._vio_due_s = max(self._vio_due_s + VIO_PERIOD_S, now_s)
            state = self.plant.state
            self._vio.feed(now_s, Pose(state.position_m, state.quaternion), state.velocity_mps)
        for sample in self._vio.due(now_s):
            self._vio_sent += 1
            try:
                self._vio_socket.sendto(encode_vio(sample, self._vio_sent & 0xFF), self._vio_remote)
            except (BlockingIOError, ConnectionRefusedError):
                log.debug("nobody takes the pose")

    async def run(self) -> None:
        """Step in real time until `stop` is set."""
        async for stamps_s in due_steps(self._clock, STEP_S, self.stop, log):
            for stamp_s in stamps_s:
                self._step(stamp_s)
            if self._camera is not None and self._camera.poll() is not None:
                log.error("the camera process ended with code %d", self._camera.returncode)
                self._camera = None

    def close(self) -> None:
        """Let go of everything and write the account."""
        if self._camera is not None:
            self._camera.terminate()
            try:
                self._camera.wait(timeout=3.0)
            except subprocess.TimeoutExpired:
                self._camera.kill()
                self._camera.wait()
        self._autopilot.close()
        self._land.close()
        self._vio_socket.close()
        self._pose_slot.close()
        self.referee.save(self._out, self.plant)


def _say(event: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(event) + "\n")
    sys.stdout.flush()


def _clearances(simulator: Simulator, spec: SimSpec) -> list[float]:
    """Free distance around each asked body position, -1 inside a solid."""
    out = []
    for x, y, z in spec.ask_m:
        floor = simulator.surface.floor_below(x, y, z)
        standing = math.isfinite(floor) and z - floor - simulator.robot.body.below_m < 0.05
        out.append(simulator.surface.free_place(np.array([x, y, z]), on_floor=standing))
    return out


async def serve(spec: SimSpec, out: Path) -> None:
    """Run the simulator until SIGTERM or SIGINT."""
    simulator = Simulator(spec, out)
    loop = asyncio.get_running_loop()
    # Beside an executive, Ctrl-C in the terminal is the executive's: it ends us with SIGTERM in its own time.
    for number in (signal.SIGTERM,) if spec.die_with_parent else (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, simulator.stop.set)
    try:
        await simulator.open()
        robot_path = out / "robot.yaml"
        robot_path.write_text(
            json.dumps(simulator.robot.model_dump(mode="json"), indent=1) + "\n"
        )  # JSON is YAML
        _say({"event": "ready", "robot": str(robot_path), "clearances_m": _clearances(simulator, spec)})
        with on_time():
            await simulator.run()
    finally:
        simulator.close()


def main(argv: list[str] | None = None) -> int:
    """Entry of `python -m sim.server`."""
    parser = argparse.ArgumentParser(prog="sim.server", description="Simulated robot behind real links.")
    parser.add_argument("--spec", type=Path, required=True, help="JSON file of a SimSpec")
    parser.add_argument("--out", type=Path, required=True, help="folder for robot.yaml and the truth")
    arguments = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(relativeCreated)8d ms %(levelname)s %(message)s")
    try:
        spec = SimSpec.load(arguments.spec)
        if spec.die_with_parent:
            die_with_parent(signal.SIGTERM)
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        asyncio.run(serve(spec, arguments.out))
    except LabrError as error:
        _say({"event": "refused", "what": error.what, "do": error.do, "exit_code": int(error.exit_code)})
        return int(error.exit_code)
    return 0


if __name__ == "__main__":
    sys.exit(main())
