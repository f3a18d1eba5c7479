"""Splines through rows: through them, smooth, free to bend only where they may."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.world.user_file.stretches import fit

T = np.arange(0.0, 100.05, 0.1)
BREAKS = (33.333, 50.0)


def speed(t):
    """A speed whose derivative jumps at BREAKS, both between rows and on one."""
    end = 10.0 * BREAKS[0] + 0.05 * BREAKS[0] ** 2
    late = end - 9.0 * (BREAKS[1] - BREAKS[0])
    values = [10.0 * t + 0.05 * t**2, end - 9.0 * (t - BREAKS[0]), late + 30.0 * (t - BREAKS[1])]
    return np.select([t < BREAKS[0], t < BREAKS[1]], values[:2], values[2])


def curves(t):
    return np.column_stack([speed(t), 7000.0 + np.sin(t / 3.0)])


def test_rows_without_noise_are_met_and_jumps_of_force_between_rows_are_found():
    found = fit(T, curves(T), BREAKS, 4, 0.0)
    t = np.linspace(0.0, 100.0, 4001)[1:-1]
    assert found.misfit < 1e-9
    assert np.max(np.abs(found.spline(t) - curves(t))) < 1e-3
    force = found.spline(np.array([33.332, 33.334, 49.999, 50.001]), 1)[:, 0]
    assert force == pytest.approx([10.0 + 0.1 * 33.332, -9.0, -9.0, 30.0], abs=0.01)


def test_an_undeclared_jump_makes_the_spline_swing():
    # what the declared break is worth: ten times the error without it
    t = np.linspace(33.0, 34.0, 501)
    with_break, without = (np.max(np.abs(fit(T, curves(T), b, 4, 0.0).spline(t) - curves(t))) for b in (BREAKS, ()))
    assert without > 10.0 * with_break


def test_noisy_rows_are_left_by_their_noise_and_the_noise_does_not_become_force():
    rng = np.random.default_rng(7)
    noisy = curves(T) + rng.normal(0.0, 0.05, (T.size, 2))
    found = fit(T, noisy, BREAKS, 4, 0.05)
    assert found.misfit == pytest.approx(0.05, rel=0.01)
    t = np.linspace(1.0, 99.0, 2000)
    t = t[np.min(np.abs(t[:, None] - np.array(BREAKS)), axis=1) > 0.5]
    sharp = fit(T, noisy, BREAKS, 4, 0.0)
    true = fit(T, curves(T), BREAKS, 4, 0.0).spline(t, 1)
    smooth, rough = (np.sqrt(np.mean((f.spline(t, 1) - true) ** 2)) for f in (found, sharp))
    assert smooth < 0.1 * rough


def test_a_step_of_the_rows_is_found_and_the_spline_goes_on_without_it():
    true = np.column_stack(
        [5.0 * T**2 + 20.0 * np.maximum(T - 50.0, 0.0) ** 2, np.sin(T / 3.0)]
    )  # force jumps there too
    found = fit(T, true + np.outer(T >= 50.0, [3.0, 0.0]), [50.0], 5, 0.0, [50.0])
    assert found.steps[0] == pytest.approx([3.0, 0.0], abs=1e-3)
    assert np.max(np.abs(found.spline(T) - true)) < 2e-3


def test_breaks_closer_than_the_rows_and_outside_them_do_no_harm():
    found = fit(T, curves(T), (*BREAKS, 33.334, -5.0, 200.0, 60.01, 60.02, 60.03), 4, 0.0)
    assert np.all(np.isfinite(found.spline(np.linspace(0.0, 100.0, 999), 2)))
    assert found.misfit < 1e-6
