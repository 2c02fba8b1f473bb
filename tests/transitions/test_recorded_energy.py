"""The energy fit on hand-overs of the simulator, whose constants are those of `sim/rover.py`."""

import pytest
from flight_recording import recorded

from labr_autonomy.config import RobotConfig
from labr_autonomy.modes.energy_fit import fit_energy
from labr_autonomy.modes.transition import Phase
from labr_autonomy.record.power import read_power
from sim.rover import FIXED_SHARE, TABLE_SPEED_MPS

ROBOT = RobotConfig()
SPEED_MPS = ROBOT.land.speed_mps


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_the_simulators_constants_are_found_within_the_stated_error(tmp_path):
    flights = [recorded(seed, tmp_path / str(seed)) for seed in (0, 1, 2)]
    assert all(hop.done for hop, _, _ in flights)
    samples = [read_power(tmp_path / str(seed), ROBOT.body.track_m).samples for seed in (0, 1, 2)]
    fit = fit_energy(samples, land_speed_mps=SPEED_MPS, mass_kg=ROBOT.body.mass_kg)

    idle, rolling = ROBOT.energy.idle_w, ROBOT.energy.land_w - ROBOT.energy.idle_w
    slips = [sum(plant.rover.steady_slip) / 2.0 for _, plant, _ in flights]
    wheels_mps = SPEED_MPS / (1.0 - sum(slips) / len(slips))
    land_w = idle + rolling * (FIXED_SHARE + (1.0 - FIXED_SHARE) * wheels_mps / TABLE_SPEED_MPS)
    assert abs(fit.idle_w.value - idle) < 3.0 * fit.idle_w.error
    assert abs(fit.land_w.value - land_w) < 3.0 * fit.land_w.error
    assert fit.land_w.error < 0.01 * land_w

    flown = [spent[Phase.FLYING] for _, _, spent in flights]
    air_w = sum(joules for joules, _ in flown) / sum(seconds for _, seconds in flown)
    assert abs(fit.air_w.value - air_w) < 3.0 * fit.air_w.error
    assert fit.air_w.error < 0.02 * air_w

    driven = (Phase.DRIVING, Phase.STOPPING, Phase.FLYING)
    between = [sum(s[0] for phase, s in spent.items() if phase not in driven) for _, _, spent in flights]
    lift_j = ROBOT.body.mass_kg * 9.80665 / 0.5
    heights = [hop.conditions.height_m for hop, _, _ in flights]
    transition_j = sum(between) / 3.0 - lift_j * sum(heights) / 3.0
    assert abs(fit.transition_j.value - transition_j) < 3.0 * fit.transition_j.error
    assert fit.transition_j.error < 0.1 * transition_j
