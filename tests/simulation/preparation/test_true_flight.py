"""The true flight of a case: epochs on ticks, stamps of late measurements, what faults add to ranges."""

from __future__ import annotations

import numpy as np

from lvnav_trade.simulation.preparation.true_flight import epochs_of, flight_of
from lvnav_trade.trajectory.flight import reference
from tests.building import case, hop, loaded, with_fields


def test_epochs_are_on_ticks_of_the_strapdown():
    prepared_case = case()
    card = with_fields(prepared_case.scenario.filter, strapdown={"ratio": 4})
    epochs = epochs_of(prepared_case.scenario.model_copy(update={"filter": card}), prepared_case.reference)
    assert epochs.group == 4
    assert not np.any(epochs.tick % 4)
    np.testing.assert_array_equal(epochs.t, prepared_case.reference.t[epochs.tick])


def build_flight(**fields):
    scenario = with_fields(loaded(), **fields)
    return flight_of(scenario, (hop(), reference(hop(), scenario.imu.rate)))


def test_a_bias_of_a_fault_and_the_offset_of_a_spoofer_add_up_in_the_ranges():
    bias = {"kind": "range_bias", "size": "60 m", "start": "5 s", "duration": "10 s"}
    spoofer = {"kind": "spoofing", "velocity": ["3 m/s", "-2 m/s", "0 m/s"], "start": "8 s", "duration": "10 s"}
    one, two, both = build_flight(faults=[bias]), build_flight(faults=[spoofer]), build_flight(faults=[bias, spoofer])
    np.testing.assert_allclose(both.fault_errors, one.fault_errors + two.fault_errors, atol=1e-8)
    assert sorted(set(one.fault_errors[..., 0].ravel().tolist())) == [0.0, 60.0]
    # 5 s after its begin the place is 5 s of its velocity away: the ranges differ by no more, and some by most of it
    at = int(np.flatnonzero(two.epochs.t == 13.0)[0])
    assert 0.5 * 5.0 * np.sqrt(13.0) < np.abs(two.fault_errors[at, :, 0]).max() < 5.0 * np.sqrt(13.0)


def test_a_receiver_stamps_what_it_knows_of_its_latency_and_not_what_a_fault_adds():
    late = {"kind": "latency_change", "by": "0.2 s", "start": "10 s", "duration": "5 s"}
    flight = build_flight(**{"receiver.latency": "0.1 s", "faults": [late]})
    np.testing.assert_allclose(flight.epochs.t - flight.time_tags, 0.1, atol=1e-9)
    within = (flight.epochs.t >= 10.0) & (flight.epochs.t < 15.0)
    np.testing.assert_allclose((flight.epochs.t - flight.sky.t)[within], 0.3, atol=1e-9)
