"""Allan deviation of a simulated stream of a case's units, beside the closed form of their cards."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics.imu_stream import allan_curves, card_deviations
from lvnav_trade.imu.error_model import AccelCard, GyroCard
from tests.building import TURNED, case, loaded, prepare_hop, with_units

FULL = (
    "base.imu.process_rate=10 Hz", "base.imu.gyro.random_walk=0.03 deg/sqrt(h)",
    "base.imu.gyro.rate_random_walk=3 deg/h/sqrt(h)", "base.imu.gyro.bias_instability=1 deg/h",
    "base.imu.gyro.instability_fit={processes: 4, shortest: 1 s, longest: 300 s}",
    "base.imu.gyro.scale_factor=1 percent",
    "base.imu.gyro.temperature={end: 10 s, amplitude: [90 deg/h, 0 deg/h, 0 deg/h]}",
    "base.imu.accel.random_walk=0.05 mg/sqrt(Hz)", "base.imu.accel.rate_random_walk=0.5 mg/sqrt(h)",
    "base.imu.accel.quantisation=0.1 mm/s", "base.imu.accel.bias_instability=0 mg",
)  # fmt: skip


def test_the_stream_follows_the_curve_of_the_card():
    curves = allan_curves(case(*FULL), 4000.0, 3)
    assert [(one.sensor, one.unit) for one in curves] == [("gyro", "rad/s"), ("accelerometer", "m/s^2")]
    for one in curves:
        assert one.tau[0] == pytest.approx(0.1)
        assert one.tau[-1] == pytest.approx(400.0, rel=0.01)
        np.testing.assert_allclose(one.card**2, one.white**2 + one.instability**2 + one.walk**2, rtol=1e-12)
        # tau over 4000 s intervals of three axes: 1 / sqrt(6 n) a deviation, of which three
        bound = 0.04 + 3.0 / np.sqrt(6.0 * 4000.0 / one.tau)
        assert np.all(np.abs(one.stream / one.card - 1.0) < bound)
    gyro, accel = curves
    assert np.all(gyro.instability == gyro.instability[0])
    assert not accel.instability.any()
    # quantisation falls as 1 / tau, white noise as its root
    white = 0.05e-3 * 9.80665 / np.sqrt(accel.tau)
    np.testing.assert_allclose(accel.white**2 - white**2, (1e-4 / np.sqrt(12.0)) ** 2 * 3.0 / accel.tau**2, rtol=1e-9)


def test_one_process_of_a_stated_time_has_its_own_curve():
    card = GyroCard(bias_instability="1 deg/h", instability_time="50 s")
    _, instability, walk = card_deviations(card, np.array([5.0, 94.5, 2000.0]))
    assert instability[1] == pytest.approx(0.618 * card.bias_instability, rel=2e-3)
    assert max(instability[0], instability[2]) < 0.7 * instability[1]
    assert not walk.any()
    assert not any(part.any() for part in card_deviations(AccelCard(), np.array([1.0])))


def test_the_curve_of_a_card_that_states_the_floor_is_that_floor():
    fit = {"processes": 2, "convention": "floor"}
    card = GyroCard(bias_instability=["1 deg/h", "1 deg/h", "3 deg/h"], instability_fit=fit)
    _, instability, _ = card_deviations(card, np.array([1.0, 100.0]))
    np.testing.assert_allclose(instability, np.sqrt(11.0 / 3.0) * np.radians(1.0 / 3600.0), rtol=1e-12)


def test_every_unit_of_a_set_has_curves_of_its_own():
    noisier = {
        "gyro": {"random_walk": "0.3 deg/sqrt(h)", "bias_instability": "0 deg/h", "instability_fit": None},
        **TURNED,
    }
    curves = allan_curves(prepare_hop(with_units(loaded(*FULL[:5]), [{}, noisier])), 500.0, 3)
    names = [f"unit {k} {sensor}" for k in (1, 2) for sensor in ("gyro", "accelerometer")]
    assert [one.sensor for one in curves] == names
    assert curves[2].stream[0] / curves[0].stream[0] == pytest.approx(10.0, rel=0.05)
    assert not curves[2].instability.any()


def test_a_stream_that_is_too_short_has_none():
    assert allan_curves(case(*FULL), 0.5, 3) == ()
