"""Gravitation against published values and against its own potential."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels import earth
from tests.potential import potential_j4

# Points from the surface to 20 000 km, both hemispheres, near the pole and the equator (m).
POINTS = [
    (6378137.0, 0.0, 0.0),
    (4792866.638, 0.0, 4792866.638),
    (-2700628.97, -4292443.61, 3855152.80),
    (100.0, -200.0, -6356752.0),
    (1.2e7, -9.0e6, -2.0e7),
]


def gradient(function, point, step):
    """Central difference of a function of x, y, z with one value or a tuple of values: rows over x, y, z."""
    rows = []
    for axis in range(3):
        up, down = list(point), list(point)
        up[axis] += step
        down[axis] -= step
        rows.append((np.asarray(function(*up)) - np.asarray(function(*down))) / (2.0 * step))
    return np.array(rows)


def test_wgs84_constants_are_the_published_ones():
    assert pytest.approx(6356752.3142, abs=5e-5) == earth.SEMI_MINOR
    assert pytest.approx(6.69437999014e-3, abs=5e-14) == earth.ECCENTRICITY_2
    assert pytest.approx(1.0826298e-3, abs=5e-11) == earth.J2


def test_j2_gravitation_has_the_published_values():
    assert earth.gravity_j2(6378137.0, 0.0, 0.0)[0] == pytest.approx(-9.81419735, abs=5e-9)
    assert earth.gravity_j2(0.0, 0.0, 6356752.3142)[2] == pytest.approx(-9.83206685, abs=5e-9)
    rotating = 9.81419735 - earth.OMEGA**2 * earth.SEMI_MAJOR
    assert rotating == pytest.approx(9.780281647, abs=5e-9)
    g = earth.gravity_j2(4792866.638, 0.0, 4792866.638)
    assert np.allclose(g, (-6.1215916, 0.0, -6.13923451), rtol=0.0, atol=5e-8)


@pytest.mark.parametrize("point", POINTS)
def test_j4_gravitation_is_the_gradient_of_its_potential(point):
    # A step of 50 m: rounding of the 6e7 m^2/s^2 potential leaves 1e-10 m/s^2, truncation less.
    difference = gradient(potential_j4, point, 50.0)
    assert np.allclose(earth.gravity_j4(*point), difference, rtol=0.0, atol=2e-9)


@pytest.mark.parametrize("point", POINTS)
def test_higher_zonals_add_less_than_a_ten_thousandth(point):
    j4, j2 = np.array(earth.gravity_j4(*point)), np.array(earth.gravity_j2(*point))
    assert 0.0 < np.linalg.norm(j4 - j2) < 2e-4
    point_mass = np.array(earth.gravity_point(*point))
    assert np.linalg.norm(j2 - point_mass) < 0.035  # 3 J2 g at the pole


@pytest.mark.parametrize("point", POINTS)
def test_gravity_gradient_is_the_derivative_of_j2_gravitation(point):
    full = gradient(earth.gravity_j2, point, 100.0)
    xx, xy, xz, yy, yz, zz = earth.gravity_gradient(*point)
    ours = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    assert np.allclose(ours, full, rtol=0.0, atol=2e-14)  # of 3e-6 1/s^2
    assert abs(np.trace(ours)) < 1e-20 + 1e-15 * abs(zz)  # Laplace


def test_gravitation_of_an_array_is_that_of_each_point():
    r = np.array(POINTS)
    assert np.array_equal(earth.gravity_along(r), np.array([earth.gravity_j4(*point) for point in POINTS]))


def test_surface_gravity_of_the_zonal_field_is_normal_gravity_within_the_odd_and_truncated_terms():
    # Somigliana at 45 deg: 9.806197769 m/s^2; J3 and the terms past J4 leave some 1e-5 m/s^2.
    lat = np.pi / 4
    normal = earth.SEMI_MAJOR / np.sqrt(1.0 - earth.ECCENTRICITY_2 * np.sin(lat) ** 2)
    x, z = normal * np.cos(lat), (1.0 - earth.ECCENTRICITY_2) * normal * np.sin(lat)
    g = np.array(earth.gravity_j4(x, 0.0, z)) + np.array([earth.OMEGA**2 * x, 0.0, 0.0])
    assert np.linalg.norm(g) == pytest.approx(9.806197769, abs=4e-5)
