"""Mean orbits against the average of a numerically flown revolution, another implementation of the same meaning."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.earth import GM, SEMI_MAJOR
from lvnav_trade.quantities.frames import Elements, elements_from_state, state_from_elements
from lvnav_trade.results.mechanics import orbits
from tests import mission as flights

# semi-major axis (m), eccentricity, inclination, argument of perigee, true anomaly (deg); tolerances: m, 1, rad
ORBITS = {
    "sun-synchronous": ((6878e3, 0.0005, 97.4, 30.0, 100.0), (20.0, 3e-6, 3e-6)),
    "osculating circular": ((6878e3, 0.0, 51.6, 0.0, 40.0), (20.0, 3e-6, 3e-6)),
    "near the equator": ((6978e3, 0.02, 5.0, 30.0, 200.0), (60.0, 5e-6, 3e-6)),
    "transfer": ((24.4e6, 0.73, 7.0, 178.0, 5.0), (120.0, 5e-6, 3e-6)),
    "polar and low": ((6650e3, 0.003, 98.0, 90.0, 300.0), (20.0, 3e-6, 3e-6)),
}


def state(name):
    a, e, *angles = ORBITS[name][0]
    i, w, nu = np.radians(angles)
    return state_from_elements(Elements(a, e, i, 1.0, w, nu))


def revolution(r_i, v_i, period, sign, points=2001):
    t = np.linspace(0.0, sign * period, points)
    return flights.coast(r_i, v_i, t).y.T


def flown_mean(r_i, v_i):
    """Average a revolution ahead and one behind: drift, which is linear, falls out."""
    period = 2.0 * np.pi * np.sqrt(float(orbits.mean(r_i, v_i).semi_major_axis) ** 3 / GM)
    parts = []
    for sign in (1, -1):
        y = revolution(r_i, v_i, period, sign)
        orbit = orbits.osculating(y[:, :3], y[:, 3:])
        parts.append([np.trapezoid(value, axis=0, dx=1.0 / 2000) for value in orbit])
    return orbits.OrbitVectors(*(0.5 * (a + b) for a, b in zip(*parts, strict=True)))


@pytest.mark.parametrize("name", ORBITS)
def test_the_mean_orbit_is_the_average_of_a_flown_revolution(name):
    """To second order in J2: tens of metres, where osculating elements are kilometres away."""
    r_i, v_i = state(name)
    found, flown = orbits.mean(r_i, v_i), flown_mean(r_i, v_i)
    metres, ratio, angle = ORBITS[name][1]
    for what in ("semi_major_axis", "perigee", "apogee"):
        assert float(getattr(found, what)) == pytest.approx(float(getattr(flown, what)), abs=metres), what
    assert float(found.eccentricity) == pytest.approx(float(flown.eccentricity), abs=ratio)
    assert float(found.inclination) == pytest.approx(float(flown.inclination), abs=angle)
    assert float(found.node) == pytest.approx(float(flown.node), abs=2.0 * angle)
    a = float(orbits.osculating(r_i, v_i).semi_major_axis)
    assert abs(a - float(flown.semi_major_axis)) > 5.0 * metres  # so averaging matters


@pytest.mark.parametrize("name", ORBITS)
def test_lowest_and_highest_point_are_those_of_a_flown_revolution(name):
    r_i, v_i = state(name)
    period = 2.0 * np.pi * np.sqrt(float(orbits.mean(r_i, v_i).semi_major_axis) ** 3 / GM)
    height = np.linalg.norm(revolution(r_i, v_i, period, 1, 20001)[:, :3], axis=1) - SEMI_MAJOR
    low, high = orbits.extremes(r_i, v_i)
    assert float(low) == pytest.approx(height.min(), abs=60.0)
    assert float(high) == pytest.approx(height.max(), abs=100.0)


def test_along_an_orbit_the_mean_stays_where_the_osculating_swings():
    r_i, v_i = state("sun-synchronous")
    y = flights.coast(r_i, v_i, np.linspace(0.0, 5700.0, 60)).y.T
    mean = orbits.mean(y[:, :3], y[:, 3:])
    assert np.ptp(orbits.osculating(y[:, :3], y[:, 3:]).semi_major_axis) > 15e3
    assert np.ptp(mean.semi_major_axis) < 40.0
    assert np.ptp(mean.perigee) < 60.0
    assert np.ptp(mean.inclination) < 2e-6


def test_the_node_of_a_sun_synchronous_orbit_follows_the_sun():
    """360 deg in a tropical year at 97.40 deg and 500 km (Vallado, Fundamentals of Astrodynamics, section 11.4)."""
    r_i, v_i = state_from_elements(Elements(SEMI_MAJOR + 500e3, 1e-3, np.radians(97.40), 0.3, 1.0, 2.0))
    day = 86400.0
    y = flights.coast(r_i, v_i, np.array([0.0, day])).y.T
    first, last = orbits.mean(y[0, :3], y[0, 3:]), orbits.mean(y[-1, :3], y[-1, 3:])
    assert np.degrees(float(last.node - first.node)) == pytest.approx(360.0 / 365.2422, rel=5e-3)


def test_osculating_elements_are_those_of_the_frames_module():
    r_i, v_i = state("transfer")
    found, other = orbits.osculating(r_i, v_i), elements_from_state(r_i, v_i)
    assert float(found.semi_major_axis) == pytest.approx(float(other.semi_major_axis), rel=1e-12)
    assert float(found.eccentricity) == pytest.approx(float(other.eccentricity), rel=1e-12)
    assert float(found.inclination) == pytest.approx(float(other.inclination), rel=1e-12)
    assert float(found.node) == pytest.approx(float(other.node), rel=1e-12)


def test_what_is_no_closed_orbit_has_no_mean():
    r_i = np.array([7e6, 0.0, 0.0])
    falls, escapes = np.array([0.0, 500.0, 0.0]), np.array([0.0, 12e3, 0.0])
    for v_i in (falls, escapes):
        assert np.isnan(orbits.mean(r_i, v_i).semi_major_axis)
        assert np.isnan(orbits.mean(r_i, v_i).perigee)
