"""What a flight with an attitude reference takes in: burns by events, steps by the envelope, noise of a sample."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lvnav_trade.engines.vehicle import burning, burns
from tests.building import case, loaded, with_fields
from tests.engines.modelled import BASELINE, SETTINGS, modelled, named


def flight(**events):
    return replace(named(), events=events)


def test_burns_are_known_by_lift_off_ignitions_and_cut_offs():
    three = flight(liftoff=0.0, kick=3.0, stage1_cutoff=10.0, stage1_separation=11.0, stage2_ignition=15.0,
                   stage2_cutoff=20.0, stage3_ignition=25.0)  # fmt: skip
    assert burns(three) == [(0.0, 10.0), (15.0, 20.0), (25.0, three.end)]
    np.testing.assert_array_equal(burning(three, np.array([-1.0, 0.0, 9.9, 10.0, 15.0, 24.0, 26.0])),
                                  [False, True, True, False, True, False, True])  # fmt: skip


def test_steps_follow_the_phases_of_the_envelope():
    prepared = modelled()
    walk, t = prepared.vehicle.walk, prepared.reference.t[:-1]
    dt = 1.0 / 200.0
    burn, coast, change = (np.sqrt(walk[np.argmin(np.abs(t - at))]) / dt for at in (10.0, 27.0, 20.5))
    for found, unknown, axial in ((burn, 0.02, 15.0), (coast, 0.002, 10.0)):
        assert found[[0, 3, 4, 5]] == pytest.approx([0.002, axial, 10.0, 10.0])
        # the body pitches by 1 and rolls by 4 deg/s: pitch and yaw turn into each other by at most the product
        commanded = found[1:3] - unknown
        assert (commanded >= 0.0).all()
        assert (commanded <= 5.0 * math.radians(1.0) * math.radians(4.0)).all()
    assert change[3] == pytest.approx(15000.0)


def test_the_sigma_of_a_sample_is_density_times_root_of_the_rate():
    vehicle = modelled().vehicle
    # 144 deg/h and 23.4 mg: the noise that table 2 of Beaudoin et al. rests on
    assert math.degrees(math.sqrt(vehicle.variance[0])) * 3600.0 == pytest.approx(144.0, rel=1e-4)
    assert math.sqrt(vehicle.variance[3]) / 9.80665e-3 == pytest.approx(23.4, rel=1e-4)
    assert math.sqrt(vehicle.raw[3]) == pytest.approx(9.80665e-3 * math.hypot(23.4, 7.5), rel=1e-4)


def test_true_motion_is_the_mean_over_each_tick():
    prepared = modelled()
    dt = 1.0 / 200.0
    np.testing.assert_allclose(prepared.vehicle.rate * dt, prepared.reference.dtheta, rtol=1e-14)
    np.testing.assert_allclose(prepared.vehicle.force * dt, prepared.reference.dvel, rtol=1e-14)


def test_other_filters_have_no_such_settings_and_the_baseline_has_no_steps():
    assert case().vehicle is None
    vehicle = modelled(BASELINE).vehicle
    assert not vehicle.modelled
    assert not vehicle.walk.any()


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"attitude_reference": None}, "attitude_reference: a vehicle_model filter needs one"),
        ({"imu.gyro.scale_factor": "10 ppm"}, "imu.gyro.scale_factor: only noise and bias"),
        ({"imu.accel.quantisation": "1 mm/s"}, "imu.accel.quantisation: only noise and bias"),
    ],
)
def test_a_scenario_that_the_filter_does_not_know_is_refused(fields, told):
    scenario = loaded(*SETTINGS, "base.imu=imu/kvh1750_003", "base.filter=filters/vehicle_model_003")
    with pytest.raises(ValueError, match=told):
        with_fields(scenario, **fields)
