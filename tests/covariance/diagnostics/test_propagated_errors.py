"""Errors after some windows: by the strapdown and by the filter's transition."""

from __future__ import annotations

import numpy as np

from lvnav_trade.covariance.diagnostics.propagated_errors import (
    linear_errors,
    start_tick,
    strapdown_errors,
    update_windows,
)
from lvnav_trade.kernels.transition import ATT, POS, VEL
from tests.building import case


def test_the_first_order_part_is_the_filters_transition():
    """Order 2 in steps of 0.1 s over a second of thrust at 30 m/s^2: to 2e-3 of what the error does.

    A gyro's bias reaches position in third order, of which a product of n windows misses 1 / 2n^2.
    """
    prepared_case = case()
    start = start_tick(prepared_case, 10.0)
    for at, size in ((ATT, 1e-4), (VEL, 0.1), (POS, 10.0), (9, 1e-5), (12, 1e-2)):
        d = np.zeros(prepared_case.layout.n_state)
        d[at] = size
        linear = linear_errors(prepared_case, start, d[None], update_windows(prepared_case, start))[0, :9]
        plus, minus = strapdown_errors(prepared_case, start, np.array([d, -d]), update_windows(prepared_case, start))
        flown = (plus - minus) / 2.0
        for block in (slice(0, 3), slice(3, 6), slice(6, 9)):
            share = 7e-3 if at == 9 and block.start == POS else 2e-3
            assert np.linalg.norm(flown[block] - linear[block]) <= share * np.linalg.norm(linear[block]) + 1e-8


def test_an_interval_that_would_end_after_the_flight_begins_earlier():
    prepared_case = case()
    end = float(prepared_case.reference.t[-1])
    ticks = round(prepared_case.scenario.imu.rate / prepared_case.scenario.filter.update_rate)
    assert start_tick(prepared_case, end) == prepared_case.reference.t.size - 1 - ticks
