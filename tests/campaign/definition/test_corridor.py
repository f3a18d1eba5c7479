"""A corridor is a polygon of latitudes and longitudes with units."""

from __future__ import annotations

import math

import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.errors import InputError

CORNERS = "[[-35 deg, -62 deg], [-35 deg, -50 deg], [-45 deg, -50 deg]]"


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
