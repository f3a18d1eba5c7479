"""Published tropospheric models against other implementations' values."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from lvnav_trade.kernels.media.refractivity import bean_thayer_refractivity
from lvnav_trade.kernels.media.troposphere import any_elevation, niell, saastamoinen_zenith, spilker, stanag, weather

EARTH = 6371e3


@pytest.fixture(scope="module")
def vectors(refdata):
    return json.loads((refdata / "gnss/test_vectors/unit_check_vectors.json").read_text())


@pytest.fixture(params=["Saas", "NB"])  # the two of GPSTk's models that map as Niell does
def gpstk(request, refdata):
    """Columns elevation (deg), dry mapping, dry slant, wet mapping of GPSTk's output: 20 C, 1013 mbar, day 103."""
    lines = (refdata / f"gnss/test_vectors/gpstk_TropModel_{request.param}.exp").read_text().splitlines()
    rows = [line.split() for line in lines if line.split()[:1] == [request.param] and line.split()[1] != "Trop"]
    return np.array([[float(word) for word in row[1:5]] for row in rows])


def test_saastamoinen_has_the_values_of_rtklib(vectors):
    rows = [row for row in vectors["saastamoinen"]["rows"] if row[4] > 0.0]
    assert len(rows) == 3
    for latitude, _, height, elevation, delay in rows:
        air = weather(height, temperature=288.16)  # 15 + 273.16, as RTKLIB has it
        zenith = sum(saastamoinen_zenith(*air, np.radians(latitude), height))
        assert zenith / np.sin(np.radians(elevation)) == pytest.approx(delay, abs=1e-6)


def test_niell_has_the_values_of_rtklib(vectors):
    published = vectors["niell_mapping"]
    for elevation, values in ((75.0, published["el75"]), (3.0, published["el3"])):
        ours = niell(np.radians(elevation), np.radians(published["lat"]), published["h"], 16.25)
        assert ours == pytest.approx(values, abs=1e-9)


def test_niell_and_the_dry_zenith_have_the_values_of_gpstk(gpstk):
    # The site is Austin, Texas: 30.4 N, some 200 m high; the file gives neither, nor more than four decimals.
    latitude, height = np.radians(30.39), 170.0
    dry, wet = niell(np.radians(gpstk[:, 0]), latitude, height, 103.0)
    assert dry == pytest.approx(gpstk[:, 1], abs=3e-3, rel=2e-4)
    assert wet == pytest.approx(gpstk[:, 3], abs=3e-3, rel=2e-4)
    zenith, _ = saastamoinen_zenith(101300.0, 293.15, 0.0, latitude, height)
    assert zenith == pytest.approx(2.3095, abs=6e-4)
    assert zenith * dry == pytest.approx(gpstk[:, 2], rel=5e-4)


def test_niell_on_the_southern_half_is_half_a_year_later():
    north, south = niell(0.3, 0.6, 0.0, 28.0), niell(0.3, -0.6, 0.0, 28.0 + 365.25 / 2)
    assert np.array(north) == pytest.approx(np.array(south), rel=1e-12)
    assert north[0] != pytest.approx(niell(0.3, -0.6, 0.0, 28.0)[0], rel=1e-6)


def test_weather_falls_smoothly_to_nothing():
    height = np.arange(0.0, 100e3, 10.0)
    pressure, temperature, vapour = weather(height)
    slope = np.diff(np.log(pressure))
    assert np.all(slope < 0.0)
    assert np.all(np.diff(vapour) < 0.0)
    assert np.abs(np.diff(slope)).max() < 1e-3 * np.abs(slope).max()  # no corner, as from a step at 10 km
    assert pressure[-1] < 0.2
    assert weather(20e3)[0] == pytest.approx(5474.9, rel=0.01)  # US Standard Atmosphere 1976
    assert temperature[-1] == pytest.approx(216.65)


def test_spilker_has_its_zenith_delay_and_scale():
    assert spilker(np.pi / 2, 0.0) == pytest.approx(2.4405)
    assert spilker(np.pi / 2, 1e4) == pytest.approx(2.4405 * np.exp(-1.33))
    assert spilker(np.radians(5.0), 0.0) == pytest.approx(2.4405 * 1.0121 / (np.sin(np.radians(5.0)) + 0.0121))


def test_the_models_of_both_papers_are_one_above_five_degrees():
    elevation = np.radians([5.0, 10.0, 45.0, 90.0])[:, None]
    height = np.array([0.0, 3e3, 20e3])
    ours = any_elevation(elevation, height, EARTH, gain_law=False)
    assert ours == pytest.approx(spilker(elevation, height), rel=1e-4)  # 2.47 = 2.4405 x 1.0121, rounded


def test_the_formula_of_any_elevation_is_continuous_where_its_formulas_meet():
    height = np.array([0.0, 1e3, 12e3, 40e3])
    for meeting in (0.0, np.radians(5.0)):
        below, above = (any_elevation(meeting + side, height, EARTH) for side in (-1e-9, 1e-9))
        assert below == pytest.approx(above, abs=1e-5)


def test_the_formula_of_any_elevation_has_no_corner_at_five_degrees_without_the_gain_law():
    join, step = np.radians(5.0), 1e-5
    below, at, above = (any_elevation(join + k * step, 0.0, EARTH, gain_law=False) for k in (-1, 0, 1))
    assert (at - below) / step == pytest.approx((above - at) / step, rel=1e-3)


def test_the_formula_of_any_elevation_below_the_horizon_is_twice_the_ray_from_its_lowest_point_less_the_mirrored_one():
    height, elevation = 60e3, np.radians(-6.0)
    lowest = (EARTH + height) * np.cos(elevation) - EARTH  # eq. 3.5
    bracket = 2.0 / (np.sin(np.radians(5.0)) + 0.0121) - 1.0 / (np.sin(np.radians(10.0)) + 0.0121)
    grazing = 2.47 * (0.9 - lowest / (16.0 * 7518.8)) * np.exp(-lowest / 7518.8) * bracket  # eq. 3.3, 3.15 at zero
    mirrored = 2.47 * (1.0 - height / (16.0 * 7518.8)) * np.exp(-height / 7518.8) / (np.sin(-elevation) + 0.0121)
    assert any_elevation(elevation, height, EARTH) == pytest.approx(2.0 * grazing - mirrored, rel=1e-12)


def test_the_formula_of_any_elevation_gain_ends_at_sixteen_scale_heights():
    assert any_elevation(np.radians(30.0), 16.0 * 7518.8 + 1.0, EARTH) == 0.0
    assert any_elevation(np.radians(30.0), 15.0 * 7518.8, EARTH) > 0.0


@pytest.mark.parametrize("height", [-200.0, 0.0, 400.0, 1e3, 5e3, 9e3, 20e3, 60e3])
def test_stanags_zenith_delay_is_the_integral_of_its_refractivity(height):
    edges = [height, *(edge for edge in (1e3, 9e3) if edge > height), 250e3]
    parts = [quad(bean_thayer_refractivity, *span, epsabs=1e-9)[0] for span in pairwise(edges)]
    # the mapping of the zenith is one, as the tangent is infinite there
    assert stanag(0.5 * np.pi, height) == pytest.approx(1e-6 * sum(parts), rel=1e-9)


def test_stanag_differs_from_spilkers_formula_as_published():
    """Zenith 2.467 m against 2.4405 m, and 1.9 % more mapping at 10 deg."""
    assert stanag(0.5 * np.pi, 0.0) == pytest.approx(2.467, abs=1e-3)
    ten = np.radians(10.0)
    ratio = (stanag(ten, 0.0) / stanag(0.5 * np.pi, 0.0)) / (spilker(ten, 0.0) / spilker(0.5 * np.pi, 0.0))
    assert ratio == pytest.approx(1.019, abs=1e-3)
