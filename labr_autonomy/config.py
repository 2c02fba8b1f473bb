"""`robot.yaml`: what the robot is, how it is wired and what it may do.

Each default names its source; where the paper and datasheets are silent it says that it is assumed or chosen,
and by what.
"""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat

from labr_autonomy.gkpn.package import RuntimeName
from labr_autonomy.types import Intrinsics


class Section(BaseModel):
    """A part of the file; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Links(Section):
    """Where the devices answer. The simulator fills this in for its own run."""

    air: str = Field(
        default="serial:///dev/ttyACM0:921600", description="MAVSDK connection URL of the Pixhawk"
    )
    air_key: Path | None = Field(
        default=None, description="file of the MAVLink 2 signing key (32 bytes, mode 0600); unsigned without"
    )
    ground: str = Field(
        default="/dev/serial/by-id/usb-LABR_land_controller", description="serial device of the STM32"
    )
    ground_baud: int = Field(default=460800, gt=0)
    vio: str = Field(
        default="udp://127.0.0.1:14560", description="UDP address to bind for MAVLink ODOMETRY poses"
    )
    depth: str = Field(
        default="labr_depth", description="name of the shared-memory frame slot the camera driver writes"
    )


class Body(Section):
    """Outline and mass. The paper gives no lengths: measure them on your robot."""

    mass_kg: PositiveFloat = 3.4  # paper, section IV-A
    # Outline of wheels and propellers, assumed: four 9-inch propellers (0.23 m) on a wheelbase of 0.36 m.
    radius_m: PositiveFloat = 0.30
    below_m: PositiveFloat = 0.12  # body origin to the floor when it stands on its wheels; assumed
    above_m: PositiveFloat = 0.14  # body origin to the highest point; assumed
    track_m: PositiveFloat = 0.30  # distance of the wheels; assumed


class Camera(Section):
    """Intel D435i depth stream at 424x240 (848x480 binned); pose of the camera in body, looking along x.

    fx and fy make it 90 degrees wide: the upper end of the D400 series datasheet's 87 +- 3.
    """

    width: int = 424
    height: int = 240
    fx: PositiveFloat = 212.0
    fy: PositiveFloat = 212.0
    cx: float = 212.0
    cy: float = 120.0
    x_m: float = 0.14  # assumed: in front of the frame
    z_m: float = 0.06  # assumed: clear of the wheels
    range_min_m: PositiveFloat = 0.30  # D400 series datasheet, minimum Z at 848x480
    range_max_m: PositiveFloat = 10.0  # D435i product page

    @property
    def intrinsics(self) -> Intrinsics:
        """The pinhole model."""
        return Intrinsics(self.width, self.height, self.fx, self.fy, self.cx, self.cy)


class LandLimits(Section):
    """What the wheels may do. Chosen, but for the speed: the paper names none of the others."""

    speed_mps: PositiveFloat = 0.8  # paper, Table 3, land rows: 8.6 m in 11.8 s is 0.73 m/s with its start
    reverse_mps: PositiveFloat = 0.2  # nothing is seen behind: it stops from this within 2 cm
    acceleration_mps2: PositiveFloat = 1.0  # a tenth of g: no slip at a friction of 0.2
    yaw_rate_rps: PositiveFloat = 1.5  # a pixel in 3 ms: images do not smear
    yaw_acceleration_rps2: PositiveFloat = 3.0  # to that rate in half a second


class AirLimits(Section):
    """What the rotors may do. Chosen for flights indoors: the paper names none."""

    speed_mps: PositiveFloat = 1.2  # stops in half a metre with the acceleration and jerk below
    climb_mps: PositiveFloat = 0.8  # two thirds of that
    descend_mps: PositiveFloat = 0.5  # a third of PX4's default (MPC_Z_VEL_MAX_DN 1.5): out of its own wash
    acceleration_mps2: PositiveFloat = 2.5  # a tilt of 14 degrees; below PX4's default (MPC_ACC_HOR 3)
    jerk_mps3: PositiveFloat = 10.0  # that tilt in a quarter of a second
    yaw_rate_rps: PositiveFloat = 1.2  # as on wheels, for the camera's sake
    height_max_m: PositiveFloat = 2.5  # below the ceiling of a room


class Energy(Section):
    """Power and pack. The paper's own figures contradict each other; calibrate these from telemetry."""

    land_w: PositiveFloat = 84.0  # paper, Table 3, land rows: 1161.44 J in 13.7 s, 1008.70 J in 11.8 s
    idle_w: PositiveFloat = 20.0  # assumed for NUC and sensors at rest; the paper has no figure
    # Momentum theory, T^1.5 / sqrt(2 rho A) = 304 W for 3.4 kg under four 9-inch propellers, over a figure
    # of merit of 0.6 and 86 % for motors and controllers; the size of the propellers is assumed.
    air_w: PositiveFloat = 590.0
    # Assumed: arming, lifting off, descending and settling together.
    transition_s: PositiveFloat = 6.0
    # 19 V is the paper's (section IV-A); 8 Ah is assumed: with it `air_w` lasts the 15 minutes stated there.
    pack_j: PositiveFloat = 547_000.0
    # Share never planned with; usual practice, lithium-polymer cells are spoilt by full discharge.
    reserve: float = Field(default=0.15, ge=0.0, lt=1.0)


class Clearance(Section):
    """Free distance demanded around the body's outline [m]. Chosen; flown in `sim/bench/results`."""

    # A trajectory closer than this never leaves the refiner: how far the robot strays from one. In the air it
    # is kept by the sphere round the body's middle; rims of the upright cylinder may come as near as 0.01 m.
    hard_m: float = Field(default=0.04, ge=0.0)
    soft_m: float = Field(default=0.12, ge=0.0)  # what the refiner aims for: pose and map at three sigmas
    landing_m: float = Field(default=0.15, ge=0.0)  # free ring round it to land or take off: hover in gusts
    # Rise over run of the floor where it lands or takes off, at most: 10 degrees. Assumed, so that a place
    # stays below the 15 degrees of tilt at which rotors must not be switched off, though the heights seen
    # from the air tell a slope to about 2 degrees only.
    landing_slope: float = Field(default=0.18, gt=0.0, le=0.5)


class Network(Section):
    """The planning network."""

    weights: Path | None = Field(
        default=None, description="folder that `labr-mission train` wrote; by default the one that ships"
    )
    runtime: RuntimeName = Field(
        default="onnxruntime", description="what computes it; openvino needs the extra of that name"
    )


class RobotConfig(Section):
    """The whole of `robot.yaml`."""

    version: int = Field(default=1, ge=1, le=1)
    name: str = "LABR"
    links: Links = Links()
    body: Body = Body()
    camera: Camera = Camera()
    land: LandLimits = LandLimits()
    air: AirLimits = AirLimits()
    energy: Energy = Energy()
    clearance: Clearance = Clearance()
    network: Network = Network()
