"""Vision frames, the estimate in the vision's frame, time-outs, jumps, clocks."""

import math

import numpy as np
import pytest
from autopilot_rig import Rig, parked, vision_message

from sim.autopilot.estimator import TIMEOUT_S, Estimator, Truth, VisionPose
from sim.autopilot.vectors import UNKNOWN, ZERO, from_angles, ned_attitude, turn
from sim.autopilot.vision import ClockOffset, pose_of_odometry

STEP = 0.004


def truth(t, position=(0.0, 0.0, -1.0), velocity=ZERO, yaw=0.0):
    return Truth(t, position, velocity, from_angles(0.0, 0.0, yaw), ZERO)


def run(estimator, seconds, *, start=0.0, pose=None, path=lambda t: (0.0, 0.0, -1.0), velocity=ZERO, yaw=0.0):
    """Feed truth at 250 Hz and poses at 30 Hz; `pose` makes a VisionPose of (t, true position)."""
    for k in range(round(seconds / STEP)):
        t = start + k * STEP
        estimate = estimator.step(truth(t, path(t), velocity, yaw))
        if pose is not None and k % 8 == 0:
            estimator.fuse(pose(t, path(t)))
    return estimate


def shifted(offset, velocity_error=ZERO, yaw=0.0):
    def pose(t, position):
        at = tuple(p + o for p, o in zip(turn(position, yaw), offset, strict=True))
        return VisionPose(t, at, velocity_error, yaw)

    return pose


def test_without_vision_there_is_no_position_but_an_origin():
    estimate = run(Estimator(), 2.0)
    assert (estimate.position_valid, estimate.velocity_valid) == (False, False)
    assert estimate.position_m == ZERO


def test_the_local_frame_is_the_visions_frame():
    estimate = run(Estimator(), 3.0, pose=shifted((5.0, -2.0, 0.3), yaw=0.8))
    assert estimate.position_m == pytest.approx((5.0, -2.0, -0.7), abs=1e-6)
    assert estimate.yaw_rad == pytest.approx(0.8)


def test_a_drifting_vision_drags_the_estimate_along_smoothly():
    estimator = Estimator()
    run(estimator, 2.0, pose=shifted(ZERO))
    before = estimator.step(truth(2.0))
    for k in range(250):
        t = 2.0 + k * STEP
        after = estimator.step(truth(t))
        if k % 8 == 0:
            estimator.fuse(VisionPose(t, (0.5, 0.0, -1.0), ZERO, 0.0))
        assert abs(after.position_m[0] - before.position_m[0]) < 0.08
        before = after
    assert after.position_m[0] == pytest.approx(0.5, abs=0.02)


def test_positions_time_out():
    estimator = Estimator()
    run(estimator, 1.0, pose=shifted(ZERO))
    assert run(estimator, TIMEOUT_S - 0.2, start=1.0).position_valid
    late = run(estimator, 0.5, start=1.0 + TIMEOUT_S - 0.2)
    assert (late.position_valid, late.velocity_valid) == (False, False)
    assert not math.isfinite(late.position_m[0])


def test_between_samples_it_dead_reckons_with_the_last_velocity_error():
    estimator = Estimator()
    run(estimator, 2.0, pose=shifted(ZERO, velocity_error=(0.1, 0.0, 0.0)))
    at_loss = estimator.step(truth(2.0)).position_m[0]
    gone = run(estimator, 2.2, start=2.0).position_m[0]
    assert gone - at_loss == pytest.approx(0.1 * 2.0, abs=0.03)


def test_a_jump_is_refused_for_a_second_and_then_believed():
    estimator = Estimator()
    run(estimator, 1.0, pose=shifted(ZERO))
    assert run(estimator, 0.8, start=1.0, pose=shifted((3.0, 0.0, 0.0))).position_m[0] == pytest.approx(
        0.0, abs=0.01
    )
    assert run(estimator, 0.5, start=1.8, pose=shifted((3.0, 0.0, 0.0))).position_m[0] == pytest.approx(
        3.0, abs=0.01
    )
    assert (estimator.resets, estimator.counts["jump"] > 20) == (1, True)


def test_a_late_pose_is_compared_with_the_truth_of_its_own_time():
    estimator = Estimator()
    for k in range(500):
        t = k * STEP
        estimate = estimator.step(truth(t, (2.0 * t, 0.0, -1.0), (2.0, 0.0, 0.0)))
        if k % 8 == 0 and t > 0.1:
            estimator.fuse(VisionPose(t - 0.06, (2.0 * (t - 0.06), 0.0, -1.0), (2.0, 0.0, 0.0), 0.0))
    assert estimate.position_m[0] == pytest.approx(2.0 * 499 * STEP, abs=0.01)


@pytest.mark.parametrize(
    ("frame", "position", "counted"),
    [
        (20, True, "position"),
        (1, True, "position"),
        (14, False, "velocity only"),
        (21, False, None),
        (8, False, None),
    ],
)
def test_only_local_ned_and_local_frd_give_a_position(frame, position, counted):
    rig = Rig(flying_body=False)
    rig.vision_frame = frame
    rig.run(1.0)
    assert rig.vehicle.estimate.position_valid is position
    assert rig.vehicle.estimate.velocity_valid is (counted is not None)
    assert set(rig.vehicle.estimator.counts) == ({counted} if counted else set())
    x = rig.messages("LOCAL_POSITION_NED")[-1][1].x
    assert math.isnan(x) is (frame == 14)


def test_velocity_in_the_body_is_turned_into_the_local_frame():
    state = parked(yaw_rad=0.0)  # looks east
    moving = type(state)(
        **{f: getattr(state, f) for f in state.__slots__} | {"velocity_mps": np.array([0.5, 0.0, 0.0])}
    )
    pose = pose_of_odometry(vision_message(moving, 0), 1.0)
    assert pose.velocity_mps == pytest.approx((0.0, 0.5, 0.0), abs=1e-9)
    assert pose.yaw_rad == pytest.approx(math.pi / 2)


def test_a_broken_quaternion_is_ignored():
    message = vision_message(parked(), 0)
    message.q = [0.0, 0.0, 0.0, 0.0]
    assert pose_of_odometry(message, 0.0) is None
    message.q = [math.nan, 0.0, 0.0, 0.0]
    assert pose_of_odometry(message, 0.0) is None


def test_stamps_are_translated_by_timesync_and_nonsense_counts_as_now():
    offset = ClockOffset()
    assert offset.local_s(5_000_000, 5.03) == pytest.approx(5.0)
    assert offset.local_s(1_700_000_000_000_000, 5.03) == 5.03
    offset.answer(theirs_ns=1_000_000_000_000, sent_ns=5_000_000_000, now_s=5.01)
    assert offset.local_s(1_000_000_000, 5.03) == pytest.approx(5.005)
    offset.answer(theirs_ns=77_000_000_000, sent_ns=5_000_000_000, now_s=5.01)  # the program's other clock
    assert offset.local_s(1_000_000_000, 5.03) == pytest.approx(5.005)
    assert offset.local_s(77_000_000, 5.03) == pytest.approx(5.005)
    offset.answer(theirs_ns=0, sent_ns=1_000_000_000, now_s=5.0)  # an answer to a question long past
    assert offset.local_s(1_000_000_000, 5.03) == pytest.approx(5.005)


def test_the_fast_attitude_conversion_equals_the_shared_one():
    from labr_autonomy.frames import quaternion_enu_flu_to_ned_frd, quaternion_from_rpy

    for angles in [(0.1, -0.2, 0.3), (0.0, 0.0, 2.5), (-0.4, 0.2, -2.9)]:
        q = quaternion_from_rpy(*angles)
        assert ned_attitude(*(float(v) for v in q)) == pytest.approx(tuple(quaternion_enu_flu_to_ned_frd(q)))


def test_no_vision_no_estimate_before_the_first_tick():
    assert Estimator().fuse(VisionPose(0.0, ZERO, UNKNOWN, 0.0)) is False
