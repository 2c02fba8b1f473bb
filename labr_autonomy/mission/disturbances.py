"""`sim: disturbances:` of a mission file. What is left out keeps its usual value in `sim.disturbances`."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from labr_autonomy.mission.section import Section

Share = Annotated[float, Field(ge=0.0, le=1.0)]


def _size(most: float) -> Any:
    return Field(ge=0.0, le=most)


class Vio(Section):
    """Errors of the visual-inertial odometry; sigmas are per axis and sample."""

    delay_s: Annotated[float, _size(0.5)] | None = None
    """From exposure to the pose [s]."""
    position_sigma_m: Annotated[float, _size(1.0)] | None = None
    """Noise of the position [m]."""
    rotation_sigma_deg: Annotated[float, _size(30.0)] | None = None
    """Noise of the attitude [deg]."""
    velocity_sigma_mps: Annotated[float, _size(2.0)] | None = None
    """Noise of the velocity [m/s]."""
    drift_share: Share | None = None
    """Metres of drift per metre of way, rms."""
    yaw_drift_deg_per_m: Annotated[float, _size(30.0)] | None = None
    """Drift of the heading per metre of way, rms [deg/m]."""
    drift_memory_m: Annotated[float, Field(gt=0.0, le=1000.0)] | None = None
    """Way after which the drift has found another direction [m]."""


class Wind(Section):
    """Wind on the flying robot."""

    mean_mps: Annotated[float, _size(15.0)] | None = None
    """Mean speed [m/s]."""
    gust_mps: Annotated[float, _size(10.0)] | None = None
    """Gusts around the mean, standard deviation per horizontal axis [m/s]."""
    direction_deg: Annotated[float, Field(ge=-360.0, le=360.0)] | None = None
    """The way the mean wind blows to, counter-clockwise from x [deg]; drawn from the seed if left out."""
    time_constant_s: Annotated[float, Field(ge=0.04, le=600.0)] | None = None
    """How long a gust lasts [s]."""


class Slip(Section):
    """Share of a wheel's motion that the ground does not get."""

    steady_low: Share | None = None
    """The steady part of each wheel is drawn between this..."""
    steady_high: Share | None = None
    """... and this."""
    noise: Share | None = None
    """Standard deviation of the slowly changing part."""
    burst_per_s: Annotated[float, _size(20.0)] | None = None
    """Rate of spots where a rolling tyre loses its grip [1/s]."""
    burst_share: Share | None = None
    """Slip in such a spot."""

    @model_validator(mode="after")
    def _in_order(self) -> Slip:
        low, high = self.steady_low, self.steady_high
        if low is not None and high is not None and low > high:
            raise PydanticCustomError(
                "slip_order",
                "steady_low is more than steady_high ({low} > {high})",
                {"low": low, "high": high, "at": "steady_low"},
            )
        return self


class Actuators(Section):
    """How late the actuators follow."""

    rotor_lag_s: Annotated[float, _size(0.5)] | None = None
    """Time constant of the rotors' controllers, on top of the rotors' inertia [s]."""
    wheel_tau_s: Annotated[float, Field(gt=0.0, le=2.0)] | None = None
    """Time constant of the wheel motors [s]."""


class Pack(Section):
    """The battery at the start."""

    resistance_ohm: Annotated[float, _size(0.5)] | None = None
    """Internal resistance [Ohm]."""
    charge: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    """Share of its energy that is left."""


class Disturbances(Section):
    """What disturbs the robot; all of it is drawn from the seed."""

    setting: Literal["none", "indoor", "hall", "rooms", "garage", "forest"] | None = None
    """What is usual there; `none` is perfect sensing, still air, no slip. By default the world's own."""
    vio: Vio = Vio()
    wind: Wind = Wind()
    slip: Slip = Slip()
    actuators: Actuators = Actuators()
    battery: Pack = Pack()

    def spec(self) -> dict[str, Any]:
        """What `sim.disturbances.Disturbances.from_dict` reads: SI, and only what is given."""
        given = self.model_dump(exclude_none=True)
        return {k: _si(v) if isinstance(v, dict) else v for k, v in given.items() if v != {}}


def _si(values: dict[str, float]) -> dict[str, float]:
    return {
        name.replace("_deg", "_rad"): math.radians(value) if "_deg" in name else value
        for name, value in values.items()
    }
