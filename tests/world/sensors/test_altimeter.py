"""The card of a radar altimeter: what it must say, and what is refused in one line."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from lvnav_trade.world.sensors.altimeter import AltimeterCard

CARD = {"name": "test", "source": "none", "sigma": "1 m", "highest": "5 km"}


def test_units_are_read_and_what_is_not_said_is_zero():
    card = AltimeterCard.model_validate({**CARD, "share": "2 percent"})
    assert (card.sigma, card.share, card.highest, card.bias, card.lowest, card.bias_time) == (1, 0.02, 5000, 0, 0, None)


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [("sigma", "0 m", "greater than 0"), ("lowest", "6 km", "below highest"), ("highest", "0 m", "greater than 0")],
)
def test_what_cannot_be_is_refused(field, value, told):
    with pytest.raises(ValidationError, match=told):
        AltimeterCard.model_validate({**CARD, field: value})
