"""Scalars of a solution by figures that can be checked in the head; the rest is in the family's contract."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.sensors.jacobian_row import H_ATT, H_CLOCK, H_POS, H_RATE, H_VEL, N_ENTRY
from lvnav_trade.sensors.receiver_solution import observe, row

AT = np.array([1.0, 2.0, 3.0, 10.0, 20.0, 30.0, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03, *range(4, 13)])


@pytest.mark.parametrize("scalar", range(6))
def test_a_row_has_the_antenna_its_lever_arm_and_of_a_velocity_the_body_rate(scalar):
    h, axis = np.full(N_ENTRY, np.nan), scalar % 3
    own, arm = (H_POS, 6) if scalar < 3 else (H_VEL, 9)
    assert row(h, AT, scalar) == AT[scalar]
    expected = np.zeros(N_ENTRY)
    expected[own + axis] = 1.0
    # rotation by an angle about an axis moves the arm by angle x arm
    for turn in range(3):
        expected[H_ATT + turn] = np.cross(np.eye(3)[turn], AT[arm : arm + 3])[axis]
    if scalar >= 3:
        # and by a body rate as `antenna` says: a row of the 3 x 3 block behind the arm's own rate
        expected[H_RATE : H_RATE + 3] = AT[12 + 3 * axis : 15 + 3 * axis]
    np.testing.assert_allclose(h, expected, rtol=0, atol=1e-16)
    assert h[H_CLOCK] == 0.0


def test_noise_is_added_to_the_true_value():
    assert observe(7.0, 2.0, -1.5) == 4.0
