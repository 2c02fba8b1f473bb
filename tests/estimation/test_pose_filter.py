from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from motion import EXACT, Drive, Flight, Run, imu, velocity, vio
from scipy.stats import chi2

from labr_autonomy.errors import LabrError
from labr_autonomy.estimation import filter as filter_module
from labr_autonomy.estimation.filter import PoseFilter
from labr_autonomy.frames import quaternion_from_rpy, yaw_of
from labr_autonomy.types import ImuSample, WheelOdometry


def position_error_m(run):
    return float(np.linalg.norm(run.error()[:3]))


@pytest.mark.parametrize(("motion", "wheels"), [(Flight(), False), (Drive(), True)])
@pytest.mark.parametrize("delay_s", [0.0, 0.03, 0.25])
def test_with_ideal_sensors_the_estimate_is_exact_however_late_vio_is(motion, wheels, delay_s):
    run = Run(motion, wheels=wheels, vio_delay_s=delay_s)
    run.play(3.0)
    assert np.abs(run.error()).max() < 2e-3
    assert not run.filter.refused


@pytest.mark.slow
@pytest.mark.parametrize(("motion", "wheels"), [(Flight(), False), (Drive(), True)])
def test_errors_are_as_large_as_the_covariance_says(motion, wheels):
    runs = [Run(motion, wheels=wheels, seed=seed) for seed in range(20)]
    for end_s in (2.5, 5.0):
        nees, position = 0.0, 0.0
        for run in runs:
            run.play(end_s)
            e, c = run.error(), run.filter.state.covariance
            nees += e @ np.linalg.solve(c, e)
            position += e[:3] @ np.linalg.solve(c[:3, :3], e[:3])
        for total, freedom in ((nees, 15 * len(runs)), (position, 3 * len(runs))):
            assert chi2.ppf(0.001, freedom) < total < chi2.ppf(0.999, freedom)
    assert not any(run.filter.refused for run in runs)


@pytest.mark.slow
def test_a_delay_that_is_not_compensated_would_show():
    late = Run(Flight(), seed=1, vio_delay_s=0.25)
    late.play(4.0)
    naive = Run(Flight(), seed=1, vio_delay_s=0.25)
    naive.vio_of = lambda t, s: dataclasses.replace(s, stamp_s=t + 0.25)
    naive.play(4.0)
    assert position_error_m(late) < 0.02
    assert position_error_m(naive) > 0.08


@pytest.mark.parametrize("jitter_s", [0.0, 0.004])
def test_imu_stamps_may_jitter_and_pause(jitter_s):
    run = Run(Flight(), seed=2, imu_jitter_s=jitter_s, imu_gap_s=(1.5, 1.75))
    worst = 0.0

    def watch(arrival_s, kind):
        nonlocal worst
        worst = max(worst, position_error_m(run)) if arrival_s > 1.0 else 0.0

    run.play(3.0, watch)
    assert run.filter.refused["vio_gate"] == 0
    assert worst < 0.05
    assert position_error_m(run) < 0.02


def test_without_any_imu_vio_still_carries():
    motion, f = Flight(), PoseFilter()
    for k in range(90):
        assert f.add_vio(vio(motion, k / 30))
    o = f.odometry()
    assert np.linalg.norm(o.pose.position_m - motion.position(89 / 30)) < 0.02


def jump(t, sample):
    return (
        dataclasses.replace(sample, position_m=sample.position_m + np.array([1.0, 0, 0]))
        if t >= 2.0
        else sample
    )


def test_a_jump_of_vio_is_refused_and_counted():
    run = Run(Drive(), seed=3, wheels=True, vio_of=jump)
    run.play(2.5)
    assert position_error_m(run) < 0.05
    assert run.filter.vio_rejected_in_a_row == 15
    assert run.filter.refused["vio_gate"] == 15
    assert run.filter.ages(2.5)["vio_accepted"] > 0.5
    assert run.filter.ages(2.5)["vio"] < 0.1


def test_without_the_gate_the_jump_would_get_through(monkeypatch):
    monkeypatch.setattr(filter_module, "GATE_VIO", math.inf)
    run = Run(Drive(), seed=3, wheels=True, vio_of=jump)
    run.play(2.5)
    assert position_error_m(run) > 0.5


def test_counts_start_over_when_vio_comes_back():
    run = Run(Drive(), wheels=True, seed=4)
    run.vio_of = lambda t, s: jump(t, s) if t < 2.3 else s
    run.play(3.0)
    assert run.filter.vio_rejected_in_a_row == 0
    assert position_error_m(run) < 0.02


def test_a_frozen_vio_is_distrusted_within_half_a_second_of_driving():
    run = Run(Drive(0.6), wheels=True, seed=5)
    frozen = vio(run.motion, 2.0)
    run.vio_of = lambda t, s: dataclasses.replace(frozen, stamp_s=t) if t >= 2.0 else s
    run.play(2.5)
    assert run.filter.vio_rejected_in_a_row >= 8
    assert position_error_m(run) < 0.1


def test_spinning_wheels_are_refused():
    run = Run(Drive(), wheels=True, seed=6)
    run.wheels_of = lambda t, v: 3.0 * v if t >= 2.0 else v
    run.play(3.0)
    assert run.filter.wheels_rejected_in_a_row > 40
    assert position_error_m(run) < 0.03


def test_without_the_slip_gate_spinning_wheels_would_hurt(monkeypatch):
    monkeypatch.setattr(filter_module, "GATE_WHEEL_SPEED", math.inf)
    run = Run(Drive(), wheels=True, seed=6)
    run.wheels_of = lambda t, v: 3.0 * v if t >= 2.0 else v
    run.play(3.0)
    assert np.linalg.norm(run.error()[3:6]) > 0.2


def test_sliding_sideways_is_refused_but_the_speed_is_kept():
    """A robot pushed sideways at 0.5 m/s, which VIO sees and the wheels cannot."""
    run = Run(Drive(), wheels=True, seed=7)
    run.play(1.0)
    f, motion = run.filter, run.motion
    side = np.array(
        [-math.sin(yaw_of(motion.quaternion(1.0))), math.cos(yaw_of(motion.quaternion(1.0))), 0.0]
    )
    before = f.state
    moved = dataclasses.replace(before, velocity_mps=before.velocity_mps + 0.5 * side)
    f._nodes[-1].state = moved  # the state as after a fast push
    f.add_wheels(WheelOdometry(f.odometry().stamp_s + 0.001, motion.speed(1.0), 0.0, 0, 0), True)
    assert f.refused == {"wheel_side": 1}
    assert np.linalg.norm(f.state.velocity_mps - moved.velocity_mps) < 0.05


@pytest.mark.parametrize(("wheels", "limit_m"), [(True, 0.06), (False, 0.3)])
def test_one_second_without_vio(wheels, limit_m):
    errors = []
    for seed in range(4):
        run = Run(Drive(), wheels=wheels, seed=seed, vio_off_s=(3.0, 9.0))
        run.play(4.0)
        errors.append(position_error_m(run))
        assert run.filter.ages(4.0)["vio"] == pytest.approx(1.0, abs=0.05)
    assert max(errors) < limit_m


def test_wheels_are_not_used_in_the_air():
    run = Run(Flight(), seed=8)
    run.play(1.5)
    before = run.filter.state
    assert not run.filter.add_wheels(WheelOdometry(1.49, 0.0, 0.0, 0, 0), False)
    assert run.filter.state is before


def test_nothing_before_the_first_vio_sample():
    f = PoseFilter()
    assert f.odometry() is None
    assert f.predicted(1.0) is None
    assert f.at(1.0) is None
    assert f.ages(1.0) == dict.fromkeys(("imu", "vio", "vio_accepted", "wheels"), math.inf)
    assert not f.add_imu(imu(Flight(), 0.5))
    with pytest.raises(LabrError, match="no pose yet"):
        _ = f.state


def test_a_start_whose_up_contradicts_gravity_is_refused():
    f, motion = PoseFilter(), Drive()
    for k in range(12):
        f.add_imu(ImuSample(0.02 * k - 0.25, np.array([0, 0, 9.8]), np.zeros(3)))
    tilted = dataclasses.replace(vio(motion, 0.0), quaternion=quaternion_from_rpy(0.3, 0.0, 0.0))
    assert not f.add_vio(tilted)
    assert f.refused == {"vio_tilt": 1}
    assert f.add_vio(vio(motion, 0.1))
    assert f.ready


def test_one_noisy_reading_does_not_refuse_the_start():
    f, motion = PoseFilter(), Drive()
    f.add_imu(ImuSample(-0.01, np.array([1.5, 0, 9.6]), np.zeros(3)))
    assert f.add_vio(vio(motion, 0.0))


def test_history_interpolates_and_ends():
    run = Run(Flight(), wheels=False)
    run.play(3.0)
    f, motion = run.filter, run.motion
    newest = f.odometry().stamp_s
    for t in np.linspace(newest - 0.9, newest + 0.05, 40):
        o = f.at(float(t))
        assert o.stamp_s == pytest.approx(t)
        assert np.linalg.norm(o.pose.position_m - motion.position(t)) < 5e-3
        assert np.linalg.norm(o.velocity_mps - velocity(motion, t)) < 0.06
        assert abs(yaw_of(o.pose.quaternion) - yaw_of(motion.quaternion(t))) < 5e-3
    assert f.at(newest - 2.0) is None
    assert f.at(newest + 0.2) is None


def test_prediction_is_limited_to_a_tenth_of_a_second():
    run = Run(Flight())
    run.play(2.0)
    o = run.filter.odometry()
    near, far = run.filter.predicted(o.stamp_s + 0.05), run.filter.predicted(o.stamp_s + 5.0)
    assert np.allclose(near.pose.position_m, o.pose.position_m + 0.05 * o.velocity_mps)
    assert far.stamp_s == pytest.approx(o.stamp_s + 0.1)
    assert run.filter.predicted(o.stamp_s - 1.0).stamp_s == o.stamp_s
    assert abs(np.linalg.norm(far.pose.quaternion) - 1.0) < 1e-9


def test_unusable_measurements_are_counted():
    run = Run(Drive(), wheels=True)
    run.play(1.0)
    f = run.filter
    assert not f.add_imu(ImuSample(2.0, np.array([math.nan, 0, 0]), np.zeros(3)))
    assert not f.add_imu(imu(run.motion, 0.5))
    assert not f.add_vio(vio(run.motion, 0.5))
    assert not f.add_wheels(WheelOdometry(2.0, math.nan, 0.0, 0, 0), True)
    assert f.refused == {"imu": 2, "vio": 1, "wheels": 1}
    stale = Run(Drive(), wheels=True, vio_delay_s=0.8)
    stale.play(2.0)
    assert stale.filter.refused["vio_late"] > 0


def test_reset_starts_anew():
    run = Run(Drive(), noise=EXACT)
    run.play(1.0)
    run.filter.reset()
    assert run.filter.odometry() is None
    assert run.filter.add_vio(vio(run.motion, 1.1, shift_m=(5.0, 0, 0)))
    assert run.filter.odometry().pose.position_m[0] > 4.0


def test_memory_is_bounded():
    run = Run(Drive(), wheels=True)
    run.play(6.0)
    assert len(run.filter._nodes) < 1.6 * 130 + 5
    assert len(run.filter._nodes) == len(run.filter._stamps)


def knocked(run, at_s=2.0, size_mps2=60.0):
    """A touchdown: one reading sees the few milliseconds of the impact."""
    ideal = run._imu

    def reading(t):
        sample = ideal(t)
        if abs(t - at_s) < 1e-6:
            sample = dataclasses.replace(
                sample, specific_force_mps2=sample.specific_force_mps2 + np.array([0, 0, size_mps2])
            )
        return sample

    run._imu = reading
    return run


def test_a_knock_between_two_readings_does_not_lose_vio():
    run = knocked(Run(Drive(), seed=8))
    worst = []
    run.play(3.0, lambda now, kind: worst.append(run.filter.vio_rejected_in_a_row))
    assert max(worst) <= 2
    assert position_error_m(run) < 0.05


def test_a_filter_that_believes_the_knock_loses_vio():
    deaf = dataclasses.replace(EXACT, smooth_mps2=math.inf)
    run = knocked(Run(Drive(), seed=8, noise=deaf))
    worst = []
    run.play(3.0, lambda now, kind: worst.append(run.filter.vio_rejected_in_a_row))
    assert max(worst) > 10


def test_a_vio_that_contradicts_long_and_steadily_is_right_in_the_end():
    run = Run(Drive(), seed=3, wheels=True, vio_of=jump)
    run.play(4.0)
    assert run.filter.restarts == 1
    assert run.filter.vio_rejected_in_a_row == 0
    assert run.filter.odometry().pose.position_m[0] - run.motion.position(4.0)[0] == pytest.approx(
        1.0, abs=0.1
    )


def test_a_frozen_vio_is_never_given_in_to():
    run = Run(Drive(0.6), wheels=True, seed=5)
    frozen = vio(run.motion, 2.0)
    run.vio_of = lambda t, s: dataclasses.replace(frozen, stamp_s=t) if t >= 2.0 else s
    run.play(5.0)
    assert run.filter.restarts == 0


def test_a_vio_that_denies_the_wheels_is_not_given_in_to():
    run = Run(Drive(0.6), wheels=True, seed=5)
    rng = np.random.default_rng(1)
    still = vio(run.motion, 2.0)

    def trembling(t, s):
        if t < 2.0:
            return s
        shaken = still.position_m + rng.normal(0, 0.002, 3)
        return dataclasses.replace(still, stamp_s=t, position_m=shaken, velocity_mps=np.zeros(3))

    run.vio_of = trembling
    run.play(5.0)
    assert run.filter.restarts == 0
