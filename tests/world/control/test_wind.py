"""Wind over height: direction, profile, gusts, and what the card refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.frames import rotation_e_n
from lvnav_trade.world.control.wind import WindCard, air
from tests.world.flights import CONFIGS, _load

GIVEN = {
    "name": "test", "source": "test", "height": ["0 m", "10 km"], "speed": ["0 m/s", "20 m/s"], "direction": "270 deg",
    "gust": ["3 m/s", "1 m/s"], "gust_length": ["100 m", "500 m"],
}  # fmt: skip


def card(**changes):
    return WindCard.model_validate({**GIVEN, **changes})


def test_a_west_wind_blows_to_the_east_and_grows_straight_between_heights():
    latitude, longitude, height = np.array([0.5, 0.5]), np.array([-1.0, -1.0]), np.array([5000.0, 20000.0])
    around = air(card(), latitude, longitude, height)
    local = np.einsum("kij,kaj->kai", rotation_e_n(latitude, longitude), around.steady_e)
    np.testing.assert_allclose(local[0, 0], [0.0, 10.0, 0.0], atol=1e-12)
    assert abs(local[0, 0] @ local[0, 1]) < 1e-12
    assert np.linalg.norm(local[0, 1]) == pytest.approx(10.0)
    assert not local[1].any()  # none above the table
    np.testing.assert_allclose(around.gust, [2.0, 0.0])
    np.testing.assert_allclose(around.length, [300.0, 500.0])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speed": ["1 m/s"]}, "2 heights but 1 entries of speed"),
        ({"height": ["5 m", "5 m"]}, "height must rise"),
        ({"gust": ["1 m/s", "-1 m/s"]}, "greater than or equal to 0"),
        ({"gust_length": ["0 m", "1 m"]}, "greater than 0"),
        ({"speed": ["1 m", "1 m"]}, "wrong unit"),
    ],
)
def test_a_card_that_contradicts_itself_is_reported_where(changes, message):
    with pytest.raises(ValidationError, match=message):
        card(**changes)


def test_the_shipped_gusts_are_the_moderate_ones_of_the_specification():
    # MIL-F-8785C, probability 1e-3: 9.6 ft/s at 1750 ft, 8.0 at 15000 ft, 2.7 at 55000 ft; scale 1750 ft.
    shipped = WindCard.model_validate(_load("wind/moderate"))
    foot = 0.3048
    around = air(shipped, np.zeros(3), np.zeros(3), np.array([1750.0, 15000.0, 55000.0]) * foot)
    np.testing.assert_allclose(around.gust, np.array([9.6, 8.0, 2.7]) * foot, rtol=5e-3)
    np.testing.assert_allclose(around.length, 1750.0 * foot, rtol=1e-3)
    # Low altitude: scale h / (0.177 + 0.000823 h)^1.2, in feet.
    for metres in (10.0, 150.0):
        h = metres / foot
        scale = h / (0.177 + 0.000823 * h) ** 1.2 * foot
        assert np.interp(metres, shipped.height, shipped.gust_length) == pytest.approx(scale, rel=0.02)
    assert math.degrees(shipped.direction) == pytest.approx(270.0)
    assert (CONFIGS / "wind/moderate.yaml").exists()
