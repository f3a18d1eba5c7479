"""The standard atmosphere against the published tables."""

from __future__ import annotations

import itertools

import pytest

from lvnav_trade.kernels.media.atmosphere import atmosphere

# US Standard Atmosphere 1976 (NOAA-S/T 76-1562), table 1: geometric m, kg/m^3, Pa, K.
TABLE = [
    (0.0, 1.2250, 101325.0, 288.150),
    (5000.0, 0.73643, 54048.0, 255.676),
    (11000.0, 0.36480, 22699.9, 216.774),
    (20000.0, 0.088910, 5529.3, 216.650),
    (30000.0, 0.018410, 1197.0, 226.509),
    (50000.0, 1.0269e-3, 79.779, 270.650),
    (70000.0, 8.2829e-5, 5.2209, 219.585),
    (80000.0, 1.8458e-5, 1.0524, 198.639),
]


@pytest.mark.parametrize(("height", "density", "pressure", "temperature"), TABLE)
def test_the_layers_have_the_published_values(height, density, pressure, temperature):
    ours = atmosphere(height)
    assert ours[0] == pytest.approx(density, rel=1e-4)
    assert ours[1] == pytest.approx(pressure, rel=1e-4)
    assert ours[2] == pytest.approx(temperature, abs=0.01)


def test_speed_of_sound_at_sea_level_is_340_29():
    assert atmosphere(0.0)[3] == pytest.approx(340.294, abs=0.002)


def test_density_does_not_jump_at_86_km():
    below, above = atmosphere(85999.9)[0], atmosphere(86000.1)[0]
    assert above == pytest.approx(below, rel=1e-3)


def test_density_falls_all_the_way_to_zero_beyond_1000_km():
    densities = [atmosphere(1000.0 * km)[0] for km in range(-4, 1001, 4)]
    assert all(later < earlier for earlier, later in itertools.pairwise(densities))
    assert atmosphere(1.2e6)[:2] == (0.0, 0.0)
