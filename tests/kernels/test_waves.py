"""Sums of waves against numpy's complex arithmetic."""

from __future__ import annotations

import numpy as np

from lvnav_trade.kernels.waves import N_WAVE, sum_of_waves


def test_the_sum_is_that_of_complex_exponentials_and_its_derivatives():
    draw = np.random.default_rng(5)
    t, omega = draw.uniform(0.0, 3.0, 40), draw.uniform(1.0, 900.0, 7)
    turn, shift = (draw.normal(size=(7, 6)) for _ in range(2))
    wave, i_w = np.exp(1j * np.outer(t, omega)), 1j * omega[:, None]
    a, d = turn[:, :3] + 1j * turn[:, 3:], shift[:, :3] + 1j * shift[:, 3:]
    expected = np.hstack([(wave @ each).real for each in (a, i_w * a, d, i_w * d, i_w**2 * d)])
    found = sum_of_waves(t, omega, turn, shift)
    assert found.shape == (40, N_WAVE)
    assert np.max(np.abs(found - expected) / np.max(np.abs(expected), axis=0)) < 1e-12
