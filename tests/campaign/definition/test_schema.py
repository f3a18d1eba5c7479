"""The JSON Schema accepts what the loader accepts."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.definition.schema import Compare, metric, metric_names
from lvnav_trade.campaign.reading.load import load


def test_every_metric_has_a_quantity_an_axis_and_a_unit() -> None:
    found = {name: metric(name) for name in metric_names()}
    assert found["velocity_error_3d"] == ("velocity", "3d")
    assert found["attitude_error_roll"].unit == "rad"
    assert found["perigee_error"] == ("perigee_error", "3d")
    assert {value.unit for value in found.values()} == {"m", "m/s", "rad", "dimensionless"}


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
