"""Sensitivity indices of a flight beside its budget."""

from __future__ import annotations

import pytest

from lvnav_trade.campaign.definition.searches import Indices
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.search.indices import indices
from lvnav_trade.quantities.errors import InputError

REQUIREMENT = "requirements=[{name: v, metric: velocity_error_3d, at: liftoff, probability: 0.95, below: 1 m/s}]"


@pytest.mark.slow
def test_indices_of_a_flight_stand_beside_its_budget() -> None:
    campaign = load("campaigns/smoke.yaml", [REQUIREMENT])
    with pytest.raises(InputError, match="too few for 8 polynomials; give 16"):
        indices(campaign, Indices.model_construct(requirement="v", sources=2, factor=2.0, samples=15))
    made = indices(campaign, Indices(requirement="v", sources=2, factor=1.5, samples=16))
    frame = made.indices
    assert frame.frozen_first.sum() == pytest.approx(1.0)
    assert (frame.retuned_total >= frame.retuned_first - 0.02).all()
    assert list(frame.share_ratio) == sorted(frame.share_ratio, reverse=True)
    assert made.covered_share == pytest.approx(frame.share_ratio.sum())
    assert made.determination > 0.9
