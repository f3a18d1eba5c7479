"""What stretches tell of the states: ranks counted, and directions known by their words."""

from __future__ import annotations

from lvnav_trade.metrics.filter.observed import is_position_bias, observed
from tests.vehicle_tables import tables


def test_ranks_are_counted_over_all_stretches():
    row = observed(tables()).iloc[0]
    assert (row.stretches, row.states, row.least_rank, row.least_rank_with_information) == (2, 3, 3, 2)
    assert row.smallest_ratio == 2e-3
    assert row.position_against_bias_ratio == 0.5
    assert row.weakest == "+1.00 gyro bias x"


def test_directions_in_which_a_position_trades_with_its_bias_are_known_by_their_words():
    assert is_position_bias("+1.00 position bias x, -0.80 position north")
    assert not is_position_bias("+1.00 position north")
    assert not is_position_bias("+1.00 position bias x, +0.60 gyro bias x")
