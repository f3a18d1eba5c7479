"""A baro-altimeter: its errors as heights in the standard atmosphere, and where there is no air."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.kernels.media.atmosphere import atmosphere
from lvnav_trade.sensors.barometer import BarometerCard
from lvnav_trade.sensors.sensor import FlightView

CARD = {"name": "baro", "source": "none", "sigma": "10 Pa", "highest": "30 km"}
HEIGHTS = np.array([0.0, 5e3, 11e3, 20e3, 40e3])
SPEED = 300.0


def flight(heights=HEIGHTS):
    n = len(heights)
    r = (6378137.0 + heights)[:, None] * np.array([1.0, 0.0, 0.0])
    v = np.cross([0.0, 0.0, OMEGA], r) + np.array([SPEED, 0.0, 0.0])
    zero = np.zeros((n, 3))
    return FlightView(np.arange(n, dtype=float), r, v, np.zeros((n, 4)), heights, np.zeros(n), zero, "2026-08-01")


def barometer(**fields):
    return BarometerCard.model_validate({**CARD, **fields})


def test_noise_of_the_pressure_is_that_height_by_which_the_standard_pressure_changes_so_much():
    found = barometer().noise_sigma(flight())
    for height, sigma in zip(HEIGHTS, found[:, 0], strict=True):
        low, high = (atmosphere(height + step)[1] for step in (-5.0, 5.0))
        slope = (low - high) / 10.0
        # gravity of the standard at sea level, by 0.3 % every 10 km less above
        assert sigma == pytest.approx(10.0 / slope, rel=1e-3 + 2.0 * height / 6.37e6)
    assert found[0, 0] == pytest.approx(0.83, abs=0.01)  # m; 8.3 m each hPa
    np.testing.assert_allclose(barometer().assumed_variance(barometer().matched_model(), flight()), found**2)


def test_lasting_errors_act_as_a_bias_by_height_and_by_dynamic_pressure():
    card = barometer(bias="30 m", bias_time="60 s", scale="1 percent", flow="2 percent")
    found = {error.field: error for error in card.correlated_errors()}
    at = {name: error.partials(flight(), 1)[:, 0, 0] for name, error in found.items()}
    np.testing.assert_array_equal(at["bias"], 1.0)
    np.testing.assert_array_equal(at["scale"], HEIGHTS)
    np.testing.assert_allclose(at["flow"], SPEED**2 / (2.0 * 9.80665), rtol=1e-9)  # 4.6 km: rho v^2 / 2 over rho g
    assert (found["bias"].time_constant, found["scale"].sigma, found["flow"].sigma) == (60.0, 0.01, 0.02)


def test_it_measures_up_to_its_height():
    assert barometer().is_available(flight()).tolist() == [True, True, True, True, False]
    np.testing.assert_array_equal(barometer().truth(flight())[:, 0], HEIGHTS)


@pytest.mark.parametrize(
    ("fields", "reported"),
    [
        ({"highest": "90 km"}, "highest: there is air to measure from the ground up to 86 km"),
        ({"highest": "0 km"}, "highest: there is air"),
        ({"sigma": "0 Pa"}, "greater than 0"),
        ({"sigma": "3 m"}, "wrong unit"),
        ({"above": "12 km", "below": "11 km"}, "above: should be less than below"),
    ],
)
def test_what_cannot_be_is_refused(fields, reported):
    with pytest.raises(ValidationError, match=reported):
        barometer(**fields)
