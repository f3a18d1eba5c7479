"""One axis of a solution by figures that can be checked in the head; the rest is in the family's contract."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.observables.base import H_ATT, H_CLOCK, H_POS, H_RATE, H_VEL, N_ENTRY
from lvnav_trade.observables.velocity import observe, row

AT = np.array([1.0, 2.0, 3.0, 10.0, 20.0, 30.0, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03, *range(4, 13)])
OWN, ARM = (H_POS, 6) if "velocity" == "position" else (H_VEL, 9)


@pytest.mark.parametrize("axis", range(3))
def test_a_row_of_(axis):
    h = np.full(N_ENTRY, np.nan)
    assert row(h, AT, axis) == AT[axis + (0 if OWN == H_POS else 3)]
    expected = np.zeros(N_ENTRY)
    expected[OWN + axis] = 1.0
    # rotation by an angle about an axis moves the arm by angle x arm
    for turn in range(3):
        expected[H_ATT + turn] = np.cross(np.eye(3)[turn], AT[ARM : ARM + 3])[axis]
    # and by a body rate as `antenna` says: a row of the 3 x 3 block behind the arm's own rate
    expected[H_RATE : H_RATE + 3] = AT[12 + 3 * axis : 15 + 3 * axis]
    np.testing.assert_allclose(h, expected, rtol=0, atol=1e-16)
    assert h[H_CLOCK] == 0.0


def test_noise_is_added_to_the_true_velocity():
    assert observe(7.0, 2.0, -1.5) == 4.0
