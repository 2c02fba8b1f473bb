"""The fit finds the constants of a recorded flight within the errors that it states."""

import numpy as np
import pytest
from energy_rig import MASS_KG, Truth, write_flight

from labr_autonomy.errors import BadInput
from labr_autonomy.modes.energy_fit import MEMORY_S, Samples, _newey_west, fit_energy
from labr_autonomy.modes.transition import Phase
from labr_autonomy.record.flight_log import FlightLog
from labr_autonomy.record.power import read_power

TRUTH = Truth()
KNOWN = {
    "idle_w": TRUTH.idle_w,
    "land_w": TRUTH.land_w(0.8),
    "air_w": TRUTH.hover_w,
    "transition_j": TRUTH.take_off_j + TRUTH.landing_j,
}


def fitted(*folders):
    samples = [read_power(folder, 0.3).samples for folder in folders]
    return fit_energy(samples, land_speed_mps=0.8, mass_kg=MASS_KG)


def test_known_constants_are_found_within_the_stated_error(tmp_path):
    misses = {name: [] for name in KNOWN}
    for seed in range(12):
        fit = fitted(write_flight(tmp_path / str(seed), seed=seed, hops=3))
        for name, true in KNOWN.items():
            figure = getattr(fit, name)
            assert figure.error < 0.05 * true, name
            misses[name].append(abs(figure.value - true) / figure.error)
    for name, missed in misses.items():
        # Two standard errors hold 95 of 100; with a handful of samples that are alike, somewhat fewer.
        assert np.mean(np.array(missed) < 2.0) >= 0.7, name
        assert max(missed) < 6.0, name


def test_errors_are_not_those_of_independent_samples():
    rng = np.random.default_rng(1)
    noise = np.convolve(rng.normal(size=4000), np.ones(20), "same")
    alone = float(noise @ noise)
    together = float(_newey_west(noise[:, None], round(MEMORY_S / 0.1))[0, 0])
    assert together > 8.0 * alone
    white = rng.normal(size=4000)
    assert float(_newey_west(white[:, None], 30)[0, 0]) == pytest.approx(float(white @ white), rel=0.4)


def test_several_flights_are_fitted_together(tmp_path):
    folders = [write_flight(tmp_path / str(seed), seed=seed, hops=1) for seed in range(3)]
    one, all_three = fitted(folders[0]), fitted(*folders)
    assert one.transition_j.error is None  # one take-off tells nothing of its scatter
    assert one.transition_s.error is None
    assert all_three.transition_j.error > 0.0
    assert all_three.transition_j.samples == 3
    assert all_three.land_w.samples > 2.5 * one.land_w.samples
    assert all_three.transition_s.value == pytest.approx(4000.0 / 640.0, rel=0.05)


def test_the_height_gained_is_not_part_of_a_take_off(tmp_path):
    fit = fitted(write_flight(tmp_path / "a", noise_w=0.0, hops=4))
    # 1.2 m of climb are 80 J of the 2100; were they counted, they would show.
    assert fit.transition_j.value == pytest.approx(4000.0, abs=50.0)


def test_what_a_drive_does_not_tell_is_left_out(tmp_path):
    n = 200
    speed = np.full(n, 0.6)
    stamps = 0.1 * np.arange(n)
    still = np.zeros(n)
    drive = Samples(stamps, 80.0 + still, (Phase.DRIVING,) * n, speed, still, still)
    fit = fit_energy([drive], land_speed_mps=0.6, mass_kg=3.4)
    assert fit.land_w.value == pytest.approx(80.0)
    assert fit.idle_w is fit.air_w is fit.transition_j is fit.transition_s is None
    assert fit.rolled_mps == pytest.approx((0.6, 0.6))


def test_a_torn_hand_over_is_no_transition():
    phases = [Phase.DRIVING] * 5 + [Phase.ARMING] * 5 + [Phase.LIFTING] * 5 + [Phase.DESCENDING] * 5
    n = len(phases)
    still = np.zeros(n)
    flight = Samples(0.1 * np.arange(n), still + 500.0, tuple(phases), still, still, still)
    assert fit_energy([flight], land_speed_mps=0.8, mass_kg=3.4).transition_j is None


def test_a_take_off_that_was_called_off_is_no_landing():
    """It disarms on its wheels: a landing's joules would come out far too low."""
    hop = [Phase.ARMING] * 5 + [Phase.LIFTING] * 5 + [Phase.FLYING] * 5 + [Phase.DESCENDING] * 10
    called_off = [Phase.DRIVING] * 5 + [Phase.ARMING] * 5 + [Phase.DISARMING] * 5
    whole = [Phase.DRIVING] * 5 + hop + [Phase.DRIVING] * 5

    def joules(phases):
        still = np.zeros(len(phases))
        flight = Samples(0.1 * np.arange(len(phases)), still + 500.0, tuple(phases), still, still, still)
        return fit_energy([flight], land_speed_mps=0.8, mass_kg=3.4).transition_j.value

    assert joules([*whole, *called_off, Phase.DRIVING]) == pytest.approx(joules(whole))


def test_the_air_channel_stands_in_for_the_ground_channel(tmp_path):
    both = read_power(write_flight(tmp_path / "both", air_gain=1.1), 0.3)
    assert both.channel == "ground"
    assert both.other_over_used == pytest.approx(1.1, abs=1e-6)
    air = read_power(write_flight(tmp_path / "air", ground=False), 0.3)
    assert (air.channel, air.other_over_used) == ("air", None)
    assert air.samples.power_w == pytest.approx(both.samples.power_w)


def test_a_turn_in_place_turns_the_wheels(tmp_path):
    folder = write_flight(tmp_path / "a", hops=1)
    straight = read_power(folder, 0.3).samples
    assert straight.wheel_mps.max() == pytest.approx(0.85, abs=0.01)
    assert straight.phase[0] is Phase.DRIVING


def test_no_telemetry_is_said_in_one_sentence(tmp_path):
    silent = write_flight(tmp_path / "silent", ground=False, air=False)
    with pytest.raises(BadInput, match="holds no battery telemetry"):
        read_power(silent, 0.3)
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadInput, match=r"holds no flight\.mcap"):
        read_power(tmp_path / "empty", 0.3)
    with FlightLog(tmp_path / "empty" / "flight.mcap", metadata={}) as log:
        for i in range(30):
            log.battery(
                float(i), voltage_v=19.0, power_w=80.0, energy_land_j=0, energy_air_j=0, energy_transition_j=0
            )
    with pytest.raises(BadInput, match="holds no motion or no modes"):
        read_power(tmp_path / "empty", 0.3)
