"""The Hatch filter: gains of a window that begins anew, variance and divergence against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.filter.receivers.carrier_smoothing import gains, smoothing_error

EPOCHS, WINDOW = 400, 20
A = 1.0 / WINDOW


def always(n_sat=1):
    tracked = np.ones((EPOCHS, n_sat), dtype=bool)
    locked = tracked.copy()
    locked[0] = False
    return tracked, locked


def variance(gain):
    """Variance of the average of white code of variance one, epoch by epoch."""
    found, value = [], 0.0
    for a in gain:
        value = (1.0 - a) ** 2 * value + a * a
        found.append(value)
    return np.array(found)


def test_the_mean_of_a_window_then_the_steady_state():
    of_code = variance(gains(*always(), WINDOW)[:, 0])
    np.testing.assert_allclose(of_code[:WINDOW], 1.0 / np.arange(1, WINDOW + 1), rtol=1e-12)
    assert of_code[-1] == pytest.approx(A / (2.0 - A), rel=1e-12)


def test_a_loss_and_a_slip_begin_anew_and_what_is_not_tracked_has_no_gain():
    tracked, locked = always(3)
    tracked[50:60, 1] = False
    locked[50:61, 1] = False
    locked[70, 2] = False
    gain = gains(tracked, locked, WINDOW)
    assert not gain[50:60, 1].any()
    np.testing.assert_allclose(gain[60:63, 1], [1.0, 1.0 / 2.0, 1.0 / 3.0])
    np.testing.assert_allclose(gain[69:72, 2], [A, 1.0, 1.0 / 2.0])
    assert gain[60, 0] == A


def test_code_and_carrier_diverge_by_twice_the_rate_of_the_delay_times_the_window():
    rate = 0.02  # m an epoch
    delay = 5.0 + rate * np.arange(EPOCHS)[:, None]
    found = smoothing_error(gains(*always(), WINDOW), 2.0 * delay)
    # a first-order filter trails a ramp of slope r by r (1 - a) / a
    assert found[-1, 0] == pytest.approx(-2.0 * rate * (1.0 - A) / A, rel=1e-6)
    # of a mean it is half the ramp
    assert found[WINDOW - 1, 0] == pytest.approx(-2.0 * rate * (WINDOW - 1) / 2.0, rel=1e-9)
    constant = smoothing_error(gains(*always(), WINDOW), np.full((EPOCHS, 1), 7.0))
    np.testing.assert_allclose(constant, 0.0, atol=1e-12)


def test_an_unnoticed_slip_stays_in_the_smoothed_range_and_decays_with_the_window():
    metres, first = 0.19, 100
    slip = np.zeros((EPOCHS, 1))
    slip[first:] = metres
    found = smoothing_error(gains(*always(), WINDOW), -slip)[:, 0]
    # the carrier has moved at once, the average of code minus carrier follows by a share of A an epoch
    expected = metres * (1.0 - A) ** np.arange(1, EPOCHS - first + 1)
    np.testing.assert_allclose(found[first:], expected, rtol=1e-12, atol=1e-15)
    assert not found[:first].any()
