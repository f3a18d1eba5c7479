"""The field by IGRF-14: published values, an independent evaluation, and what every potential field obeys."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import lpmv

from lvnav_trade.quantities.frames import ecef_from_geodetic, rotation_e_n
from lvnav_trade.sensors.geomagnetism import (
    DEGREE,
    RADIUS,
    coefficients,
    decimal_year,
    field,
    gradient,
    legendre,
    model_years,
)


def north_east_down(latitude, longitude, height, epoch, degree=DEGREE):
    """The field in nT at geodetic coordinates (deg, m)."""
    at = np.radians(latitude), np.radians(longitude)
    found = field(ecef_from_geodetic(*at, height), decimal_year(epoch), degree)
    return 1e9 * rotation_e_n(*at) @ found


# Published examples of a calculator (MathWorks, igrfmagm, IGRF-13: five digits; since then 2020 became definitive)
PUBLISHED = [
    (42.283, -71.35, 1000.0, "2015-07-04T00:00:00Z", (19471, -5086, 48177)),
    (38.957114, -95.253997, 0.0, "2018-05-14T00:00:00Z", (20655, 783, 47990)),
    (38.957114, -95.253997, 1e7, "2018-05-14T00:00:00Z", (1192, 46, 2571)),
]
# Computed with ppigrf 2.1.0 (University of Bergen) and the coefficients of IGRF-14
INDEPENDENT = [
    (5.2, -52.8, 300e3, "2024-03-20T00:00:00Z", (22913.24, -7153.50, 5362.12)),
    (69.3, 16.0, 100e3, "2026-11-22T00:00:00Z", (10430.77, 1657.17, 50391.02)),
    (-60.0, 170.0, 1000e3, "1957-01-01T00:00:00Z", (5701.76, 4346.34, -41247.78)),
]


@pytest.mark.parametrize(("latitude", "longitude", "height", "epoch", "expected"), PUBLISHED)
def test_it_is_the_field_that_is_published(latitude, longitude, height, epoch, expected):
    np.testing.assert_allclose(north_east_down(latitude, longitude, height, epoch), expected, atol=2.5)  # nT


@pytest.mark.parametrize(("latitude", "longitude", "height", "epoch", "expected"), INDEPENDENT)
def test_it_is_the_field_that_another_program_computes(latitude, longitude, height, epoch, expected):
    np.testing.assert_allclose(north_east_down(latitude, longitude, height, epoch), expected, atol=0.3)  # nT


def test_legendre_functions_are_those_of_scipy_in_the_normalisation_of_schmidt():
    colatitude = np.array([0.1, 1.0, 2.0, 3.0])
    P, dP = legendre(np.cos(colatitude), np.sin(colatitude), DEGREE)
    low, high = (legendre(np.cos(colatitude + d), np.sin(colatitude + d), DEGREE)[0] for d in (-1e-6, 1e-6))
    for n in range(1, DEGREE + 1):
        for m in range(n + 1):
            product = np.prod(np.arange(n - m + 1, n + m + 1, dtype=float))
            scale = (-1.0) ** m * np.sqrt((2.0 if m else 1.0) / product)
            np.testing.assert_allclose(P[n][m], scale * lpmv(m, n, np.cos(colatitude)), atol=1e-12)
            np.testing.assert_allclose(dP[n][m], (high[n][m] - low[n][m]) / 2e-6, atol=1e-7)


def test_the_first_degree_is_a_dipole():
    year, r = 2025.0, np.array([[4e6, -3e6, 5e6], [-7e6, 1e6, 2e6]])
    g, h = coefficients(year)
    moment = 1e-9 * RADIUS**3 * np.array([g[1, 1], h[1, 1], g[1, 0]])
    distance = np.linalg.norm(r, axis=1)[:, None]
    along = np.sum(r * moment, axis=1)[:, None]
    np.testing.assert_allclose(field(r, year, 1), 3.0 * along * r / distance**5 - moment / distance**3, rtol=1e-12)


def test_the_gradient_is_symmetric_and_without_trace_as_outside_all_sources():
    found = gradient(ecef_from_geodetic(np.radians([69.0, -5.0]), np.radians([16.0, -50.0]), 2e5), 2024.5)
    scale = np.abs(found).max()
    np.testing.assert_allclose(found, np.swapaxes(found, 1, 2), atol=1e-5 * scale)
    np.testing.assert_allclose(np.trace(found, axis1=1, axis2=2), 0.0, atol=1e-5 * scale)


def test_a_year_between_is_interpolated_and_one_outside_is_refused():
    assert model_years() == (1900.0, 2030.0)
    halfway = [coefficients(year)[0][1, 0] for year in (2020.0, 2022.5, 2025.0)]
    assert halfway == pytest.approx([-29403.41, 0.5 * (-29403.41 - 29350.0), -29350.0])
    assert decimal_year("2024-07-02T00:00:00Z") == pytest.approx(2024.5)
    for year in (1899.9, 2030.1):
        with pytest.raises(ValueError, match="1900 to 2030"):
            coefficients(year)
