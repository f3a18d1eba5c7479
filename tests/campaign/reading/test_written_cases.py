"""The first case of a design that has a level."""

from __future__ import annotations

from lvnav_trade.campaign.definition.schema import Axis
from lvnav_trade.campaign.reading.axis_checks import WrittenAxis
from lvnav_trade.campaign.reading.written_cases import first_cases
from lvnav_trade.campaign.syntax.card_lookup import command_line_place
from lvnav_trade.campaign.syntax.tree import Node


def varied(path: str, *values: int) -> WrittenAxis:
    return WrittenAxis(Axis(path=path, values=values), Node({}, command_line_place("test")))


def test_a_level_is_first_in_the_earliest_case_that_has_it() -> None:
    axes = [varied("imu.rate", 1, 2), varied("filter.gate", 3, 4)]
    assert first_cases("grid", axes, [2, 2]) == {(0, 0): (0, 0), (0, 1): (1, 0), (1, 0): (0, 0), (1, 1): (0, 1)}
    assert first_cases("zip", axes, [2, 2]) == {(0, 0): (0, 0), (0, 1): (1, 1), (1, 0): (0, 0), (1, 1): (1, 1)}
    assert first_cases("one_at_a_time", axes, [2, 2])[1, 1] == (None, 1)


def test_what_a_later_axis_changes_has_no_first_case() -> None:
    axes = [varied("imu", 1, 2), varied("imu.rate", 3, 4)]
    assert {place for place, _ in first_cases("grid", axes, [2, 2])} == {1}


def test_a_zip_of_axes_of_different_lengths_has_none() -> None:
    assert first_cases("zip", [varied("imu.rate", 1, 2), varied("filter.gate", 3)], [2, 1]) == {}
