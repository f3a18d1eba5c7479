"""The card of a turning vehicle: inertia by closed form, and what it refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.world.control.body import RotationCard
from tests.world.flights import _load


def settings():
    return _load("rotation/three_motor")


def test_a_stack_is_a_uniform_rod_unless_the_card_says_otherwise():
    # A rod about its middle: m L^2 / 12.
    card = RotationCard.model_validate(settings())
    length = card.stacks[0].length
    assert card.inertia(1, np.array([17500.0]))[0] == pytest.approx(17500.0 * length**2 / 12.0)
    given = settings()
    given["stacks"][1]["gyration"] = "25 %"
    assert RotationCard.model_validate(given).inertia(2, np.array([400.0]))[0] == pytest.approx(
        400.0 * (0.25 * 7.5) ** 2
    )


def test_the_shipped_nozzle_has_the_published_time_constant():
    # Beaudoin et al., equations 9 and 10: the dynamics of the nozzle as 1 / (0.035 s + 1).
    nozzle = RotationCard.model_validate(settings()).nozzle
    assert nozzle.time_constant == pytest.approx(0.035)
    assert math.degrees(nozzle.deflection_limit) == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("where", "value", "message"),
    [
        (("nozzle", "misalignment"), "5 deg", "misalignment of the thrust exceeds"),
        (("nozzle", "deflection_limit"), "0 deg", "greater than 0"),
        (("nozzle", "rate_limit"), "3 deg", "wrong unit"),
        (("thrusters", "release"), 1.0, "less than 1"),
        (("thrusters", "dead_band"), "0 deg", "greater than 0"),
    ],
)
def test_a_card_that_cannot_be_is_reported_where(where, value, message):
    given = settings()
    given[where[0]][where[1]] = value
    with pytest.raises(ValidationError, match=message):
        RotationCard.model_validate(given)
