"""Klobuchar's model against published values; the Chapman layer against its integral along the ray."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from scipy.integrate import quad

from lvnav_trade.kernels.media.ionosphere import (
    DISPERSION,
    EARTH_RADIUS,
    L1,
    L2,
    L5,
    chapman_slant,
    content_above,
    epstein_slant,
    free_combination,
    klobuchar,
    lear_slant,
    median_height,
)

PEAK, SCALE = 420e3, 100e3


@pytest.mark.parametrize(("second", "amplified"), [(L2, 2.978), (L5, 2.588)])
def test_a_combination_of_two_frequencies_has_no_ionosphere_and_the_published_noise(second, amplified):
    # Misra and Enge, Global Positioning System, 2nd ed., section 5.3: 2.546 and 1.546 of L1 and L2
    weights = np.array(free_combination(L1, second))
    assert weights.sum() == pytest.approx(1.0, abs=1e-12)
    delays = DISPERSION * 60e16 / np.array([L1, second]) ** 2
    assert delays[0] == pytest.approx(9.74, abs=0.01)
    assert weights @ delays == pytest.approx(0.0, abs=1e-12)
    assert np.hypot(*weights) == pytest.approx(amplified, abs=5e-4)


def test_klobuchar_has_the_values_of_rtklib(refdata):
    published = json.loads((refdata / "gnss/test_vectors/unit_check_vectors.json").read_text())["klobuchar"]
    assert len(published["rows"]) == 8
    for utc, *angles, delay in published["rows"]:
        seconds = 3600.0 * float(utc[11:13])
        ours = klobuchar(published["alpha"], published["beta"], seconds, *np.radians(angles))
        assert ours == pytest.approx(delay, abs=1e-6)


def test_klobuchar_keeps_the_value_of_the_horizon_below_it():
    args = ((2e-8, -8e-9, -5e-8, 1e-7), (2e5, 2e5, -1e5, -1e6), 3600.0, 0.6, 2.4, 1.0)
    assert klobuchar(*args, -0.2) == klobuchar(*args, 0.0)
    assert klobuchar(*args, -0.2) == pytest.approx(klobuchar(*args, 0.001), rel=0.01)


def test_content_above_has_the_worked_values():
    # The corrected form of Trigo and Theil, eq. 20, at 200, 420, 600 and 1000 km.
    assert content_above(np.array([200e3, 420e3, 600e3, 1000e3]), PEAK, SCALE) == pytest.approx(
        [1.000, 0.632, 0.152, 0.003], abs=5e-4
    )
    assert content_above(0.0, PEAK, SCALE) == 1.0


def test_content_above_is_the_integral_of_the_layer():
    def layer(height):
        z = (height - PEAK) / SCALE
        return np.exp(1.0 - z - np.exp(-z))

    whole = quad(layer, 0.0, 4000e3, points=[PEAK], epsabs=1e-6, limit=200)[0]
    for height in (100e3, 350e3, 700e3):
        above = quad(layer, height, 4000e3, points=[max(PEAK, height)], epsabs=1e-6, limit=200)[0]
        assert content_above(height, PEAK, SCALE) == pytest.approx(above / whole, rel=1e-6)


def test_the_ionospheric_point_halves_what_is_above():
    height = np.array([0.0, 200e3, 420e3, 900e3, 3000e3])
    halves = content_above(median_height(height, PEAK, SCALE), PEAK, SCALE) / content_above(height, PEAK, SCALE)
    assert halves == pytest.approx(0.5, rel=1e-9)
    high = 9000e3  # where the layer is an exponential, the point lies ln 2 scale heights above
    assert median_height(high, PEAK, SCALE) - high == pytest.approx(SCALE * np.log(2.0), rel=1e-6)


@pytest.mark.parametrize(
    ("height", "degrees"), [(0.0, 90.0), (0.0, 5.0), (150e3, 0.0), (350e3, -10.0), (350e3, -18.0), (800e3, -25.0)]
)
def test_the_integrated_slant_is_that_of_adaptive_quadrature(height, degrees):
    elevation = np.radians(degrees)
    impact, start = (EARTH_RADIUS + height) * np.cos(elevation), (EARTH_RADIUS + height) * np.sin(elevation)

    def layer(along):
        z = (np.hypot(impact, along) - EARTH_RADIUS - PEAK) / SCALE
        return np.exp(1.0 - z - np.exp(-z))

    end = np.sqrt((EARTH_RADIUS + 4000e3) ** 2 - impact**2)
    points = np.linspace(start, end, 40)
    slant = sum(quad(layer, a, b, epsabs=1e-3)[0] for a, b in itertools.pairwise(points))
    vertical = SCALE * (np.e - np.exp(1.0 - np.exp(PEAK / SCALE)))
    assert chapman_slant(elevation, height, PEAK, SCALE) == pytest.approx(slant / vertical, rel=1e-5)


def test_lear_is_near_the_integral_from_the_ground_and_short_of_it_from_within_the_layer(record_property):
    degrees, height = np.array([90.0, 60.0, 30.0, 10.0, 0.0])[:, None], np.array([0.0, 50e3, 350e3, 500e3])
    lear, exact = (f(np.radians(degrees), height, PEAK, SCALE) for f in (lear_slant, chapman_slant))
    ratio = lear / exact
    record_property("Lear over integral at 90, 60, 30, 10, 0 deg, from 0, 50, 350, 500 km", ratio.round(3).tolist())
    assert ratio[0] == pytest.approx(1.0, abs=2e-4)
    assert ratio[1:3] == pytest.approx(1.0, abs=0.04)
    assert ratio[3:, :2] == pytest.approx(0.9, abs=0.03)
    assert np.all(ratio[4, 2:] < 0.6)  # a thin layer is no picture of what surrounds the receiver


def test_both_slants_are_continuous_at_the_horizon():
    height = np.array([0.0, 100e3, 350e3, 800e3])
    for slant in (lear_slant, chapman_slant):
        below, above = (slant(np.full(4, side), height, PEAK, SCALE) for side in (-1e-9, 1e-9))
        assert below == pytest.approx(above, rel=1e-5)


def epstein(height):
    return 1.0 / np.cosh((height - 350e3) / (2.0 * np.where(height < 350e3, 40e3, 90e3))) ** 2


@pytest.mark.parametrize(
    ("height", "degrees"), [(0.0, 90.0), (50e3, 10.0), (150e3, 0.0), (350e3, -10.0), (600e3, 40.0)]
)
def test_epsteins_layer_is_that_of_adaptive_quadrature(height, degrees):
    elevation = np.radians(degrees)
    impact, start = (EARTH_RADIUS + height) * np.cos(elevation), (EARTH_RADIUS + height) * np.sin(elevation)
    points = np.linspace(start, np.sqrt((EARTH_RADIUS + 2150e3) ** 2 - impact**2), 60)
    slant = sum(
        quad(lambda s: epstein(np.hypot(impact, s) - EARTH_RADIUS), a, b, epsabs=1e-3, limit=200)[0]
        for a, b in itertools.pairwise(points)
    )
    vertical = quad(epstein, 0.0, 2150e3, points=[350e3], epsabs=1e-3, limit=200)[0]
    assert epstein_slant(elevation, height, 350e3, 40e3, 90e3) == pytest.approx(slant / vertical, rel=1e-5)


def test_what_is_above_the_peak_of_epsteins_layer_is_twice_its_thickness():
    share = epstein_slant(0.5 * np.pi, np.array([0.0, 350e3]), 350e3, 40e3, 90e3)
    ground = 2.0 * 90e3 + 4.0 * 40e3 * (1.0 / (1.0 + np.exp(-350.0 / 40.0)) - 0.5)
    assert share == pytest.approx([1.0, 2.0 * 90e3 / ground], rel=1e-6)
