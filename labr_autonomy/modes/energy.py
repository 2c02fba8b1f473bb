"""Joules by land and by air, and when flying pays.

The powers come from `robot.yaml`: the paper's own figures disagree with each other (Table 3, the stated
endurance and momentum theory give 336 to 1080 W in the air), so they are configuration, not constants.
"""

from __future__ import annotations

from dataclasses import dataclass

from labr_autonomy.config import RobotConfig

GRAVITY_MPS2 = 9.80665  # standard gravity, CODATA
CLIMB_EFFICIENCY = 0.5  # electrical to potential energy, propeller and motor together


@dataclass(frozen=True, slots=True)
class EnergyModel:
    """What a metre costs in each mode."""

    land_w: float
    land_speed_mps: float
    air_w: float
    air_speed_mps: float
    transition_s: float  # take-off and landing together
    mass_kg: float

    @staticmethod
    def of(config: RobotConfig) -> EnergyModel:
        """Model of the configured robot."""
        return EnergyModel(
            land_w=config.energy.land_w,
            land_speed_mps=config.land.speed_mps,
            air_w=config.energy.air_w,
            air_speed_mps=config.air.speed_mps,
            transition_s=config.energy.transition_s,
            mass_kg=config.body.mass_kg,
        )

    def land_j(self, distance_m: float) -> float:
        """Energy to drive a distance [J]."""
        return self.land_w * distance_m / self.land_speed_mps

    def air_j(self, distance_m: float, climb_m: float = 0.0) -> float:
        """Energy to fly a distance and climb a height, without take-off and landing [J]."""
        lift = self.mass_kg * GRAVITY_MPS2 * max(climb_m, 0.0) / CLIMB_EFFICIENCY
        return self.air_w * distance_m / self.air_speed_mps + lift

    def metre_in_air(self) -> float:
        """What a level metre of flying costs, in metres of driving."""
        return self.air_j(1.0) / self.land_j(1.0)

    def transition_j(self) -> float:
        """Energy of one take-off and one landing [J]."""
        return self.air_w * self.transition_s

    def detour_worth_flying_m(self, air_m: float, climb_m: float) -> float:
        """Extra metres on land above which hopping over is cheaper.

        Closed form: fly if dL > [P_air (t_tr + d_air / v_air) + m g h / eta] v_land / P_land.
        """
        return (self.transition_j() + self.air_j(air_m, climb_m)) * self.land_speed_mps / self.land_w
