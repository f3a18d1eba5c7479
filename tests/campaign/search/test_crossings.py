"""Crossings of functions with a closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.campaign.search.crossings import search


def test_the_crossing_of_a_growing_error_is_found_and_named() -> None:
    """sqrt(1 + x^2) / 2 is 1 at sqrt(3); the other ratio crosses later."""
    seen: list[float] = []

    def ratio(x: float) -> dict[str, float]:
        seen.append(x)
        return {"first": math.hypot(1.0, x) / 2.0, "second": x / 5.0}

    found = search(ratio, np.geomspace(0.1, 10.0, 7), log=True)
    assert found.answer == pytest.approx(math.sqrt(3.0), rel=1e-3)
    assert (found.limiting_requirement, found.monotone) == ("first", True)
    assert len(seen) == len(set(seen)) < 20


def test_an_error_that_comes_back_is_not_monotone_and_has_its_intervals() -> None:
    found = search(lambda x: {"wave": 1.0 + math.sin(x)}, np.linspace(0.5, 12.0, 24), log=False)
    expected = [(math.pi, 2.0 * math.pi), (3.0 * math.pi, 12.0)]
    np.testing.assert_allclose(found.intervals, expected, rtol=2e-3)
    assert not found.monotone
    assert (found.answer, found.limiting_requirement) == (12.0, "")


def test_where_nothing_is_met_there_is_no_answer_and_what_binds_is_named() -> None:
    found = search(lambda x: {"a": 2.0 + x, "b": 3.0 + x}, np.linspace(0.0, 1.0, 3), log=False)
    assert math.isnan(found.answer)
    assert (found.intervals, found.limiting_requirement) == ((), "b")


def test_values_that_are_not_possible_are_passed_over_and_lists_are_not_refined() -> None:
    found = search(
        lambda x: {"a": math.nan if x == 2.0 else x / 3.5}, np.array([1.0, 2.0, 3.0, 4.0]), False, refine=False
    )
    assert (found.answer, found.limiting_requirement) == (3.0, "a")


@pytest.mark.parametrize("log", [False, True])
def test_an_impossible_value_between_two_possible_ones_ends_the_interval_at_the_permitted_grid_value(log: bool) -> None:
    """Of the grid 1, 2, 4 the ratio is 1 at 3; between 2.5 and 3.5 it is not possible."""
    result = search(lambda x: {"a": math.nan if 2.5 < x < 3.5 else x / 3.0}, np.array([1.0, 2.0, 4.0]), log=log)
    assert (result.answer, result.limiting_requirement) == (2.0, "a")
