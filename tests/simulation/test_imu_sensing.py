"""Increments of a run: gravity that the estimate lacks."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.strapdown import R, V
from lvnav_trade.simulation.imu_sensing import _miss_gravity
from tests.simulation.test_flight_loop import scene


@pytest.mark.parametrize("seconds", [0.1, 1.0])
def test_gravity_that_the_estimate_lacks_moves_it_as_a_constant_force_would(seconds):
    _, work = scene()
    before, value = work.nav.copy(), np.array([1e-3, -2e-3, 3e-3])
    _miss_gravity(work, value, seconds)
    # the strapdown then carries the speed over the window: the estimate falls behind by g t^2 / 2
    carried = work.nav[R : R + 3] - before[R : R + 3] + seconds * (work.nav[V : V + 3] - before[V : V + 3])
    np.testing.assert_allclose(work.nav[V : V + 3] - before[V : V + 3], -seconds * value, rtol=1e-9)
    np.testing.assert_allclose(carried, -0.5 * seconds**2 * value, rtol=1e-4, atol=2e-9)
