"""What a campaign is made of: metrics, bounds, effects, the corridor."""

from __future__ import annotations

import math

import pytest

from lvnav_trade.campaign.definition.metric_names import required_metrics, unit_of
from lvnav_trade.campaign.definition.schema import Compare
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.errors import InputError

CORNERS = "[[-35 deg, -62 deg], [-35 deg, -50 deg], [-45 deg, -50 deg]]"


def test_every_metric_of_a_requirement_has_a_unit() -> None:
    found = {name: unit_of(name) for name in required_metrics()}
    assert found["velocity_error_3d"] == "m/s"
    assert found["attitude_error_roll"] == "rad"
    assert set(found.values()) == {"m", "m/s", "rad", "dimensionless", "sigma", "kg"}


def test_a_bound_is_held_in_si_and_written_with_its_unit(study) -> None:
    study.append("requirements: [{name: a, metric: attitude_error_roll, probability: 0.5, below: 1 mrad}]\n")
    requirement = load(study.path).requirements[0]
    assert requirement.below == pytest.approx(1e-3, rel=1e-15)
    assert requirement.model_dump(mode="json")["below"] == "0.001 rad"


def test_smallest_effects_of_interest_are_checked_with_the_campaign() -> None:
    found = Compare(effects={"velocity_error_3d@injection:q95": "5 %", "position_error_3d": "none"})
    assert found.confidence == 0.95
    with pytest.raises(ValueError, match="neither a percentage, nor a quantity"):
        Compare(effects={"velocity_error_3d": "little"})


def test_corners_are_held_in_radians_and_written_with_their_unit(study) -> None:
    study.append(f"corridor: {{polygon: {CORNERS}, probability: 0.99}}\n")
    corridor = load(study.path).corridor
    assert corridor is not None
    assert corridor.polygon[0] == pytest.approx((math.radians(-35.0), math.radians(-62.0)))
    assert (corridor.probability, corridor.confidence) == (0.99, 0.9)
    assert corridor.model_dump(mode="json")["polygon"][0][0].endswith(" rad")


@pytest.mark.parametrize(
    ("polygon", "message"),
    [
        ("[[-35 deg, -62 deg], [-35 deg, -50 deg]]", "a corridor needs at least 3 corners, not 2"),
        ("[[-35, -62 deg], [-35 deg, -50 deg], [-45 deg, -50 deg]]", "has no unit"),
        ("[[-62 deg, -35 deg], [-62 deg, 10 deg], [-120 deg, 10 deg]]", "a latitude of -120 deg"),
    ],
)
def test_a_mistake_in_a_corner_is_reported(study, polygon: str, message: str) -> None:
    study.append(f"corridor: {{polygon: {polygon}}}\n")
    with pytest.raises(InputError, match=message):
        load(study.path)
