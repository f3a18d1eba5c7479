import numpy as np

from lvnav_trade.filters.integrity.state import begin_monitor, new_monitor, permitted


def test_an_excluded_channel_has_a_gate_that_nothing_passes():
    own = new_monitor(5, 4, 4, 3)
    own.out[2] = 3.0
    assert [permitted(own, channel, 9.0) for channel in range(4)] == [9.0, 9.0, -1.0, 9.0]
    assert permitted(None, 2, 9.0) == 9.0


def test_a_run_begins_with_every_channel_in_use_and_nothing_past():
    own = new_monitor(5, 4, 4, 3)
    for array in own:
        array[...] = 7.0
    begin_monitor(own)
    for name in ("out", "past", "waited"):
        np.testing.assert_array_equal(getattr(own, name), 0.0)
