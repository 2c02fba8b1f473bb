"""JSBSim and the battery against closed forms: hover power, free fall, drift with the wind, joules."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from physics_rig import BRAKED, CONFIG, NO_SLIP, G, flat, plant_on

from labr_autonomy.frames import roll_pitch_of
from sim.battery import Battery
from sim.disturbances import Actuators, Disturbances, Pack, Wind, WindField
from sim.plant import STEP_S
from sim.quad import Quad

MASS_KG = CONFIG.body.mass_kg
AIR_KGPM3 = 1.225  # ISA at sea level, JSBSim's atmosphere at height 0
DISK_M2 = 4.0 * math.pi * 0.1143**2  # four 9-inch propellers
FIGURE_OF_MERIT = 0.60  # labr_prop.xml
DRAG_M2 = 0.75 * 0.09290304  # labr_quad.xml, 0.75 square feet
HIGH = np.array([0.0, 0.0, 30.0])


def hover_duty(volts=18.5):
    """Duty that holds the weight, by bisection, and the electrical power it takes [W]."""
    quad = Quad()
    quad.set_volts(volts)
    low, high, state = 0.3, 0.9, None
    for _ in range(24):
        duty = 0.5 * (low + high)
        quad.reset(HIGH, 0.0)
        for _ in range(60):
            state = quad.step([duty] * 4)
        low, high = (duty, high) if state.specific_force_mps2[2] < G else (low, duty)
    return duty, state.electrical_w


def test_hover_power_against_momentum_theory_and_the_energy_model():
    _, watts = hover_duty()
    thrust_n = MASS_KG * G
    ideal_w = thrust_n**1.5 / math.sqrt(2.0 * AIR_KGPM3 * DISK_M2)
    shaft_w = ideal_w / FIGURE_OF_MERIT
    # Motor and controller losses come on top of the shaft: 0.05 Ohm, 0.6 A no-load and 3 %, 10 to 30 %.
    assert 1.10 < watts / shaft_w < 1.30
    # The energy model's figure is rounded, and the climb out of the first steps adds a few watts: 5 %.
    assert watts == pytest.approx(CONFIG.energy.air_w, rel=0.05)


def test_free_fall_conserves_energy():
    quad = Quad()
    quad.reset(HIGH, 0.0)
    for _ in range(round(0.5 / STEP_S)):
        state = quad.step([0.0] * 4)
    fell_m = HIGH[2] - state.position_m[2]
    kinetic, potential = 0.5 * float(state.velocity_mps @ state.velocity_mps), G * fell_m
    # Drag takes rho A v^4 / (8 m g) a kilogramme, 0.9 % of it here; the windmilling rotors add to it.
    drag = AIR_KGPM3 * DRAG_M2 * float(np.linalg.norm(state.velocity_mps)) ** 4 / (8.0 * MASS_KG * G)
    assert kinetic + drag == pytest.approx(potential, rel=0.02)
    # Over the first 0.1 s drag is below 0.05 %: the integrator itself keeps 0.5 % with its half step.
    quad.reset(HIGH, 0.0)
    for _ in range(25):
        state = quad.step([0.0] * 4)
    t = 25 * STEP_S
    assert state.velocity_mps[2] == pytest.approx(-G * t, rel=0.005)


def test_hovering_draws_from_the_pack_what_the_controllers_take():
    plant = plant_on(flat(), disturbances=Disturbances.none())
    duty, asked_j, rotors_j = 0.55, 0.0, 0.0
    start = plant.battery.remaining
    for _ in range(500):
        plant.step(np.full(4, duty), BRAKED)
        rotors_j += plant.state.electrical_w * STEP_S
        asked_j += (plant.state.electrical_w + plant.rover.state.watts) * STEP_S
    used = plant.battery
    # Sums of the same figures: rounding only, 1e-6 of 1.2 kJ.
    assert used.used_by_j["rotors"] == pytest.approx(rotors_j, rel=1e-6)
    assert used.used_j == pytest.approx(asked_j, rel=1e-6)
    assert (start - used.remaining) * used.pack_j == pytest.approx(used.used_j + used.heat_j, rel=1e-6)
    assert used.heat_j == 0.0  # no resistance in this pack
    assert rotors_j > 500.0


def test_the_battery_sags_by_ohms_law():
    for ohm in (0.01, 0.05):
        battery = Battery(resistance_ohm=ohm)
        battery.draw("rotors", 600.0)
        for _ in range(500):  # 2 s, forty settling times
            battery.step(STEP_S)
        e = battery.open_circuit_v
        # A load of constant power: V (E - V) / R = P. 1 mV: the charge falls by 0.2 % meanwhile.
        volts = 0.5 * (e + math.sqrt(e * e - 4.0 * ohm * 600.0))
        assert battery.volts == pytest.approx(volts, abs=2e-3)
        assert battery.heat_j == pytest.approx(battery.current_a**2 * ohm * 2.0, rel=0.05)


def test_charge_and_resistance_reach_the_plants_battery():
    given = replace(NO_SLIP, battery=Pack(resistance_ohm=0.04, charge=0.3))
    battery = plant_on(flat(), disturbances=given).battery
    assert (battery.remaining, battery.resistance_ohm) == (0.3, 0.04)


def _level_thrust(quad, duty, duration_s):
    """Velocities of a quad that only holds its attitude level, so that the wind alone moves it."""
    out, state = [], quad.state
    for _ in range(round(duration_s / STEP_S)):
        roll, pitch = roll_pitch_of(state.quaternion)
        p, q, r = state.angular_velocity_rps
        a, b, c = -0.3 * roll - 0.06 * p, -0.3 * pitch - 0.06 * q, -0.1 * r
        state = quad.step([duty - a - b - c, duty + a + b - c, duty + a - b + c, duty - a + b + c])
        out.append(state.velocity_mps)
    return np.array(out)


def test_a_level_quad_drifts_towards_the_speed_of_the_wind():
    wind = 4.0
    duty, _ = hover_duty()
    quad = Quad()
    quad.set_volts(18.5)
    quad.set_wind(np.array([wind, 0.0, 0.0]))
    quad.reset(HIGH, 0.0)
    v = _level_thrust(quad, duty, 20.0)
    # Drag alone: dv/dt = k (w - v)^2 with k = rho A / 2m, so v(t) = w - w / (1 + k w t). A level rotor adds
    # no drag of its own in this model, but climbing adds airspeed: 15 %.
    k = 0.5 * AIR_KGPM3 * DRAG_M2 / MASS_KG
    expected = wind - wind / (1.0 + k * wind * 20.0)
    assert v[-1, 0] == pytest.approx(expected, rel=0.15)
    assert (np.diff(v[::250, 0]) > 0.0).all()
    assert v[-1, 0] < wind
    assert np.abs(v[:, 1]).max() < 0.05


def test_wind_reaches_the_flying_robot_only():
    windy = replace(NO_SLIP, wind=Wind(mean_mps=8.0, direction_rad=0.0))
    moved = []
    for disturbances in (windy, NO_SLIP):
        plant = plant_on(flat(), disturbances=disturbances, x=0.0)
        for _ in range(250):
            plant.step(None, BRAKED)
        assert plant.state.position_m[0] == 0.0  # on its wheels it stands
        for _ in range(300):
            plant.step(np.full(4, 0.6), BRAKED)
        moved.append(plant.state.position_m[0])
    assert moved[0] - moved[1] > 0.05


def test_gusts_have_their_spread_their_memory_and_their_seed():
    model = Wind(mean_mps=1.0, gust_mps=0.8, direction_rad=math.pi / 2, time_constant_s=2.0)
    field = WindField(model, 5)
    air = np.array([field.step(0.04) for _ in range(50_000)])  # 2000 s, a thousand time constants
    # Standard error of the mean 0.8 * sqrt(2 * 2 / 2000) = 0.036 (3 sigma), of the spread about 2.5 %.
    assert air.mean(axis=0) == pytest.approx([0.0, 1.0, 0.0], abs=0.11)
    assert air.std(axis=0) == pytest.approx([0.8, 0.8, 0.8 / 1.96], rel=0.08)
    gust = air[:, 0] - air[:, 0].mean()
    lagged = float((gust[:-50] * gust[50:]).mean() / gust.var())
    assert lagged == pytest.approx(math.exp(-1.0), abs=0.08)  # one time constant later
    assert (WindField(model, 5).step(0.04) == WindField(model, 5).step(0.04)).all()
    assert (WindField(model, 5).step(0.04) != WindField(model, 6).step(0.04)).any()


@pytest.mark.parametrize("lag_s", [0.05, 0.1])
def test_rotor_lag_is_the_time_constant_asked_for(lag_s):
    given = replace(NO_SLIP, actuators=Actuators(rotor_lag_s=lag_s))
    plant = plant_on(flat(), disturbances=given)
    node = plant.quad._node("esc/cmd-norm[0]")
    duty = []
    for _ in range(round(5.0 * lag_s / STEP_S)):
        plant.step(np.full(4, 0.4), BRAKED)
        duty.append(node.get_double_value())
    reached = next(i for i, d in enumerate(duty) if d >= 0.4 * (1.0 - math.exp(-1.0)) - 1e-9)
    assert (reached + 1) * STEP_S == pytest.approx(lag_s, abs=STEP_S)  # sampled at one step
    assert duty[-1] == pytest.approx(0.4 * (1.0 - math.exp(-5.0)), rel=0.01)
