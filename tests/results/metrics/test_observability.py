"""Ranks of the observability as metrics."""

from __future__ import annotations

from lvnav_trade.results.evaluate import evaluate_single, name_of
from lvnav_trade.results.metrics.observability import METRICS
from tests import vehicle_tables


def test_states_with_information_are_fewer_than_those_beyond_rounding():
    tables = vehicle_tables.tables()
    rank, informed = (
        evaluate_single(tables, "aaaaaaaaaaaa", {"metric": name}, "-") for name in (one.name for one in METRICS)
    )
    assert (rank.value, informed.value) == (3.0, 2.0)
    assert informed.remark == "2 stretches, singular values above 0.01; least informed: +1.00 gyro bias x"


def test_a_rank_is_of_a_whole_flight():
    assert name_of({"metric": "observable_states"}) == "observable_states, least of all stretches"
