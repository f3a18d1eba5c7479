"""What a study may claim of a campaign, and what it may not."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from lvnav_studies.claims import Innovations, Ordering


def test_an_order_has_two_cases_at_least():
    stated = {"source": "A paper", "metric": "position_error_3d", "cases": [{"filter": "tight"}]}
    with pytest.raises(ValidationError, match="at least 2 items"):
        Ordering(**stated)
    both = stated | {"cases": [{"filter": "tight"}, {"filter": "loose"}]}
    assert Ordering(**both).factor == 1.0
    with pytest.raises(ValidationError, match="a mean has a sign"):
        Ordering(**both | {"metric": "position_error_x", "statistic": "mean"})


def test_innovations_are_white_unless_stated_otherwise():
    assert Innovations(source="A paper").white
