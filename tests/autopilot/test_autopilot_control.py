"""Set-points, the mixer, and the cascade flying the JSBSim quad faster than real time."""

import math

import numpy as np
import pytest
from autopilot_rig import Rig, setpoint_message
from hypothesis import given
from hypothesis import strategies as st

from labr_autonomy.frames import roll_pitch_of
from sim.autopilot.controller import (
    ARM_M,
    SPEED_DOWN_MPS,
    SPEED_UP_MPS,
    TORQUE_M,
    Target,
    mix,
    wanted_velocity,
)
from sim.autopilot.estimator import Estimate
from sim.autopilot.landing import CRAWL_MPS, SPEED_MPS, landing_target
from sim.autopilot.setpoint import target_of
from sim.autopilot.vectors import from_angles

NAN = math.nan
AT_REST = Estimate(position_m=(0.0, 0.0, -1.0), position_valid=True, velocity_valid=True)


def forces_of(duties, volts):
    """Thrust of each motor [N], by the inverse of the mixer's motor curve."""
    out = []
    for duty in duties:
        v = duty * volts
        root = (-3.182 + math.sqrt(3.182**2 + 4 * 0.1857 * v)) / (2 * 0.1857)
        out.append(root**2)
    return np.array(out)


@given(
    thrust=st.floats(20.0, 45.0),
    roll=st.floats(-0.3, 0.3),
    pitch=st.floats(-0.3, 0.3),
    yaw=st.floats(-0.05, 0.05),
    volts=st.floats(17.5, 21.0),
)
def test_the_mixer_gives_what_it_is_asked_for(thrust, roll, pitch, yaw, volts):
    f = forces_of(mix(thrust, (roll, pitch, yaw), volts), volts)
    assert f.sum() == pytest.approx(thrust, rel=0.01)
    assert ARM_M * (f[1] + f[2] - f[0] - f[3]) == pytest.approx(roll, abs=0.01)
    assert ARM_M * (f[0] + f[2] - f[1] - f[3]) == pytest.approx(pitch, abs=0.01)
    assert TORQUE_M * (f[0] + f[1] - f[2] - f[3]) == pytest.approx(yaw, abs=0.01)


@given(
    thrust=st.floats(0.0, 500.0),
    torque=st.tuples(*[st.floats(-50.0, 50.0)] * 3),
    volts=st.floats(0.0, 21.0),
)
def test_the_mixer_never_leaves_its_range(thrust, torque, volts):
    duties = mix(thrust, torque, volts)
    assert all(math.isfinite(d) and 0.0 <= d <= 1.0 for d in duties) or volts < 3.0


def test_tilting_goes_before_turning_when_the_motors_run_out():
    f = forces_of(mix(34.0, (0.9, 0.0, 2.0), 19.0), 19.0)
    assert ARM_M * (f[1] + f[2] - f[0] - f[3]) == pytest.approx(0.9, rel=0.05)


@pytest.mark.parametrize(
    ("target", "velocity"),
    [
        (Target((1.0, 0.0, -1.0)), (0.95, 0.0, 0.0)),
        (Target((1.0, 0.0, -1.0), (0.5, 0.1, 0.0)), (1.45, 0.1, 0.0)),
        (Target(velocity_mps=(0.3, -0.2, 0.1)), (0.3, -0.2, 0.1)),
        (Target((NAN, NAN, -9.0), (0.5, 0.0, NAN)), (0.5, 0.0, -SPEED_UP_MPS)),
        (Target((NAN, NAN, 9.0)), (NAN, NAN, SPEED_DOWN_MPS)),
    ],
)
def test_position_pulls_and_velocity_feeds_forward(target, velocity):
    assert wanted_velocity(AT_REST, target) == pytest.approx(velocity, nan_ok=True)


def test_the_type_mask_says_what_is_left_out():
    full = dict(n=1.0, e=2.0, d=-3.0, vn=0.1, ve=0.2, vd=0.3, an=0.4, ae=0.5, ad=0.6, yaw=0.7, rate=0.8)
    t = target_of(setpoint_message(0, **full), AT_REST)
    assert (t.position_m, t.velocity_mps, t.acceleration_mps2) == (
        (1.0, 2.0, -3.0),
        (0.1, 0.2, 0.3),
        (0.4, 0.5, 0.6),
    )
    assert (t.yaw_rad, t.yaw_rate_rps) == (0.7, 0.8)
    t = target_of(setpoint_message(2552, **full), AT_REST)
    assert t.position_m == (1.0, 2.0, -3.0)
    assert all(map(math.isnan, (*t.velocity_mps, *t.acceleration_mps2, t.yaw_rate_rps)))
    assert t.yaw_rad == 0.7
    t = target_of(setpoint_message(2503, **full), AT_REST)
    assert all(map(math.isnan, t.position_m))
    assert t.velocity_mps == (0.1, 0.2, 0.3)
    assert target_of(setpoint_message(0b111111111), AT_REST) is None
    assert target_of(setpoint_message(512), AT_REST) is None


def test_a_body_velocity_is_turned_by_the_heading():
    east = Estimate(attitude=from_angles(0.0, 0.0, math.pi / 2))
    message = setpoint_message(2503, vn=0.4)
    message.coordinate_frame = 8
    assert target_of(message, east).velocity_mps == pytest.approx((0.0, 0.4, 0.0), abs=1e-9)
    message.type_mask = 0
    assert target_of(message, east) is None
    message.coordinate_frame = 5
    assert target_of(message, east) is None


def test_land_mode_slows_down_before_the_ground():
    last = Target(velocity_mps=(0.0, 0.0, SPEED_MPS))
    high = landing_target(
        Estimate(position_m=(0.0, 0.0, -3.0), position_valid=True), (0.0, 0.0, -3.0), 0.0, last
    )
    low = landing_target(
        Estimate(position_m=(0.0, 0.0, -0.4), position_valid=True), (0.0, 0.0, -3.0), 0.0, last
    )
    assert (high.velocity_mps[2], low.velocity_mps[2]) == (SPEED_MPS, CRAWL_MPS)
    assert high.position_m[:2] == (0.0, 0.0)
    blind = landing_target(Estimate(), (0.0, 0.0, -3.0), 0.0, last)
    assert blind.velocity_mps == (0.0, 0.0, CRAWL_MPS)
    assert all(map(math.isnan, blind.position_m))


@pytest.fixture(scope="module")
def hovering():
    rig = Rig()
    rig.take_off(1.0)
    return rig


@pytest.mark.slow
def test_it_holds_a_hover_and_its_power(hovering):
    heights, watts = [], []

    def look(r):
        heights.append(r.truth.position_m[2])
        watts.append(r.truth.electrical_w)

    hovering.run(3.0, look)
    assert max(heights) - min(heights) < 0.03
    assert np.mean(heights) == pytest.approx(1.12, abs=0.05)
    assert 540.0 < np.mean(watts) < 640.0
    assert np.linalg.norm(hovering.truth.position_m[:2]) < 0.05


@pytest.mark.slow
def test_it_follows_a_step(hovering):
    hovering.fly_to(1.0, 0.0, -1.12)
    path, tilts = [], []

    def look(r):
        path.append(r.truth.position_m[1])  # north
        tilts.append(max(map(abs, roll_pitch_of(r.truth.quaternion))))

    hovering.run(6.0, look)
    rise = next(i for i, p in enumerate(path) if p > 0.9) * 0.004
    assert 0.8 < rise < 2.5
    assert max(path) < 1.25
    assert path[-1] == pytest.approx(1.0, abs=0.08)
    assert max(tilts) < math.radians(15.0)
    hovering.fly_to(0.0, 0.0, -1.12)
    hovering.run(6.0)


@pytest.mark.slow
def test_velocity_and_acceleration_ahead_take_the_lag_out_of_a_circle(hovering):
    """Position alone lags by about v/P; with its derivatives the same path is followed closely."""

    def error(mask):
        start = hovering.time_s

        def moving():
            a = 0.5 * (hovering.time_s - start)
            c, s = math.cos(a), math.sin(a)
            return setpoint_message(
                mask, c - 1.0, s, -1.12, -0.5 * s, 0.5 * c, 0.0, -0.25 * c, -0.25 * s, 0.0, yaw=0.0, rate=0.0
            )

        hovering.setpoint = moving
        hovering.run(3.0)
        worst = []

        def look(r):
            m = moving()
            worst.append(math.hypot(r.truth.position_m[1] - m.x, r.truth.position_m[0] - m.y))

        hovering.run(4.0, look)
        return float(np.mean(worst))

    lagging = error(0b100111111000)
    hovering.fly_to(0.0, 0.0, -1.12)
    hovering.run(5.0)
    ahead = error(0)
    hovering.fly_to(0.0, 0.0, -1.12)
    hovering.run(5.0)
    assert lagging > 0.3
    assert ahead < 0.12
    assert ahead < 0.35 * lagging


@pytest.mark.slow
def test_yaw_turns_at_its_rate_and_stops_on_target(hovering):
    hovering.setpoint = lambda: setpoint_message(0b100111111000, 0.0, 0.0, -1.12, yaw=1.2)
    hovering.run(4.0)
    assert hovering.vehicle.estimate.yaw_rad == pytest.approx(1.2, abs=0.05)
    hovering.setpoint = lambda: setpoint_message(0b010111111000, 0.0, 0.0, -1.12, rate=-0.5)
    hovering.run(2.0)
    rates = []
    hovering.run(1.0, lambda r: rates.append(-r.truth.angular_velocity_rps[2]))
    assert np.mean(rates) == pytest.approx(-0.5, abs=0.05)
    hovering.setpoint = lambda: setpoint_message(0b100111111000, 0.0, 0.0, -1.12, yaw=0.0)
    hovering.run(5.0)
    assert np.linalg.norm(hovering.truth.position_m[:2]) < 0.1
