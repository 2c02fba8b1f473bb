"""Slip, wheel lag, joules of driving, and that a seed is a run."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from physics_rig import BRAKED, NO_SLIP, drive, flat, plant_on, ramp

from firmware_bridge.parameters import TICKS_PER_M
from labr_autonomy.estimation.filter import PoseFilter
from labr_autonomy.types import ImuSample, Pose, WheelOdometry
from sim.disturbances import Actuators, Disturbances
from sim.plant import STEP_S, WheelDrive
from sim.rover import Slip
from sim.vio import VioStandIn


def test_slip_shortens_the_way_by_the_drawn_share():
    given = replace(NO_SLIP, slip=Slip(0.02, 0.06, 0.0, 0.0, 0.0))
    plant = plant_on(flat(), x=0.0, disturbances=given)
    left, right = plant.rover.steady_slip
    assert 0.02 <= min(left, right) < max(left, right) <= 0.06
    lengths = [0.0]

    def add(p):
        lengths[0] += float(np.hypot(*p.state.velocity_mps[:2])) * STEP_S

    drive(plant, 0.5, 0.5, 5.0, each=add)
    wheel_m = plant.rover.state.left_ticks / TICKS_PER_M
    # 1e-3: encoder ticks of 0.25 mm and the trapezium of the first steps, over 2.4 m.
    assert lengths[0] == pytest.approx(wheel_m * (1.0 - 0.5 * (left + right)), rel=1e-3)


@pytest.mark.parametrize("tau_s", [0.08, 0.2])
def test_wheel_motors_have_the_time_constant_asked_for(tau_s):
    given = replace(NO_SLIP, actuators=Actuators(wheel_tau_s=tau_s))
    plant, speeds = plant_on(flat(), x=0.0, disturbances=given), []
    drive(plant, 0.1, 0.1, 5 * tau_s, each=lambda p: speeds.append(p.rover.state.v_mps))
    reached = next(i for i, v in enumerate(speeds) if v >= 0.1 * (1.0 - math.exp(-1.0)) - 1e-9)
    assert (reached + 1) * STEP_S == pytest.approx(tau_s, abs=STEP_S)  # sampled at one step


def test_the_joules_of_driving_are_the_integral_of_the_power():
    plant, joules = plant_on(ramp(0.10), x=-0.5), [0.0]

    def add(p):
        joules[0] += p.rover.state.watts * STEP_S

    drive(plant, 0.5, 0.55, 4.0, each=add)
    assert plant.battery.used_by_j["wheels"] == pytest.approx(joules[0], rel=1e-6)  # the same sum, rounded
    spent = (1.0 - plant.battery.remaining) * plant.battery.pack_j
    assert spent == pytest.approx(joules[0] + plant.battery.heat_j, rel=1e-6)


def _run(seed, disturbances):
    plant = plant_on(ramp(0.08), x=-0.5, seed=seed, disturbances=disturbances)
    track = []
    for i in range(900):
        flies = 400 <= i < 800
        plant.step(np.full(4, 0.6) if flies else None, BRAKED if flies else WheelDrive(0.5, 0.5, False))
        track.append(np.concatenate([plant.state.position_m, plant.state.quaternion]))
    return np.array(track), plant.battery.used_j


def test_the_same_seed_is_the_same_run_bit_for_bit_and_another_is_another():
    weather = Disturbances.for_family("forest")
    first, used = _run(3, weather)
    again, used_again = _run(3, weather)
    other, _ = _run(4, weather)
    assert first.tobytes() == again.tobytes()
    assert used == used_again
    assert first.tobytes() != other.tobytes()
    assert np.abs(first[390] - other[390]).max() > 0.0  # by slip before it flies
    calm, _ = _run(3, Disturbances())
    assert first[:400].tobytes() == calm[:400].tobytes()  # wind has no part in driving
    assert np.abs(first[799] - calm[799]).max() > 1e-3


def test_without_disturbances_it_drives_straight_at_the_wheels_speed():
    plant = plant_on(flat(), x=0.0, disturbances=Disturbances.none())
    drive(plant, 0.5, 0.5, 2.0)
    assert plant.state.velocity_mps == pytest.approx([0.5, 0.0, 0.0], abs=1e-6)
    assert plant.state.position_m[1] == pytest.approx(0.1, abs=1e-12)


def test_the_estimate_keeps_to_the_ground_over_a_ramp():
    """VIO, IMU and wheels of a drive over a 10 % ramp: nothing is gated, and the height comes along."""
    plant, pose_filter = plant_on(ramp(0.10), x=-2.0, disturbances=Disturbances()), PoseFilter()
    vio, worst, pitch_error = VioStandIn(7), 0.0, 0.0
    ticks = plant.rover.state.left_ticks, plant.rover.state.right_ticks
    for i in range(round(10.0 / STEP_S)):
        now_s = 10.0 + i * STEP_S
        state = plant.step(None, WheelDrive(0.6, 0.6, False) if i > 250 else BRAKED)
        if i % 5 == 0:
            pose_filter.add_imu(ImuSample(now_s, state.specific_force_mps2, state.angular_velocity_rps))
            new = plant.rover.state.left_ticks, plant.rover.state.right_ticks
            way = 0.5 * (new[0] - ticks[0] + new[1] - ticks[1]) / TICKS_PER_M
            turn = (new[1] - ticks[1] - new[0] + ticks[0]) / TICKS_PER_M / 0.30
            ticks = new
            pose_filter.add_wheels(WheelOdometry(now_s, way / 0.02, turn / 0.02, *new), on_ground=True)
        if i % 8 == 0:
            vio.feed(now_s, Pose(state.position_m, state.quaternion), state.velocity_mps)
        for sample in vio.due(now_s):
            pose_filter.add_vio(sample)
        estimate = pose_filter.odometry()
        if estimate is not None and i % 5 == 0 and i > 500:
            worst = max(worst, float(np.abs(estimate.pose.position_m - state.position_m).max()))
            pitch_error = max(
                pitch_error, abs(float(estimate.pose.quaternion[2] - state.quaternion[2])) * 2.0
            )
    assert plant.state.position_m[2] > 0.4
    assert dict(pose_filter.refused) == {}
    # Drift of 0.5 % of 5 m is 2.5 cm rms, in an unlucky direction three times that.
    assert worst < 0.08
    assert pitch_error < math.radians(1.0)


@pytest.mark.parametrize("braked", [True, False])
@pytest.mark.parametrize("speed", [0.3, 0.8])
def test_the_imu_of_a_robot_that_has_stopped_feels_gravity_alone(speed, braked):
    """All that it felt along the way sums to the change of speed, and nothing is left once it stands."""
    plant, felt = plant_on(flat(), x=0.0), [0.0]

    def add(p):
        felt[0] += float(p.state.specific_force_mps2[0]) * STEP_S

    drive(plant, speed, speed, 2.0, each=add)
    assert felt[0] == pytest.approx(plant.state.velocity_mps[0], abs=1e-9)
    drive(plant, 0.0, 0.0, 4.0, braked=braked, each=add)
    assert plant.state.velocity_mps == pytest.approx(np.zeros(3), abs=1e-9)
    assert felt[0] == pytest.approx(0.0, abs=1e-9)
    assert plant.state.specific_force_mps2 == pytest.approx([0.0, 0.0, 9.80665], abs=1e-9)
