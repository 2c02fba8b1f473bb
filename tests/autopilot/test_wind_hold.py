"""The stand-in's position control against wind: it leans into it, is carried off a little, and returns."""

import numpy as np
import pytest
from autopilot_rig import Rig

from labr_autonomy.frames import roll_pitch_of
from sim.disturbances import Disturbances, WindField


@pytest.mark.slow
def test_position_control_returns_against_a_steady_wind():
    rig = Rig()
    rig.take_off(1.5)
    before = rig.truth.position_m.copy()
    rig.quad.set_wind(np.array([3.0, 0.0, 0.0]))
    offsets = []
    rig.run(12.0, lambda r: offsets.append(float(r.truth.position_m[0] - before[0])))
    assert 0.01 < max(offsets) < 0.6  # carried off while the integrator winds up
    # The rest of the error is the estimator's noise: 5 cm.
    assert np.mean(offsets[-250:]) == pytest.approx(0.0, abs=0.05)
    lean = np.hypot(*roll_pitch_of(rig.truth.quaternion))
    # Drag of 0.0697 m^2 at 3 m/s, 0.38 N against 33.3 N, asks for 0.0115 rad.
    assert 0.005 < lean < 0.03


@pytest.mark.slow
def test_forest_gusts_move_it_by_decimetres_at_most():
    rig = Rig()
    rig.take_off(1.5)
    before, air = rig.truth.position_m.copy(), WindField(Disturbances.for_family("forest").wind, 11)
    worst = [0.0]

    def blow(r):
        if r.ticks % 10 == 0:
            r.quad.set_wind(air.step(0.04))
        worst[0] = max(worst[0], float(np.linalg.norm(r.truth.position_m - before)))

    rig.run(15.0, blow)
    assert worst[0] < 0.3
