"""Ranges and their rates by figures that can be checked in the head; the rest is in the family's contract."""

from __future__ import annotations

import numpy as np

from lvnav_trade.sensors.jacobian_row import H_ATT, H_CLOCK, H_POS, H_VEL, N_ENTRY
from lvnav_trade.sensors.ranges import observe, range_row, rate_row


def test_a_satellite_overhead_sees_height_and_clock_with_opposite_signs():
    # 3-4-5: the satellite is 5 m away; moving towards it by 1 m shortens the range by 1 m
    h = np.full(N_ENTRY, np.nan)
    assert range_row(h, np.zeros(21), 0.6, 0.8, 0.0, 5.0, 100.0) == 105.0
    np.testing.assert_array_equal(h[H_POS : H_POS + 3], [-0.6, -0.8, -0.0])
    assert h[H_CLOCK] == 1.0


def test_flying_towards_a_satellite_gives_a_negative_rate():
    h, at = np.full(N_ENTRY, np.nan), np.zeros(21)
    at[3] = 7000.0  # antenna velocity along x, the satellite is ahead at rest, the clock drifts by 3 m/s
    assert rate_row(h, at, np.zeros(3), 1.0, 0.0, 0.0, 1e6, 3.0) == -6997.0
    np.testing.assert_array_equal(h[H_VEL : H_VEL + 3], [-1.0, -0.0, -0.0])
    assert h[H_CLOCK] == 1.0


def test_passing_a_satellite_abeam_changes_the_rate_by_the_angle_that_is_flown():
    # 7000 m/s across a line of 1e6 m: a metre further on, the rate has grown by 7000 / 1e6
    h, at = np.full(N_ENTRY, np.nan), np.zeros(21)
    at[3] = 7000.0
    assert rate_row(h, at, np.zeros(3), 0.0, 1.0, 0.0, 1e6, 0.0) == 0.0
    np.testing.assert_allclose(h[H_POS : H_POS + 3], [7e-3, 0.0, 0.0], rtol=1e-15)


def test_clock_and_noise_are_added():
    assert observe(2e7, 300.0, 2.0, -1.5) == 2e7 + 297.0
    assert observe(-700.0, 3.0, 0.1, 2.0) == -696.8


def test_the_rows_are_those_that_the_theory_prints():
    """Line of sight e, lever arm a and its rate, w = v_s - v_a, p = -(w - (w . e) e) / distance (docs/theory.md)."""
    e, a, turning = np.array([2.0, -1.0, 2.0]) / 3.0, np.array([1.5, -0.4, 0.7]), np.array([0.3, 0.9, -0.2])
    speed, satellite, distance = np.array([100.0, 7000.0, -50.0]), np.array([3000.0, -2000.0, 900.0]), 2.3e7
    at = np.zeros(21)
    at[3:6], at[6:9], at[9:12] = speed, a, turning
    h = np.full(N_ENTRY, np.nan)
    range_row(h, at, *e, distance, 0.0)
    np.testing.assert_allclose(h[H_ATT : H_ATT + 3], np.cross(e, a), rtol=1e-14)
    rate_row(h, at, satellite, *e, distance, 0.0)
    w = satellite - speed
    p = -(w - (w @ e) * e) / distance
    np.testing.assert_allclose(h[H_POS : H_POS + 3], p, rtol=1e-14)
    np.testing.assert_allclose(h[H_VEL : H_VEL + 3], -e, rtol=1e-14)
    np.testing.assert_allclose(h[H_ATT : H_ATT + 3], np.cross(a, p) + np.cross(e, turning), rtol=1e-13)
