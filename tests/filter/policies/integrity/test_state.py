import numpy as np

from lvnav_trade.filter.policies.integrity.state import (
    begin_monitor,
    channel_gate,
    clear_innovations,
    fault_decisions,
    new_monitor,
)


def test_an_excluded_channel_has_a_gate_that_nothing_passes():
    own = new_monitor(5, 4, 4, 3)
    own.remaining_hold[2] = 3.0
    assert [channel_gate(own, channel, 9.0) for channel in range(4)] == [9.0, 9.0, -1.0, 9.0]
    assert channel_gate(None, 2, 9.0) == 9.0


def test_a_run_begins_with_every_channel_in_use_and_nothing_past():
    own = new_monitor(5, 4, 4, 3)
    for array in own:
        array[...] = 7.0
    begin_monitor(own)
    for name in ("remaining_hold", "recent_squares", "fault_counters"):
        np.testing.assert_array_equal(getattr(own, name), 0.0)


def test_what_is_past_is_forgotten_where_a_filter_starts_again():
    own = new_monitor(5, 4, 4, 3)
    own.recent_squares[...] = 7.0
    clear_innovations(own, 0.0)
    assert np.all(own.recent_squares == 7.0)
    clear_innovations(own, 1.0)
    assert np.all(own.recent_squares == 0.0)
    clear_innovations(None, 1.0)


def test_decisions_are_rows_of_run_time_kind_and_channel():
    isolated, excluded = np.zeros((2, 3)), np.zeros((2, 3, 4))
    isolated[0, 1], isolated[1, 2] = 1.0, 3.0
    excluded[0, 1, 2:] = 1.0
    found = fault_decisions(isolated, excluded, np.array([1.0, 2.0, 3.0]), 40)
    assert found.tolist() == [[40.0, 2.0, 1.0, 2.0], [40.0, 2.0, 1.0, 3.0], [41.0, 3.0, 3.0, -1.0]]
    assert fault_decisions(isolated * 0.0, excluded, np.arange(3.0), 0).shape == (0, 4)
