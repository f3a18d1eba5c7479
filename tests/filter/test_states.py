"""Which states a filter has, and in which order."""

from __future__ import annotations

import pytest

from lvnav_trade.filter.states import NO_MEMORY, FilterMeasurements, state_layout
from lvnav_trade.quantities.reads import FieldReads
from tests.filter.test_model import IMU, RECEIVER, SOLUTION, accepted, card, channels


def test_a_tight_filter_has_17_states_and_a_loose_one_no_clock():
    tight, _ = accepted()
    loose, _ = accepted(measurements=SOLUTION)
    assert (tight.n_state, tight.clock, tight.n_estimated) == (17, 15, 17)
    assert (loose.n_state, loose.clock) == (15, -1)
    assert [(b.name, b.offset) for b in tight.parameters] == [("gyro_bias", 9), ("accel_bias", 12)]


def test_considered_states_stand_behind_all_estimated_ones():
    layout, _ = accepted(extra_states=("gyro_scale_factor",), consider=("gyro_bias", "gyro_scale_factor"))
    by_name = {b.name: b.offset for b in layout.parameters}
    assert layout.n_estimated == 9 + 3 + 2  # accelerometer bias and clock
    assert min(by_name["gyro_bias"], by_name["gyro_scale_factor"]) == layout.n_estimated
    assert layout.n_state == layout.n_estimated + 6


def test_the_layout_does_not_depend_on_how_extra_states_are_ordered_in_the_card():
    one, _ = accepted(extra_states=("gyro_scale_factor", "accel_scale_factor"))
    two, _ = accepted(extra_states=("accel_scale_factor", "gyro_scale_factor"))
    assert {b.name for b in one.parameters} == {b.name for b in two.parameters}
    assert one.n_state == two.n_state


@pytest.mark.parametrize("field", ["extra_states", "as_noise"])
def test_a_state_that_is_noise_has_no_correlation_time_so_that_one_that_is_given_counts_as_unread(field):
    reads = FieldReads(RECEIVER.model_copy(update={"range_bias": 3.0, "range_bias_time": 60.0}))
    layout = state_layout(card(**{field: ("range_bias",)}), FilterMeasurements(IMU, reads.card, channels()))
    assert "range_bias" in reads.paths
    assert ("range_bias_time" in reads.paths) == (field == "extra_states")
    assert layout.extras[0].time_constant == (60.0 if field == "extra_states" else NO_MEMORY)
