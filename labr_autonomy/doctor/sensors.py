"""Camera and VIO: do they send, as often as they must, and on this machine's clock?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from labr_autonomy.clock import SystemClock, pause_s
from labr_autonomy.config import RobotConfig
from labr_autonomy.doctor.finding import Finding, failed, good, wrong
from labr_autonomy.errors import LabrError
from labr_autonomy.estimation.vio_link import VioLink
from labr_autonomy.estimation.vio_message import VioSample
from labr_autonomy.perception.frame_slot import FrameReader

LOOK_S = 1.0
FIND_S = 1.0
CAMERA_MIN_HZ = 10.0  # a plan every 0.1 s wants a new image each time
VIO_MIN_HZ = 15.0
AGE_MAX_S = 0.3  # later than this the guard holds
EARLY_MAX_S = 0.05
VALID_MIN = 0.2  # share of the image with a distance; less is a covered lens, or nothing within 10 m


def examine_camera(config: RobotConfig) -> Iterator[Finding]:
    """Watch the frame slot for a second."""
    try:
        reader = FrameReader(config.links.depth, FIND_S)
    except LabrError as error:
        yield failed("camera", "frames", error)
        return
    try:
        yield from _frames(reader, config)
    finally:
        reader.close()


def _frames(reader: FrameReader, config: RobotConfig) -> Iterator[Finding]:
    clock, seen, ages_s = SystemClock(), list[int](), list[float]()
    end_s = clock.now_s() + LOOK_S
    while clock.now_s() < end_s:
        header = reader.newest_header()
        if header is not None and (not seen or header[0] != seen[-1]):
            seen.append(header[0])
            ages_s.append(clock.now_s() - header[1])
        pause_s(0.005)
    frame = reader.latest()
    if frame is None or len(seen) < 2:
        slot = config.links.depth
        yield wrong("camera", "frames", f"no new image in {LOOK_S:.0f} s on {slot}", "Restart its driver.")
        return
    rate_hz = (seen[-1] - seen[0]) / LOOK_S
    text = f"{rate_hz:.0f} Hz of {frame.intrinsics.width}x{frame.intrinsics.height}"
    if rate_hz < CAMERA_MIN_HZ:
        yield wrong("camera", "frames", text, f"At least {CAMERA_MIN_HZ:.0f} Hz are wanted; look at USB 3.")
    else:
        yield good("camera", "frames", text)
    yield _on_our_clock("camera", ages_s)
    if frame.intrinsics == config.camera.intrinsics:
        yield good("camera", "intrinsics", f"fx {frame.intrinsics.fx:g}, as in robot.yaml")
    else:
        have, want = frame.intrinsics, config.camera.intrinsics
        do = "Copy the driver's figures into camera: of robot.yaml."
        yield wrong("camera", "intrinsics", f"the driver sends {have}, robot.yaml says {want}", do)
    share = float(np.mean(frame.depth_m > 0.0))
    text = f"{100.0 * share:.0f} % of the image has a distance"
    if share < VALID_MIN:
        yield wrong("camera", "view", text, "Uncover the lens, or turn it to something within 10 m.")
    else:
        yield good("camera", "view", text)


async def examine_vio(config: RobotConfig) -> list[Finding]:
    """Listen for poses for a second; nobody else may listen meanwhile."""
    clock, ages_s = SystemClock(), list[float]()

    def take(sample: VioSample) -> None:
        ages_s.append(clock.now_s() - sample.stamp_s)

    try:
        link = VioLink(config.links.vio, take, clock)
        await link.open()
    except LabrError as error:
        return [failed("vio", "poses", error)]
    try:
        await clock.sleep_until(clock.now_s() + LOOK_S)
    finally:
        link.close()
    refused = ", ".join(f"{count} refused: {why.value}" for why, count in link.refused.items())
    text = f"{len(ages_s) / LOOK_S:.0f} Hz on {config.links.vio}" + (f"; {refused}" if refused else "")
    if len(ages_s) / LOOK_S < VIO_MIN_HZ:
        do = f"Start the VIO: ODOMETRY in LOCAL_FLU to {config.links.vio}, at least {VIO_MIN_HZ:.0f} Hz."
        return [wrong("vio", "poses", text, do)]
    return [good("vio", "poses", text), _on_our_clock("vio", ages_s)]


def _on_our_clock(area: str, ages_s: list[float]) -> Finding:
    """Whether stamps are of this machine's monotonic clock and young."""
    low, high, middle = min(ages_s), max(ages_s), float(np.median(ages_s))
    text = f"stamps are {1e3 * middle:.0f} ms old when they come ({1e3 * low:.0f} to {1e3 * high:.0f})"
    if low < -EARLY_MAX_S or high > 3600.0:
        return wrong(area, "clock", text, "Stamp with CLOCK_MONOTONIC of this machine, at mid-exposure.")
    if middle > AGE_MAX_S:
        return wrong(area, "clock", text, f"More than {AGE_MAX_S} s is too late to fly by; look at its load.")
    return good(area, "clock", text)
