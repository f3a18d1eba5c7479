"""The joint fit of altitude and speed against a climb that is known."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.earth import GM, SEMI_MAJOR
from lvnav_trade.world.ascent.record import Record
from lvnav_trade.world.ascent.smoothing import smooth

NOISE = (2.0, 60.0)


def known_climb():
    """Altitude, its rate and level speed of a climb with cut-off at 150 s, free fall to 160 s, and a second burn."""
    t = np.arange(0.0, 300.5, 0.5)
    up = np.where(t < 150.0, 6.0 + 0.1 * t, np.where(t < 160.0, -GM / (SEMI_MAJOR + 8e4) ** 2, 1.0))
    along = np.where(t < 150.0, 0.08 * t, np.where(t < 160.0, 0.0, 15.0))
    w, u = (np.append(0.0, np.cumsum(0.25 * (a[1:] + a[:-1]))) for a in (up, along))
    h = np.append(0.0, np.cumsum(0.25 * (w[1:] + w[:-1])))
    return t[::10], h[::10], w[::10], u[::10]


def noisy(seed):
    t, h, w, u = known_climb()
    draws = np.random.default_rng(seed).standard_normal((2, t.size))
    speed = np.maximum(np.hypot(w, u) + NOISE[0] * draws[0], 0.0)
    return Record(t, speed, h + NOISE[1] * draws[1])


def test_the_fit_lies_closer_to_the_known_climb_than_the_record_does():
    t, h, w, u = known_climb()
    climb = smooth(noisy(1), [150.0, 160.0], [(150.0, 160.0)], *NOISE)
    assert np.sqrt(np.mean((climb.altitude(t) - h) ** 2)) < 0.7 * NOISE[1]
    assert np.sqrt(np.mean((climb.speed(t) - np.hypot(w, u)) ** 2)) < 1.0 * NOISE[0]


def test_the_residuals_are_the_noise_that_was_stated():
    climb = smooth(noisy(2), [150.0, 160.0], [(150.0, 160.0)], *NOISE)
    assert climb.misfit == pytest.approx(1.0, abs=0.1)


def test_speed_is_never_less_than_the_rate_of_climb_and_starts_from_rest():
    climb = smooth(noisy(3), [150.0, 160.0], [(150.0, 160.0)], *NOISE)
    t = np.linspace(0.0, 300.0, 1000)
    assert np.all(climb.speed(t) >= np.abs(climb.altitude(t, 1)))
    assert climb.speed(np.array([0.0]))[0] < 1e-9
    assert abs(climb.altitude(0.0)) < 1e-9


def test_acceleration_jumps_at_the_breaks_and_speed_does_not():
    climb = smooth(noisy(4), [150.0, 160.0], [(150.0, 160.0)], *NOISE)
    before, after = climb.altitude([150.0 - 1e-6, 150.0 + 1e-6], 2)
    assert before - after > 20.0
    for order, spline in ((0, climb.altitude), (1, climb.altitude), (0, climb.level)):
        left, right = spline([150.0 - 1e-7, 150.0 + 1e-7], order)
        assert abs(left - right) < 1e-3


def test_the_coast_is_in_free_fall():
    climb = smooth(noisy(5), [150.0, 160.0], [(150.0, 160.0)], *NOISE)
    t = np.linspace(150.5, 159.5, 10)
    gravity = GM / (SEMI_MAJOR + climb.altitude(t)) ** 2
    assert np.max(np.abs(climb.altitude(t, 2) + gravity - climb.level(t) ** 2 / SEMI_MAJOR)) < 0.3
