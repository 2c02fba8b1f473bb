"""What the world does to the robot against its will: VIO errors, wind, slip, lag and a real battery.

All values are sigmas or time constants; what is drawn from them follows from the run's seed alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np

from labr_autonomy.errors import BadInput
from labr_autonomy.types import Array
from sim.battery import RESISTANCE_OHM
from sim.rover import TAU_S, Slip
from sim.vio import VioModel

# MIL-F-8785C, 3.7.3.4, at its lowest height of 10 ft: sigma_u / sigma_w = (0.177 + 0.000823 h)^-0.4 = 1.96.
VERTICAL_SHARE = 1.0 / 1.96


@dataclass(frozen=True, slots=True)
class Wind:
    """Mean wind and gusts around it; acts on the flying robot only."""

    mean_mps: float = 0.0
    gust_mps: float = 0.0  # standard deviation per horizontal axis; upwards `VERTICAL_SHARE` of it
    direction_rad: float | None = None  # the way the mean wind blows to, from east; drawn when None
    time_constant_s: float = 3.0  # of the gusts


@dataclass(frozen=True, slots=True)
class Actuators:
    """How late the actuators follow."""

    rotor_lag_s: float = 0.0  # of the motor controllers, on top of the rotors' own inertia
    wheel_tau_s: float = TAU_S  # wheel motor with its speed controller


@dataclass(frozen=True, slots=True)
class Pack:
    """State of the battery at the start."""

    resistance_ohm: float = RESISTANCE_OHM
    charge: float = 1.0  # share of the pack's energy that is left


@dataclass(frozen=True, slots=True)
class Disturbances:
    """Everything that disturbs a run. The plain value is still air with the usual errors of the robot."""

    vio: VioModel = field(default_factory=VioModel)
    wind: Wind = field(default_factory=Wind)
    slip: Slip = field(default_factory=Slip)
    actuators: Actuators = field(default_factory=Actuators)
    battery: Pack = field(default_factory=Pack)

    def __post_init__(self) -> None:
        """Refuse what makes no sense."""
        for part in fields(self):
            for name, value in asdict(getattr(self, part.name)).items():
                _check(f"{part.name}.{name}", value)
        if self.slip.steady_low > self.slip.steady_high:
            raise BadInput(
                f"disturbances.slip.steady_low is {self.slip.steady_low:g}, more than steady_high",
                f"Give at most {self.slip.steady_high:g}, or raise steady_high.",
            )

    @staticmethod
    def none() -> Disturbances:
        """Perfect sensing, still air, no slip, no lag beyond the robot's own, a stiff and full battery."""
        return Disturbances(
            vio=VioModel(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            slip=Slip(0.0, 0.0, 0.0, 0.0, 0.0),
            battery=Pack(resistance_ohm=0.0),
        )

    @staticmethod
    def for_family(name: str) -> Disturbances:
        """Those usual in a family of worlds: drafts indoors, weather in the forest."""
        return replace(Disturbances(), wind=_WINDS.get(name, _WINDS["indoor"]))

    @staticmethod
    def for_world(spec: Mapping[str, Any]) -> Disturbances:
        """Those usual in a world, by its family or by the name of its mesh file."""
        name = str(spec.get("family") or spec.get("mesh", ""))
        return Disturbances.for_family(next((kind for kind in _WINDS if kind in name), "indoor"))

    @staticmethod
    def from_dict(values: Mapping[str, Any], usual: Disturbances | None = None) -> Disturbances:
        """Read plain JSON values.

        Args:
            values: Parts and their fields as in `as_dict`; or `setting`: "none" or a family to start from.
            usual: What holds for all that `values` leaves out.

        Raises:
            BadInput: on an unknown key or a value that makes no sense.
        """
        rest = dict(values)
        setting = rest.pop("setting", None)
        out = usual or Disturbances()
        if setting == "none":
            out = Disturbances.none()
        elif setting is not None:
            if setting not in _WINDS:
                raise BadInput(
                    f"there is no setting '{setting}' of disturbances",
                    f"Known: none, {', '.join(sorted(_WINDS))}.",
                )
            out = Disturbances.for_family(setting)
        _known("disturbances", rest, out)
        for part, changes in rest.items():
            before = getattr(out, part)
            if not isinstance(changes, Mapping):
                raise BadInput(f"disturbances.{part} is {changes!r}", "Give a block of its fields.")
            _known(f"disturbances.{part}", changes, before)
            out = replace(out, **{part: replace(before, **changes)})
        return out

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready; `from_dict` reads it back."""
        return asdict(self)


# Indoors: drafts of ventilation and doors. Garage: open sides. Forest: wind under the crowns on a breezy day.
_WINDS = {
    "indoor": Wind(gust_mps=0.2),
    "hall": Wind(gust_mps=0.2),
    "rooms": Wind(gust_mps=0.2),
    "garage": Wind(mean_mps=0.3, gust_mps=0.3),
    "forest": Wind(mean_mps=1.0, gust_mps=0.8),
}
_SHARES = {"slip.steady_low", "slip.steady_high", "slip.burst_share", "battery.charge"}
_POSITIVE = {"vio.drift_memory_m", "wind.time_constant_s", "actuators.wheel_tau_s", "battery.charge"}


def _check(name: str, value: Any) -> None:
    if name == "wind.direction_rad" and value is None:
        return
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise BadInput(f"disturbances.{name} is {value!r}", "Give a finite number.")
    if name in _POSITIVE and value <= 0.0:
        raise BadInput(f"disturbances.{name} is {value:g}", "Give more than 0.")
    if name != "wind.direction_rad" and (value < 0.0 or (name in _SHARES and value > 1.0)):
        raise BadInput(
            f"disturbances.{name} is {value:g}",
            "Give 0 to 1." if name in _SHARES else "Give 0 or more.",
        )


def _known(where: str, given: Mapping[str, Any], value: Any) -> None:
    names = {f.name for f in fields(value)}
    unknown = sorted(set(given) - names)
    if unknown:
        raise BadInput(f"{where} has no field '{unknown[0]}'", f"Known fields: {', '.join(sorted(names))}.")


class WindField:
    """The wind at the robot over time: the mean and an Ornstein-Uhlenbeck gust on each axis.

    That process has the spectrum of the Dryden model's longitudinal gust (MIL-F-8785C, 3.7.1.2;
    MIL-HDBK-1797, appendix A), sigma^2 2 T / (1 + (T w)^2) with T = L/V; here all axes have it, and T is
    given outright, because a robot that hovers has no airspeed to divide by.

    Args:
        wind: Its figures.
        seed: Of direction and gusts.
    """

    def __init__(self, wind: Wind, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 0x77696E64])
        drawn_rad = float(self._rng.uniform(-math.pi, math.pi))
        heading = drawn_rad if wind.direction_rad is None else wind.direction_rad
        self._mean = wind.mean_mps * np.array([math.cos(heading), math.sin(heading), 0.0])
        self._sigma = wind.gust_mps * np.array([1.0, 1.0, VERTICAL_SHARE])
        self._tau_s = wind.time_constant_s
        self._gust = self._sigma * self._rng.normal(size=3)
        self.still = wind.mean_mps == 0.0 and wind.gust_mps == 0.0

    @property
    def velocity_mps(self) -> Array:
        """Velocity of the air (3,) in the world [m/s]."""
        out: Array = self._mean + self._gust
        return out

    def step(self, dt_s: float) -> Array:
        """Go on by `dt_s` [s], exactly for any step; returns the velocity of the air (3,) [m/s]."""
        keep = math.exp(-dt_s / self._tau_s)
        fresh = math.sqrt(1.0 - keep * keep)
        self._gust = keep * self._gust + (fresh * self._sigma) * self._rng.normal(size=3)
        return self.velocity_mps
