"""Cards of the vehicle under attitude control."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.quantities.frames import rotation_e_n
from lvnav_trade.trajectory.control_cards import ControllerCard, FeedbackCard, RotationCard, WindCard, air, rate_noise
from tests.trajectory.flight_cases import CONFIGS, _load


def settings():
    return _load("rotation/three_motor")


def test_a_stack_is_a_uniform_rod_unless_the_card_says_otherwise():
    # A rod about its middle: m L^2 / 12.
    card = RotationCard.model_validate(settings())
    length = card.stacks[0].length
    assert card.inertia(1, np.array([17500.0]))[0] == pytest.approx(17500.0 * length**2 / 12.0)
    given = settings()
    given["stacks"][1]["gyration"] = "25 %"
    assert RotationCard.model_validate(given).inertia(2, np.array([400.0]))[0] == pytest.approx(
        400.0 * (0.25 * 7.5) ** 2
    )


def test_the_shipped_nozzle_has_the_published_time_constant():
    # Beaudoin et al., equations 9 and 10: the dynamics of the nozzle as 1 / (0.035 s + 1).
    nozzle = RotationCard.model_validate(settings()).nozzle
    assert nozzle.time_constant == pytest.approx(0.035)
    assert math.degrees(nozzle.deflection_limit) == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("where", "value", "message"),
    [
        (("nozzle", "misalignment"), "5 deg", "misalignment of the thrust exceeds"),
        (("nozzle", "deflection_limit"), "0 deg", "greater than 0"),
        (("nozzle", "rate_limit"), "3 deg", "wrong unit"),
        (("thrusters", "release"), 1.0, "less than 1"),
        (("thrusters", "dead_band"), "0 deg", "greater than 0"),
    ],
)
def test_a_card_that_cannot_be_is_reported_where(where, value, message):
    given = settings()
    given[where[0]][where[1]] = value
    with pytest.raises(ValidationError, match=message):
        RotationCard.model_validate(given)


def test_noise_per_sample_is_density_by_root_of_rate_and_the_publication_multiplies_by_the_rate():
    # 0.72 deg/h/sqrt(Hz) at 200 Hz: 10.2 deg/h by the datasheet, 144 deg/h in the publication's percentages.
    unit = ImuCard.model_validate(_load("imu/kvh1750_003"))
    hour = math.radians(1.0) / 3600.0
    assert rate_noise(unit, "published") == pytest.approx(144.0 * hour, rel=1e-12)
    assert rate_noise(unit, "datasheet") == pytest.approx(10.1823 * hour, rel=1e-5)
    assert rate_noise(unit, "none") == 0.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gains": []}, "at least 1"),
        ({"gains": [{"attitude": -1.0, "rate": "0.1 s"}]}, "greater than or equal to 0"),
        ({"gains": [{"attitude": 1.0, "rate": "-0.1 s"}]}, "greater than or equal to 0"),
        ({"turns": [{"start": "liftoff", "axis": "roll", "angle": "1 deg", "duration": "3 s"}]}, "pitch"),
        ({"turns": [{"start": "liftoff", "axis": "yaw", "angle": "1 deg", "duration": "0 s"}]}, "greater than 0"),
        ({"guidance": {"period": "0 s"}}, "greater than 0"),
    ],
)
def test_a_controller_that_cannot_be_is_reported_where(changes, message):
    with pytest.raises(ValidationError, match=message):
        ControllerCard.model_validate({**_load("controllers/three_motor"), **changes})


def test_feedback_is_one_of_the_named_kinds():
    with pytest.raises(ValidationError, match="'true', 'raw' or 'filtered'"):
        FeedbackCard.model_validate({"rate": "smooth"})


GIVEN = {
    "name": "test", "source": "test", "height": ["0 m", "10 km"], "speed": ["0 m/s", "20 m/s"], "direction": "270 deg",
    "gust": ["3 m/s", "1 m/s"], "gust_length": ["100 m", "500 m"],
}  # fmt: skip


def card(**changes):
    return WindCard.model_validate({**GIVEN, **changes})


def test_a_west_wind_blows_to_the_east_and_grows_straight_between_heights():
    latitude, longitude, height = np.array([0.5, 0.5]), np.array([-1.0, -1.0]), np.array([5000.0, 20000.0])
    steady_e, gust, length = air(card(), latitude, longitude, height)
    local = np.einsum("kij,kaj->kai", rotation_e_n(latitude, longitude), steady_e)
    np.testing.assert_allclose(local[0, 0], [0.0, 10.0, 0.0], atol=1e-12)
    assert abs(local[0, 0] @ local[0, 1]) < 1e-12
    assert np.linalg.norm(local[0, 1]) == pytest.approx(10.0)
    assert not local[1].any()  # none above the table
    np.testing.assert_allclose(gust, [2.0, 0.0])
    np.testing.assert_allclose(length, [300.0, 500.0])


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
    _, gust, length = air(shipped, np.zeros(3), np.zeros(3), np.array([1750.0, 15000.0, 55000.0]) * foot)
    np.testing.assert_allclose(gust, np.array([9.6, 8.0, 2.7]) * foot, rtol=5e-3)
    np.testing.assert_allclose(length, 1750.0 * foot, rtol=1e-3)
    # Low altitude: scale h / (0.177 + 0.000823 h)^1.2, in feet.
    for metres in (10.0, 150.0):
        h = metres / foot
        scale = h / (0.177 + 0.000823 * h) ** 1.2 * foot
        assert np.interp(metres, shipped.height, shipped.gust_length) == pytest.approx(scale, rel=0.02)
    assert math.degrees(shipped.direction) == pytest.approx(270.0)
    assert (CONFIGS / "wind/moderate.yaml").exists()
