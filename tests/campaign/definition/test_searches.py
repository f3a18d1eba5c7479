"""What a campaign may ask to be searched."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from lvnav_trade.campaign.definition.searches import Indices, Solve, Tune, Vary


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "vary has either between or values"),
        ({"between": ("1 deg", "2 deg"), "values": ("1 deg", "2 deg")}, "vary has either between or values"),
        ({"values": ("1 deg",)}, "give two values or more, and no log"),
        ({"values": ("1 deg", "2 deg"), "log": True}, "give two values or more, and no log"),
    ],
)
def test_a_field_is_varied_between_values_or_over_a_list(fields, message) -> None:
    with pytest.raises(ValidationError, match=message):
        Vary(path="initial.heading", **fields)


def test_one_or_two_fields_are_solved_for_and_no_block_is_empty() -> None:
    one = Vary(path="initial.heading", between=("1 deg", "2 deg"))
    assert len(Solve(vary=(one, one)).vary) == 2
    for wrong in ((), (one, one, one)):
        with pytest.raises(ValidationError):
            Solve(vary=wrong)
    with pytest.raises(ValidationError):
        Tune(variables=())
    with pytest.raises(ValidationError):
        Indices(factor=1.0)
