"""The filter of a case: its start, and which measurements its stored gains leave."""

from __future__ import annotations

import numpy as np

from lvnav_trade.quantities.frames import reporting_axes
from tests.building import MATCHED, case, hop


def test_the_start_of_a_matched_filter_is_the_true_spread():
    """Tilt about north and east, heading about down; the filter's covariance is the true one, frame i."""
    prepared_case = case(MATCHED)
    initial = prepared_case.scenario.initial
    reference = prepared_case.reference
    C_i_n = reporting_axes("ned", reference.t[:1], reference.r_i[:1], reference.v_i[:1], hop().theta0)[0]
    attitude = prepared_case.initial_state.roots[0] @ prepared_case.initial_state.roots[0].T
    expected = np.diag([initial.tilt, initial.tilt, initial.heading]) ** 2
    np.testing.assert_allclose(C_i_n @ attitude @ C_i_n.T, expected, rtol=1e-12, atol=1e-20)
    np.testing.assert_allclose(prepared_case.initial_state.P[:3, :3], attitude, rtol=1e-12, atol=1e-20)
