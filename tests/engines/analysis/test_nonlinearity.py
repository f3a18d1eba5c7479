"""The nonlinearity index: second order in the errors, nought where all is linear."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.engines.analysis.nonlinearity import _flown, _linear, _start_tick, nonlinearity
from lvnav_trade.engines.lincov.history import covariance
from lvnav_trade.kernels.attitude import matrix
from lvnav_trade.kernels.transition import ATT, POS, VEL
from tests.building import LOOSE, case


@pytest.mark.parametrize("settings", [(), (LOOSE,)])
def test_half_the_error_has_half_the_index(settings):
    """The remainder is quadratic, so per sigma it is proportional to the error: a quarter of the remainder at half."""
    prepared = case(*settings)
    history = covariance(prepared)
    whole, half = (nonlinearity(prepared, history, 15.0, scale) for scale in (1.0, 0.5))
    assert whole.motion > 1e-6
    assert half.motion / whole.motion == pytest.approx(0.5, rel=0.01)
    assert half.state == whole.state


def test_the_curvature_of_a_range_is_half_the_square_over_the_distance():
    """A position error d across the line of sight changes a range of R by d^2 / 2R, one of 20 000 km by 2.5e-2 m for
    1 km; the innovation's sigma is at least the noise of 2 m.
    """
    prepared = case()
    history = covariance(prepared)
    true = history.true_cov.copy()
    true[:] = 0.0
    true[:, range(POS, POS + 3), range(POS, POS + 3)] = 1e6
    found = nonlinearity(prepared, history._replace(true_cov=true), 15.0)
    assert 0.5e6 / 2.7e7 / 2.6 < found.rows < 0.5e6 / 2.0e7 / 2.0


def test_the_first_order_part_is_the_filters_transition():
    """Order 2 in steps of 0.1 s over a second of thrust at 30 m/s^2: to 2e-3 of what the error does.

    A gyro's bias reaches position in third order, of which a product of n windows misses 1 / 2n^2.
    """
    prepared = case()
    start = _start_tick(prepared, 10.0)
    for at, size in ((ATT, 1e-4), (VEL, 0.1), (POS, 10.0), (9, 1e-5), (12, 1e-2)):
        d = np.zeros(prepared.layout.n_state)
        d[at] = size
        linear = _linear(prepared, start, d)[:9]
        flown = (_flown(prepared, start, d) - _flown(prepared, start, -d)) / 2.0
        for block in (slice(0, 3), slice(3, 6), slice(6, 9)):
            share = 7e-3 if at == 9 and block.start == POS else 2e-3
            assert np.linalg.norm(flown[block] - linear[block]) <= share * np.linalg.norm(linear[block]) + 1e-8


def test_an_interval_that_would_end_after_the_flight_begins_earlier():
    prepared = case()
    end = float(prepared.reference.t[-1])
    ticks = round(prepared.scenario.imu.rate / prepared.scenario.filter.update_rate)
    assert _start_tick(prepared, end) == prepared.reference.t.size - 1 - ticks


def test_without_measurements_there_is_no_row():
    prepared = case("base.filter=filters/inertial")
    assert np.isnan(nonlinearity(prepared, covariance(prepared), 10.0).rows)


def test_over_a_gap_a_tilt_turns_the_specific_force_to_second_order():
    """A tilt d about one axis takes f (1 - cos d) = f d^2 / 2 off the specific force along the others."""
    prepared = case()
    history = covariance(prepared)
    tilt, begin, end = 0.1, 5.0, 15.0
    true = np.zeros_like(history.true_cov)
    true[:, range(ATT, ATT + 3), range(ATT, ATT + 3)] = tilt**2
    formal = np.zeros_like(true)
    formal[:, range(15), range(15)] = 1.0
    found = nonlinearity(prepared, history._replace(true_cov=true, formal_cov=formal), begin, end=end)
    ticks = slice(*(int(np.argmin(np.abs(prepared.reference.t - t))) for t in (begin, end)))
    turned = [
        np.reshape(matrix(*q), (3, 3)) @ dv
        for q, dv in zip(prepared.reference.q_b_i[ticks], prepared.reference.dvel[ticks], strict=True)
    ]
    force = np.abs(np.sum(turned, axis=0)).max() / (end - begin)
    assert found.time == end
    position = 0.5 * force * 0.5 * tilt**2 * (end - begin) ** 2
    assert found.motion == pytest.approx(position, rel=0.05)
