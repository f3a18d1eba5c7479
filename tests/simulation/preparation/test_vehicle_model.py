"""What a flight with an attitude reference takes in: burns by events, steps by the envelope, noise of a sample."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lvnav_trade.quantities.shared_cards import EnvelopeCard
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.vehicle_model import burning, burns, envelopes
from tests.both_engines.modelled import BASELINE, SETTINGS, modelled, named
from tests.building import case, loaded, prepare_hop, with_fields


def flight(**events):
    return replace(named(), events=events)


def test_burns_are_known_by_lift_off_ignitions_and_cut_offs():
    three = flight(liftoff=0.0, kick=3.0, stage1_cutoff=10.0, stage1_separation=11.0, stage2_ignition=15.0,
                   stage2_cutoff=20.0, stage3_ignition=25.0)  # fmt: skip
    assert burns(three) == [(0.0, 10.0), (15.0, 20.0), (25.0, three.end)]
    np.testing.assert_array_equal(burning(three, np.array([-1.0, 0.0, 9.9, 10.0, 15.0, 24.0, 26.0])),
                                  [False, True, True, False, True, False, True])  # fmt: skip


def test_steps_follow_the_phases_of_the_envelope():
    prepared_case = modelled()
    walk, t = prepared_case.options.vehicle.walk, prepared_case.reference.t[:-1]
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
    vehicle, samples = modelled().options.vehicle, modelled().options.reported_samples
    # 144 deg/h and 23.4 mg: the noise that table 2 of Beaudoin et al. rests on
    assert math.degrees(math.sqrt(vehicle.variance[0])) * 3600.0 == pytest.approx(144.0, rel=1e-4)
    assert math.sqrt(vehicle.variance[3]) / 9.80665e-3 == pytest.approx(23.4, rel=1e-4)
    assert math.sqrt(samples.raw[3]) == pytest.approx(9.80665e-3 * math.hypot(23.4, 7.5), rel=1e-4)


def test_true_motion_is_the_mean_over_each_tick():
    prepared_case = modelled()
    dt = 1.0 / 200.0
    np.testing.assert_allclose(prepared_case.options.vehicle.rate * dt, prepared_case.reference.dtheta, rtol=1e-14)
    np.testing.assert_allclose(prepared_case.options.vehicle.force * dt, prepared_case.reference.dvel, rtol=1e-14)


def test_other_filters_have_no_such_settings_and_the_baseline_has_no_steps():
    assert case().options.vehicle is None
    assert case().options.reported_samples is None
    assert modelled(BASELINE).options.vehicle is None
    assert modelled(BASELINE).options.reported_samples is not None


@pytest.mark.parametrize(
    ("fields", "reported"),
    [
        ({"sensors": {}}, "filter.measurements: no sensor of the scenario measures attitude"),
        ({"imu.accel.quantisation": "1 mm/s"}, "imu: quantisation correlates a sample with the next one"),
    ],
)
def test_a_scenario_that_the_filter_does_not_know_is_refused(fields, reported):
    scenario = loaded(*SETTINGS, "base.imu=imu/kvh1750_003", "base.filter=filters/vehicle_model_003")
    with pytest.raises(ValueError, match=reported):
        with_fields(scenario, **fields)


OTHER = {
    "roll": 0.004, "burn": 0.01, "coast": 0.003, "turn_gain": 2.0, "turn_time": 1.0, "axial_burn": 10.0,
    "axial_coast": 5.0, "axial_change": 1000.0, "before_change": 0.5, "after_change": 3.0, "lateral": 5.0,
    "nozzle_gain": 10.0, "nozzle_time": 0.1, "start_rate": 0.1, "start_acceleration": 5.0,
}  # fmt: skip
START = {"start_rate", "start_acceleration"}


def steps(card):
    """Return what a filter with this envelope assumes around a cut-off while it turns and moves its nozzle."""
    t = np.arange(0.0, 20.0, 0.005)
    turn, nozzle = (np.column_stack([scale * np.sin(t), scale * np.cos(t)]) for scale in (0.1, 0.02))
    return np.hstack(envelopes(card, t, t < 10.0, np.array([10.0]), turn, nozzle))


def test_another_value_is_known_for_every_field():
    assert set(OTHER) == set(EnvelopeCard.model_fields)


@pytest.mark.parametrize("name", sorted(set(OTHER) - START))
def test_a_field_of_the_envelope_changes_what_the_filter_assumes(name):
    assert not np.array_equal(steps(EnvelopeCard()), steps(EnvelopeCard().model_copy(update={name: OTHER[name]})))


@pytest.mark.parametrize(
    "fields",
    [{"filter__envelope": {"start_rate": "0.1 rad/s"}}, {"filter__envelope": {"start_acceleration": "5 m/s^2"}},
     {"filter__sensor_models": {"attitude": {"sigma": "3 deg"}}}],
    ids=["start_rate", "start_acceleration", "reference"],
)  # fmt: skip
def test_the_start_and_the_attitude_reference_that_are_assumed_change_a_run(fields):
    scenario = loaded(*SETTINGS, "base.imu=imu/kvh1750_003_published", "base.filter=filters/vehicle_model_003")
    changed = with_fields(scenario, **{name.replace("__", "."): value for name, value in fields.items()})
    one, two = (run_block(prepare_hop(s, named()), 1, 0, 8).sigma for s in (scenario, changed))
    differ = not np.array_equal(one, two)
    assert differ
