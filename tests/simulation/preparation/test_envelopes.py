"""Envelopes by phase, and the published improvements of rate and acceleration by their closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from ruamel.yaml import YAML

from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.quantities.shared_cards import EnvelopeCard, is_changing, steady_ratio
from lvnav_trade.simulation.preparation.vehicle_model import envelopes

RATE = 200.0
ROLL_OR_COAST, BOOST, LATERAL, AXIAL = 0.002, 0.02, 10.0, 15.0  # rad/s^2, m/s^3, section 2.3
# Beaudoin et al., table 2 (boost roll 88 %, pitch and yaw 64 %; x 50 %, y and z 58 %) to a decimal, and what the
# datasheet's noise gives: envelope, percent as published, as the datasheet means it, both sides without bias.
GYRO = [(ROLL_OR_COAST, 88.1, 57.2), (BOOST, 63.5, 8.8)]
ACCELEROMETER = [(LATERAL, 57.9, 79.4, 55.8, 4.5), (AXIAL, 49.8, 78.9, 47.3, 2.2)]


@pytest.fixture(scope="module")
def unit(root_of_tests):
    text = (root_of_tests / "configs/imu/kvh1750_003.yaml").read_text()
    return ImuCard.model_validate(YAML(typ="safe").load(text))


@pytest.fixture(scope="module")
def root_of_tests(request):
    return request.config.rootpath


def improvement(envelope, noise, rate, bias=0.0):
    """Return by what part the steady filter's sigma is below that of the raw measurement, which is charged a bias.

    envelope: standard deviation of the derivative (rad/s^2 or m/s^3); noise and bias of a measurement (rad/s or m/s^2);
    rate of measurements, Hz.
    """
    steady = steady_ratio((envelope / rate) ** 2, noise**2)
    return 1.0 - math.sqrt(steady) * noise / math.hypot(noise, bias)


@pytest.mark.parametrize(("envelope", "published", "datasheet"), GYRO)
def test_the_published_improvements_of_the_rate_follow_from_the_envelope(unit, envelope, published, datasheet):
    density = unit.gyro.random_walk
    assert 100.0 * improvement(envelope, density * RATE, RATE) == pytest.approx(published, abs=0.05)
    assert 100.0 * improvement(envelope, density * math.sqrt(RATE), RATE) == pytest.approx(datasheet, abs=0.05)


@pytest.mark.parametrize(("envelope", "published", "datasheet", "no_bias", "no_bias_datasheet"), ACCELEROMETER)
def test_the_published_improvements_of_the_acceleration_charge_the_raw_side_with_its_bias(
    unit, envelope, published, datasheet, no_bias, no_bias_datasheet
):
    density, bias = unit.accel.random_walk, unit.accel.bias_repeatability
    for factor, charged, free in ((RATE, published, no_bias), (math.sqrt(RATE), datasheet, no_bias_datasheet)):
        assert 100.0 * improvement(envelope, density * factor, RATE, bias) == pytest.approx(charged, abs=0.05)
        assert 100.0 * improvement(envelope, density * factor, RATE) == pytest.approx(free, abs=0.05)


def test_an_unknown_motion_leaves_the_measurement_as_it_is():
    # Published fig. 4: with a large driving noise the filtered value is the raw one.
    assert steady_ratio(1e6, 1.0) == pytest.approx(1.0, abs=1e-5)
    assert steady_ratio(1e-8, 1.0) == pytest.approx(1e-4, rel=1e-3)


def test_a_commanded_turn_widens_the_envelope_by_the_published_lag():
    # 5 / (2 s + 1) of a step of angular acceleration, 30 / (0.035 s + 1) of a steady nozzle rate.
    card, dt = EnvelopeCard(), 0.005
    t = np.arange(2001) * dt
    rate = np.column_stack([0.01 * t, np.zeros(t.size)])
    nozzle = np.column_stack([np.zeros(t.size), 0.2 * t])
    turning, jerk = envelopes(card, t, np.ones(t.size, dtype=bool), np.array([-100.0]), rate, nozzle)
    since = np.maximum(t - dt, 0.0)
    np.testing.assert_allclose(turning[:, 1], 5.0 * 0.01 * (1.0 - np.exp(-since / 2.0)) + 0.02, atol=1e-12)
    np.testing.assert_allclose(turning[:, 2], 0.02, atol=1e-15)
    np.testing.assert_allclose(turning[:, 0], 0.002, atol=1e-15)
    np.testing.assert_allclose(jerk[:, 1], 30.0 * 0.2 * (1.0 - np.exp(-since / 0.035)) + 10.0, atol=1e-9)
    np.testing.assert_allclose(jerk[:, 2], 10.0, atol=1e-12)


def test_phases_have_the_published_numbers_and_changes_last_from_one_second_before_to_two_after():
    card, t = EnvelopeCard(), np.arange(0.0, 20.0, 0.005)
    burning, changes = t < 10.0, np.array([10.0])
    still = np.zeros((t.size, 2))
    turning, jerk = envelopes(card, t, burning, changes, still, still)
    inside = is_changing(card, t, changes)
    np.testing.assert_array_equal(inside, (t >= 9.0 - 1e-9) & (t <= 12.0 + 1e-9))
    assert set(jerk[inside, 0]) == {15000.0}
    assert set(jerk[~inside & burning, 0]) == {15.0}
    assert set(jerk[~inside & ~burning, 0]) == {10.0}
    assert set(turning[~inside & ~burning, 1]) == {0.002}
    assert set(turning[inside | burning, 2]) == {0.02}
