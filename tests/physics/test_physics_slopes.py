"""Driving over terrain: pose, IMU, contacts, falls, power and grip."""

from __future__ import annotations

import math

import numpy as np
import pytest
from physics_rig import BRAKED, CONFIG, G, drive, drive_until, incline, plant_on, profile, ramp, sine_of

from labr_autonomy.config import Body
from labr_autonomy.frames import roll_pitch_of, rotation_matrix, yaw_of
from sim.plant import STEP_S, WheelDrive
from sim.referee import Referee
from sim.rover import BRAKE_MPS2, EFFICIENCY, FIXED_SHARE, TABLE_SPEED_MPS, Rover

BODY = Body()


@pytest.mark.parametrize(
    ("yaw", "roll", "pitch"), [(0.0, 0.0, -1.0), (math.pi, 0.0, 1.0), (math.pi / 2, -1.0, 0.0)]
)
def test_the_body_stands_as_the_slope_lies(yaw, roll, pitch):
    plant = plant_on(incline(0.15), x=0.5, yaw=yaw)
    angle = math.atan(0.15)
    # 1e-3 rad: rays are float32, and wheels are 0.2 m apart.
    assert roll_pitch_of(plant.state.quaternion) == pytest.approx((roll * angle, pitch * angle), abs=1e-3)
    assert yaw_of(plant.state.quaternion) == pytest.approx(yaw, abs=1e-9)
    up = rotation_matrix(plant.state.quaternion)[:, 2]
    foot = plant.state.position_m - BODY.below_m * up
    assert foot[2] == pytest.approx(0.15 * foot[0], abs=1e-4)
    # At rest the accelerometer feels gravity against the tilted body.
    felt = rotation_matrix(plant.state.quaternion) @ plant.state.specific_force_mps2
    assert felt == pytest.approx([0.0, 0.0, G], abs=1e-9)
    before = plant.state.position_m.copy()
    drive(plant, 0.0, 0.0, 2.0)  # targets of zero hold it as the brakes do
    assert (plant.state.position_m == before).all()
    drive(plant, 0.0, 0.0, 2.0, braked=True)
    assert (plant.state.position_m == before).all()


def test_speed_is_along_the_slope_and_the_imu_agrees_with_the_motion():
    plant = plant_on(ramp(0.10), x=-1.0)
    velocity, attitude = plant.state.velocity_mps, rotation_matrix(plant.state.quaternion)
    speeds, turned, largest = [], np.zeros(3), 0.0

    def feel(p):
        nonlocal velocity, attitude, largest, turned
        r = rotation_matrix(p.state.quaternion)
        acceleration = r @ p.state.specific_force_mps2 - [0.0, 0.0, G]
        velocity = velocity + acceleration * STEP_S
        turned = turned + p.state.angular_velocity_rps * STEP_S
        largest = max(largest, float(np.abs(p.state.velocity_mps - velocity).max()))
        if 1.0 < p.state.position_m[0] < 3.0:
            speeds.append(r.T @ p.state.velocity_mps)

    drive_until(plant, 0.6, 3.0, each=feel)
    assert largest < 1e-6  # integrating the accelerometer gives the velocity: only rounding is between
    assert turned[1] == pytest.approx(-math.atan(0.10), abs=1e-3)  # and the gyroscope the pitch
    forward, left, up = np.array(speeds).T
    assert forward == pytest.approx(0.6, abs=2e-3)  # motor's speed, float32 of the rays
    assert np.abs(left).max() < 1e-6
    assert np.abs(up).max() < 5e-3


@pytest.mark.parametrize("rise", [0.05, 0.10, 0.15])
def test_a_ramp_is_no_contact_up_over_and_down(rise):
    plant, referee = plant_on(ramp(rise), x=-1.0), Referee()
    heights = []

    def watch(p):
        referee.watch(0.0, p)
        heights.append(p.state.position_m[2])

    drive_until(plant, 0.6, 5.0, each=watch)
    assert plant.state.position_m[2] == pytest.approx(4.0 * rise + BODY.below_m, abs=1e-3)
    assert np.abs(np.diff(heights)).max() < 0.6 * STEP_S * rise * 1.5 + 1e-4  # no stairs
    plant._chassis.yaw_rad = math.pi  # back down
    for _ in range(round(11.0 / STEP_S)):
        plant.step(None, WheelDrive(0.6, 0.6, False))
        watch(plant)
    assert plant.state.position_m[0] < -0.5
    assert referee.contacts == 0
    assert plant.falls == 0


def test_a_kerb_is_a_contact_and_a_threshold_is_driven_over():
    for height, counted in ((0.05, 1), (0.03, 0)):
        plant, referee = plant_on(profile([(-4, 0), (0, 0), (0, height), (4, height)]), x=-1.0), Referee()
        drive(plant, 0.5, 0.5, 4.0, each=lambda p, r=referee: r.watch(0.0, p))
        assert (referee.contacts > 0) == bool(counted), height
        assert (plant.state.position_m[0] > 0.5) != bool(counted)
        if not counted:
            assert plant.state.position_m[2] == pytest.approx(height + BODY.below_m, abs=1e-3)


def test_a_kerb_counts_on_a_slope_as_well():
    rise = 0.10
    surface = profile([(-4, -4 * rise), (0, 0), (0, 0.05), (4, 0.05 + 4 * rise)])
    plant, referee = plant_on(surface, x=-1.0), Referee()
    drive(plant, 0.5, 0.5, 3.0, each=lambda p: referee.watch(0.0, p))
    assert referee.contacts == 1
    assert plant.state.position_m[0] == pytest.approx(-BODY.radius_m, abs=0.02)


def test_the_cut_follows_the_slope():
    surface = incline(0.15)
    at = plant_on(surface, x=0.0).state.position_m
    assert surface.clearance(at, on_floor=True) < 0.0  # a level cut takes uphill ground for an obstacle
    assert surface.clearance(at, on_floor=True, slope=(0.15, 0.0)) > 0.0
    assert surface.floor_slope(0.0, 0.0, 0.12) == pytest.approx((0.15, 0.0), abs=1e-3)
    assert surface.free_place(at, on_floor=True) > 0.0
    edge = profile([(-3, 0), (0, 0), (0, 1), (3, 1)])
    assert edge.floor_slope(-0.05, 0.0, 2.0) == (0.0, 0.0)  # uneven: no plane to follow


def test_walls_keep_their_distance_on_a_slope():
    """Level and tilted cut agree on an upright wall beside the robot: the shear leaves x and y alone."""
    rise = 0.10
    wall = profile([(-4, -4 * rise), (1.0, rise), (1.0, 3.0), (4, 3.0)])
    plant = plant_on(wall, x=0.0)
    assert plant.clearance_m == pytest.approx(1.0 - BODY.radius_m, abs=1e-3)


def test_driving_off_an_edge_is_a_fall_and_it_lies_below_afterwards():
    surface = profile([(-4, 0.5), (0, 0.5), (0, 0), (4, 0)])
    plant, referee = plant_on(surface, x=-1.0), Referee()
    for _ in range(round(4.0 / STEP_S)):
        plant.step(None, WheelDrive(0.6, 0.6, False) if plant.falls == 0 else BRAKED)
        referee.watch(0.0, plant)
    assert plant.falls == referee.falls == 1
    assert referee.contacts >= 1
    assert plant.state.on_wheels
    assert plant.state.position_m[2] == pytest.approx(BODY.below_m, abs=2e-3)
    assert plant.state.position_m[0] > 0.05  # it kept its speed while it fell


def test_a_step_down_that_wheels_take_is_no_fall():
    plant = plant_on(profile([(-4, 0.04), (0, 0.04), (0, 0), (4, 0)]), x=-1.0)
    drive_until(plant, 0.5, 1.0)
    assert plant.falls == 0
    assert plant.state.position_m[2] == pytest.approx(BODY.below_m, abs=1e-3)


def _rolling_w(speed):
    return (CONFIG.energy.land_w - CONFIG.energy.idle_w) * (
        FIXED_SHARE + (1.0 - FIXED_SHARE) * speed / TABLE_SPEED_MPS
    )


@pytest.mark.parametrize("rise", [0.0, 0.10])
def test_drive_power_is_the_closed_form(rise):
    v = TABLE_SPEED_MPS
    plant = plant_on(incline(rise), x=0.0)
    drive(plant, v, v, 3.0)
    climb_w = CONFIG.body.mass_kg * G * sine_of(rise) * v / EFFICIENCY
    # 0.2 %: float32 of the rays makes the slope, and the motors are 1e-6 below their target.
    expected = CONFIG.energy.idle_w + _rolling_w(v) + climb_w
    assert plant.rover.state.watts == pytest.approx(expected, rel=2e-3)
    if rise == 0.0:
        assert plant.rover.state.watts == pytest.approx(CONFIG.energy.land_w, rel=1e-4)


def test_downhill_never_charges_the_pack():
    v, sine = 0.8, sine_of(-0.5)
    plant = plant_on(incline(-0.5), x=0.0)
    drive(plant, v, v, 3.0)
    # What gravity gives, less the losses of the drive, spares the motors; 0.2 % as above.
    saved_w = CONFIG.body.mass_kg * G * -sine * v * EFFICIENCY
    assert plant.rover.state.watts == pytest.approx(CONFIG.energy.idle_w + _rolling_w(v) - saved_w, rel=2e-3)
    heavy = CONFIG.model_copy(update={"body": CONFIG.body.model_copy(update={"mass_kg": 60.0})})
    rover = Rover(heavy, 1)
    draws = [rover.step(STEP_S, v, v, sine=sine).watts for _ in range(500)]
    assert draws[-1] == min(draws) == CONFIG.energy.idle_w  # gravity drives it all, the computer stays


@pytest.mark.parametrize("rise", [-0.10, 0.0, 0.10])
def test_stopping_distance(rise):
    v = 0.8
    plant = plant_on(incline(rise), x=0.0)
    drive(plant, v, v, 2.0)
    start = plant.state.position_m.copy()
    drive(plant, v, v, 1.0, braked=True)
    way = float(np.linalg.norm(plant.state.position_m - start))
    sine = sine_of(rise)
    braking = BRAKE_MPS2 * math.sqrt(1.0 - sine * sine) + G * sine
    # One step's way of the integration is the tolerance: v * 4 ms = 3 mm of 46.
    assert way == pytest.approx(v * v / (2.0 * braking), abs=v * STEP_S)


def test_too_steep_it_slides_down_and_at_the_limit_it_stays():
    stays, slides = plant_on(incline(0.68), x=0.0), plant_on(incline(0.80), x=0.0)
    for plant in (stays, slides):
        drive(plant, 0.0, 0.0, 0.5, braked=True)
    assert stays.state.position_m[0] == 0.0
    # Closed form g (sin - mu cos) t^2 / 2 along the slope; 3 %: one step of 125 and the settling.
    angle = math.atan(0.80)
    way = 0.5 * G * (math.sin(angle) - 0.7 * math.cos(angle)) * 0.5**2
    assert -slides.state.position_m[0] == pytest.approx(way * math.cos(angle), rel=0.03)
    before = slides.state.position_m[0]
    drive(slides, 0.8, 0.8, 0.2)
    assert slides.state.position_m[0] < before  # the wheels turn in vain


def test_motors_stall_where_they_cannot_climb():
    plant = plant_on(incline(0.40), x=0.0)  # needs 3.6 m/s^2 of the motors' 3
    drive(plant, 0.5, 0.5, 1.0)
    assert plant.state.position_m[0] == 0.0


def test_taking_off_and_landing_on_a_slope():
    """JSBSim's floor is flat: the attitude goes on without a jump, and at rest the slope is taken again."""
    plant = plant_on(incline(0.10), x=0.0)
    tilt = roll_pitch_of(plant.state.quaternion)[1]
    plant.step(np.zeros(4), BRAKED)
    assert roll_pitch_of(plant.state.quaternion)[1] == pytest.approx(tilt, abs=0.02)
    for _ in range(250):
        plant.step(np.full(4, 0.05), BRAKED)
    assert roll_pitch_of(plant.state.quaternion)[1] == pytest.approx(0.0, abs=0.01)
    pitch = []
    for _ in range(250):
        plant.step(None, BRAKED)
        pitch.append(roll_pitch_of(plant.state.quaternion)[1])
    assert plant.state.on_wheels
    assert pitch[-1] == pytest.approx(-math.atan(0.10), abs=1e-3)
    assert np.abs(np.diff(pitch)).max() < 0.01  # settles, does not jump
    assert plant.clearance_m > 0.0
