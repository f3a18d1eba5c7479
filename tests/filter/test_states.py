"""Which states a filter has, and in which order."""

from __future__ import annotations

from tests.filter.test_model import SOLUTION, accepted


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
