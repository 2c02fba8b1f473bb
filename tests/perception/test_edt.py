from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from labr_autonomy.perception.edt import distance_to


@pytest.mark.parametrize("share", [0.001, 0.05, 0.5, 0.97])
@pytest.mark.parametrize("shape", [(21, 17, 9), (1, 30, 4), (12, 1, 1)])
def test_distances_equal_those_of_scipy(shape, share):
    source = np.random.default_rng(4).random(shape) < share
    source.flat[0], source.flat[-1] = True, False
    assert np.allclose(distance_to(source, True), distance_transform_edt(~source), atol=1e-5)
    assert np.allclose(distance_to(source, False), distance_transform_edt(source), atol=1e-5)


def test_a_sliced_grid_will_do():
    source = np.zeros((20, 20, 20), bool)
    source[3, 5, 7] = True
    part = source[1:15, 2:19, ::2][:, :, ::-1]
    assert distance_to(part | (np.arange(10) == 0), True).shape == (14, 17, 10)
