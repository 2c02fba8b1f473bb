"""The pack: energy balance, sag, emptiness."""

import pytest

from labr_autonomy.config import Energy
from labr_autonomy.errors import BadInput
from sim.battery import CELLS, PACK_J, Battery


def drain(battery, watts, seconds, dt_s=0.5):
    battery.draw("rotors", watts)
    for _ in range(round(seconds / dt_s)):
        battery.step(dt_s)


def test_it_is_the_pack_of_the_robot_file():
    assert Energy().pack_j == PACK_J
    assert Battery().open_circuit_v == pytest.approx(CELLS * 4.18)


def test_energy_is_conserved():
    battery = Battery()
    battery.draw("computer", 20.0)
    drain(battery, 590.0, 200.0)
    assert battery.used_by_j["rotors"] == pytest.approx(590.0 * 200.0)
    assert battery.used_by_j["computer"] == pytest.approx(20.0 * 200.0)
    assert battery.used_j + battery.heat_j == pytest.approx(PACK_J * (1.0 - battery.remaining))
    assert 0.0 < battery.heat_j < 0.1 * battery.used_j


def test_load_makes_it_sag_and_rest_lets_it_recover():
    battery = Battery()
    drain(battery, 590.0, 5.0)
    loaded = battery.volts
    assert loaded == pytest.approx(battery.open_circuit_v - battery.current_a * 0.025, abs=0.02)
    assert 0.4 < battery.open_circuit_v - loaded < 1.2
    drain(battery, 0.0, 5.0)
    assert battery.volts > loaded + 0.4


def test_hovering_lasts_about_a_quarter_of_an_hour():
    battery, seconds = Battery(), 0
    battery.draw("rotors", 590.0)
    while battery.remaining > 0.0:
        battery.step(1.0)
        seconds += 1
    assert 13 * 60 < seconds < 16 * 60
    battery.step(1.0)
    assert (battery.volts, battery.current_a, battery.remaining) == (0.0, 0.0, 0.0)


def test_an_impossible_load_gets_what_there_is():
    battery = Battery()
    battery.draw("short", 1e6)
    for _ in range(100):
        battery.step(0.004)
    assert battery.volts >= 0.5 * battery.open_circuit_v - 1e-9
    assert battery.used_by_j["short"] < 1e6 * 0.4


def test_a_consumer_cannot_charge_it():
    battery = Battery(remaining=0.5)
    drain(battery, -100.0, 10.0)
    assert battery.remaining == pytest.approx(0.5)


@pytest.mark.parametrize(
    "bad", [{"pack_j": 0.0}, {"remaining": 1.2}, {"remaining": -0.1}, {"resistance_ohm": -1.0}]
)
def test_nonsense_is_refused(bad):
    with pytest.raises(BadInput, match="makes no sense"):
        Battery(**bad)
