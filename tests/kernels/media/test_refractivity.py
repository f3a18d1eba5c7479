"""Traced rays against an integration of the ray equation, zenith integrals and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lvnav_trade.kernels.media import refractivity as room
from lvnav_trade.kernels.media.refractivity import (
    EARTH_RADIUS,
    bean_thayer_refractivity,
    exponential_refractivity,
    lowest_height,
    ray,
    sample_atmosphere,
    standard_refractivity,
)
from lvnav_trade.kernels.media.troposphere import niell
from lvnav_trade.quantities.frames import ecef_from_geodetic, geodetic_from_ecef, rotation_e_n

FAR = 26.56e6


@pytest.fixture(scope="module")
def exponential():
    return sample_atmosphere(exponential_refractivity)


@pytest.fixture(scope="module")
def standard():
    return sample_atmosphere(standard_refractivity)


def integrated(height, apparent):
    """Return elevation of the straight line and delay, from the ray equation d(n dr/ds)/ds = grad n in the plane.

    In the variable d(sigma) = ds/n: x' = p, p' = n grad n, optical path' = n^2; beyond 200 km straight on.
    """

    def index(r):
        return 1.0 + 1e-6 * float(exponential_refractivity(r - EARTH_RADIUS))

    def slope(_, state):
        x, p = state[:2], state[2:4]
        r = np.hypot(*x)
        n = index(r)
        return np.concatenate([p, -n * (n - 1.0) / 7350.0 * x / r, [n * n]])

    def left(_, state):
        return np.hypot(state[0], state[1]) - max(EARTH_RADIUS + 200e3, start[1] + 1e3)

    left.terminal, left.direction = True, 1.0
    start = np.array([0.0, EARTH_RADIUS + height])
    n = index(start[1])
    begin = [*start, n * np.cos(apparent), n * np.sin(apparent), 0.0]
    found = solve_ivp(slope, (0.0, 1e7), begin, "DOP853", rtol=1e-12, atol=1e-6, events=left, max_step=5e3)
    x, p, path = found.y[:2, -1], found.y[2:4, -1], found.y[4, -1]
    towards = p / np.hypot(*p)
    rest = -x @ towards + np.sqrt((x @ towards) ** 2 + FAR**2 - x @ x)
    line = x + rest * towards - start
    return np.arctan2(line[1], line[0]), path + rest - np.hypot(*line)


@pytest.mark.parametrize(
    ("height", "apparent"),
    [(0.0, 0.001), (0.0, 5.0), (0.0, 30.0), (20e3, -2.0), (30e3, 0.0), (350e3, -17.5), (350e3, -18.2)],
)
def test_rays_are_those_of_the_ray_equation(exponential, height, apparent, record_property):
    elevation, delay = integrated(height, np.radians(apparent))
    ours = ray(exponential, height, elevation, FAR)
    assert ours.delay == pytest.approx(delay, abs=2e-4, rel=2e-5)
    assert ours.apparent_elevation == pytest.approx(np.radians(apparent), abs=1e-8)
    record_property(f"ray from {height / 1e3:.0f} km at {apparent} deg, difference in mm", 1e3 * (ours.delay - delay))


@pytest.mark.parametrize("refractivity", [standard_refractivity, bean_thayer_refractivity, exponential_refractivity])
def test_the_zenith_delay_is_the_integral_of_refractivity(refractivity):
    profile = sample_atmosphere(refractivity)
    for height in (0.0, 1.5e3, 11e3, 40e3):
        z = np.linspace(height, 130e3, 100_001)
        smoothed = np.exp(np.interp(z, profile.height, profile.log_n))
        assert ray(profile, height, np.pi / 2, FAR).delay == pytest.approx(np.trapezoid(smoothed, z), abs=5e-4)


def test_smoothing_leaves_an_exponential_as_it_is(exponential):
    assert np.exp(exponential.log_n) == pytest.approx(1e-6 * exponential_refractivity(exponential.height), rel=1e-9)
    assert ray(exponential, 0.0, np.pi / 2, FAR).delay == pytest.approx(315e-6 * 7350.0, abs=1e-4)


def test_the_standard_profile_has_the_published_zenith_delay(standard):
    # Dry 2.277 mm per hPa (Saastamoinen); wet by the closed integral. Together within what smoothing adds.
    assert ray(standard, 0.0, np.pi / 2, FAR).delay == pytest.approx(2.277e-3 * 1013.25 + 44.8e-6 * 2000.0, abs=0.015)


def test_the_atmosphere_of_signal_simulators_has_the_zenith_delay_of_spilker():
    assert ray(sample_atmosphere(bean_thayer_refractivity), 0.0, np.pi / 2, FAR).delay == pytest.approx(
        2.4405, rel=0.02
    )


def test_dry_air_maps_as_niell_does(record_property):
    dry = sample_atmosphere(lambda height: standard_refractivity(height, wet=0.0))
    zenith = ray(dry, 0.0, np.pi / 2, FAR).delay
    for degrees, within in ((5.0, 0.01), (10.0, 0.003), (20.0, 0.001), (45.0, 0.0005)):
        elevation = np.radians(degrees)
        mapping = ray(dry, 0.0, elevation, FAR).delay / zenith
        published = niell(elevation, np.radians(45.0), 0.0, 28.0 + 365.25 / 4)[0]
        record_property(f"dry mapping at {degrees} deg, ours and Niell's", f"{mapping:.4f} {published:.4f}")
        assert mapping == pytest.approx(published, rel=within)


def test_refraction_at_the_horizon_is_that_of_radio_handbooks(exponential):
    # Some 0.6 degrees at radio wavelengths, for a surface refractivity of 315 (Bean and Dutton, table 3.1: 0.7).
    apparent = ray(exponential, 0.0, 0.0, FAR).apparent_elevation
    assert np.degrees(apparent) == pytest.approx(0.58, abs=0.05)


def test_a_finer_grid_of_nodes_changes_nothing(standard, monkeypatch):
    height = np.array([0.0, 5e3, 11e3, 30e3, 350e3])
    elevation = np.radians([0.0, 5.0, -1.0, 40.0, -18.0])
    coarse = ray(standard, height, elevation, FAR).delay
    panels = np.interp(np.linspace(-1e3, 130e3, 263), standard.height, standard.radius)
    fine = ray(standard._replace(panels=panels), height, elevation, FAR).delay
    assert coarse == pytest.approx(fine, abs=2e-4)


def test_a_dipping_ray_passes_all_air_once_more(exponential):
    # From far above, half of the delay comes before the lowest point: two receivers there see half each.
    lowest = 60e3
    whole = ray(exponential, 400e3, -np.arccos((EARTH_RADIUS + lowest) / (EARTH_RADIUS + 400e3)), FAR).delay
    half = ray(exponential, lowest, 0.0, FAR).delay
    assert whole == pytest.approx(2.0 * half, rel=0.01)


def test_a_satellite_farther_away_changes_little(standard):
    elevation = np.radians([30.0, 5.0])
    near, far = (ray(standard, 0.0, elevation, radius).delay for radius in (FAR, 29.6e6))
    assert near == pytest.approx(far, abs=2e-4)
    grazing = ray(standard, 350e3, np.radians(-18.2), np.array([FAR, 29.6e6])).delay
    assert grazing[1] == pytest.approx(grazing[0], rel=0.02)


def test_air_that_traps_rays_is_refused():
    with pytest.raises(ValueError, match="trapped"):
        sample_atmosphere(lambda height: 315.0 * np.exp(-height / 1500.0))
    with pytest.raises(ValueError, match="trapped"):
        sample_atmosphere(lambda height: 315.0 * np.exp(height / 7350.0))


def test_refractivity_of_the_published_atmospheres():
    assert standard_refractivity(0.0, wet=0.0) == pytest.approx(77.6 * 1013.25 / 288.15, rel=1e-6)
    assert standard_refractivity(11e3, wet=0.0) == pytest.approx(77.6 * 226.999 / 216.774, rel=1e-4)
    assert bean_thayer_refractivity(np.array([0.0, 9e3])) == pytest.approx([324.8, 105.0])
    edge = bean_thayer_refractivity(np.array([1e3 - 1e-6, 1e3 + 1e-6, 9e3 - 1e-6, 9e3 + 1e-6]))
    assert edge[::2] == pytest.approx(edge[1::2], rel=1e-8)
    assert edge[0] == pytest.approx(324.8 - 7.32 * np.exp(0.005577 * 324.8), rel=1e-8)


@pytest.mark.parametrize("latitude", [-80.0, -38.6, 0.0, 5.2, 60.0])
@pytest.mark.parametrize("azimuth", [0.0, 70.0, 200.0])
def test_the_lowest_point_of_a_line_is_found_on_the_ellipsoid(latitude, azimuth):
    lat, az, el, height = np.radians(latitude), np.radians(azimuth), np.radians(-17.0), 350e3
    start = ecef_from_geodetic(lat, 0.4, height)
    line = rotation_e_n(lat, 0.4).T @ np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), -np.sin(el)])
    heights = geodetic_from_ecef(start + np.linspace(0.0, 4e6, 40_001)[:, None] * line)[2]
    ours = lowest_height(lat, height, az, el)
    assert ours == pytest.approx(heights.min(), abs=0.004 * (height - heights.min()))
    assert lowest_height(lat, height, az, 0.1) == height
    assert lowest_height(lat, height, az, -1e-9) == pytest.approx(height, abs=0.2)


def test_the_iteration_is_far_from_its_limit(standard, monkeypatch):
    height, elevation = np.array([0.0, 350e3, 2000e3]), np.radians([-0.3, -18.4, -40.0])
    delay = ray(standard, height, elevation, FAR).delay
    monkeypatch.setattr(room, "_ROUNDS", 12)
    assert ray(standard, height, elevation, FAR).delay == pytest.approx(delay, abs=1e-6)
