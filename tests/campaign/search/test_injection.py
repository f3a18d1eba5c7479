"""Searches on numbers of the injection of a guided ascent: indices by error source, and the tuning of its filter."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.definition.searches import Indices, Tune, Variable
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running.case_arrays import CaseArrays
from lvnav_trade.campaign.search.indices import indices
from lvnav_trade.campaign.search.tune import tune
from lvnav_trade.covariance.history import covariance
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.requirements.improvements import evaluate_requirement
from lvnav_trade.simulation.preparation.prepare import prepare

LOST = "base.faults=[{kind: satellite_outage, from: injection - 240 s}]"


def campaign(metric="injection_semi_major_axis_error", below="5 km"):
    """The guided two-stage launcher, whose receiver is lost for the last 240 s."""
    requirement = f"{{name: orbit, metric: {metric}, at: injection, probability: 0.95, below: {below}}}"
    return load(
        "campaigns/injection/gnss_outage.yaml",
        [f"requirements=[{requirement}]", "axes=[]", "monte_carlo=null", "base.imu=imu/tactical_mems", LOST],
    )


@pytest.mark.slow
def test_indices_of_an_injection_are_those_of_its_budget_by_source() -> None:
    made = indices(campaign(), Indices(requirement="orbit", sources=2, factor=1.5, samples=16))
    stated = campaign()
    prepared_case = prepare(cases(stated)[0].scenario, 60.0)
    results = CaseArrays(prepared_case, covariance(prepared_case))
    law = evaluate_requirement(results, stated.requirements[0].model_dump(mode="json")).distribution.law
    parts = {name: float(np.trace(part)) for name, part in law.sources.items()}
    total = float(np.trace(law.covariance) + law.mean @ law.mean)
    for row in made.indices.itertuples():
        assert row.share_ratio == pytest.approx(parts[row.source] / total, rel=1e-6)
    assert made.covered_share > 0.3  # with the receiver lost, two errors of the unit exceed the spreads of the vehicle
    assert made.determination > 0.9
    assert (made.indices.retuned_total >= made.indices.retuned_first - 0.02).all()


@pytest.mark.slow
def test_near_a_circular_orbit_a_perigee_has_no_indices() -> None:
    with pytest.raises(
        InputError, match="near a circular orbit injection_perigee_error is not a sum over error sources"
    ):
        indices(campaign("injection_perigee_error", "15 km"), Indices(requirement="orbit", sources=2, samples=16))


@pytest.mark.slow
def test_a_filter_is_tuned_for_the_orbit() -> None:
    """The unit's scale factors are no states of this filter: process noise for them lowers the error of the orbit."""
    noise = Variable(path="filter.velocity_noise", between=("0.001 m/s/sqrt(h)", "10 m/s/sqrt(h)"))
    card = "base.filter=filters/tight"
    stated = load(
        "campaigns/injection/gnss_outage.yaml",
        [
            "requirements=[{name: orbit, metric: injection_semi_major_axis_error, at: injection, probability: 0.95, "
            "below: 5 km}]",
            "axes=[]", "monte_carlo=null", "base.imu=imu/tactical_mems", LOST, card,
        ],
    )  # fmt: skip
    found = tune(stated, Tune(variables=(noise,), requirement="orbit", evaluations=12))
    (row,) = found.cases.itertuples()
    assert row.ratio_after < 0.9 * row.ratio_before
    assert np.isfinite([row.ratio_before, row.ratio_after, row.nees_after]).all()
    assert found.card.velocity_noise is not None
