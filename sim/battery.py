"""The pack: 5S, 8 Ah, 547 kJ. One object of the simulator core feeds rotors, wheels and computer alike."""

from __future__ import annotations

from bisect import bisect_right

from labr_autonomy.errors import BadInput

CELLS = 5
PACK_J = 547_000.0  # robot.yaml, Energy.pack_j: 8 Ah at 19 V
RESISTANCE_OHM = 0.025  # five cells of 4 mOhm and the leads; usual for 8 Ah cells
SETTLING_S = 0.05  # the bus capacitors and the cells' double layer keep the sag from following single steps
# Open-circuit voltage of a lithium-polymer cell over its charge; the mean over the charge is 3.8 V.
_CHARGE = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_CELL_V = (3.20, 3.50, 3.60, 3.68, 3.73, 3.76, 3.79, 3.84, 3.90, 3.97, 4.07, 4.18)


class Battery:
    """Energy store with internal resistance.

    Args:
        pack_j: Energy between full and empty at open circuit [J].
        remaining: Fraction of `pack_j` at the start, 0..1.
        resistance_ohm: Internal resistance [Ohm].
    """

    def __init__(
        self, pack_j: float = PACK_J, *, remaining: float = 1.0, resistance_ohm: float = RESISTANCE_OHM
    ) -> None:
        if not (pack_j > 0.0 and 0.0 <= remaining <= 1.0 and resistance_ohm >= 0.0):
            raise BadInput(
                f"a battery of {pack_j} J, {remaining} full, {resistance_ohm} Ohm makes no sense",
                "Give a positive energy, a fraction from 0 to 1 and a resistance of 0 or more.",
            )
        self.pack_j = pack_j
        self.resistance_ohm = resistance_ohm
        self._left_j = pack_j * remaining
        self._load_w: dict[str, float] = {}
        self.used_by_j: dict[str, float] = {}  # at the terminals, by consumer
        self.heat_j = 0.0  # lost in the internal resistance
        self.current_a = 0.0
        self._sag_v = 0.0
        self.volts = self.open_circuit_v

    @property
    def remaining(self) -> float:
        """Fraction left, 0..1."""
        return self._left_j / self.pack_j

    @property
    def open_circuit_v(self) -> float:
        """Voltage without load [V]."""
        charge = self._left_j / self.pack_j
        i = min(max(bisect_right(_CHARGE, charge), 1), len(_CHARGE) - 1)
        a, b = _CHARGE[i - 1], _CHARGE[i]
        low, high = _CELL_V[i - 1], _CELL_V[i]
        return CELLS * (low + (high - low) * (charge - a) / (b - a))

    @property
    def used_j(self) -> float:
        """Energy given to all consumers so far [J]."""
        return sum(self.used_by_j.values())

    def draw(self, consumer: str, watts: float) -> None:
        """Set the power that a consumer takes from now on [W]; energy never flows back."""
        self._load_w[consumer] = max(0.0, watts)

    def step(self, dt_s: float) -> float:
        """Give every consumer its power for `dt_s` [s].

        The load is of constant power. The sag follows I*R with a lag of `SETTLING_S`, and is at most half of
        the open-circuit voltage; there, or with an empty pack, the consumers get less than they ask for.

        Returns:
            Terminal voltage [V].
        """
        asked_w = sum(self._load_w.values())
        e = self.open_circuit_v
        if self._left_j <= 0.0:
            given_w, self.current_a, self._sag_v, self.volts = 0.0, 0.0, 0.0, 0.0
        else:
            r = self.resistance_ohm
            given_w = min(asked_w, e * e / (4.0 * r)) if r > 0.0 else asked_w
            volts = e - self._sag_v
            self.current_a = given_w / volts
            wanted_v = min(self.current_a * r, 0.5 * e)
            self._sag_v += dt_s / (SETTLING_S + dt_s) * (wanted_v - self._sag_v)
            self.volts = e - self._sag_v
        heat_j = self.current_a**2 * self.resistance_ohm * dt_s
        self.heat_j += heat_j
        self._left_j = max(0.0, self._left_j - given_w * dt_s - heat_j)
        share = given_w / asked_w if asked_w > 0.0 else 0.0
        for consumer, watts in self._load_w.items():
            self.used_by_j[consumer] = self.used_by_j.get(consumer, 0.0) + share * watts * dt_s
        return self.volts
