"""Tuning of a filter: the goal, its bounds, and a filter of a flight with its card."""

from __future__ import annotations

import math

import pytest

from lvnav_trade.campaign.definition.searches import Tune, Variable
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.search.tune import TuningPoint, score, tune
from lvnav_trade.filter.card import FilterCard
from lvnav_trade.quantities.errors import InputError

NOISE = Variable(path="filter.velocity_noise", between=("0.01 m/s/sqrt(h)", "10 m/s/sqrt(h)"))


def asked(**more) -> Tune:
    return Tune(variables=(NOISE,), **more)


def test_the_goal_is_the_worst_or_the_mean_error_and_nees_beyond_its_bounds_costs() -> None:
    found = [TuningPoint(0.5, 1.0), TuningPoint(2.0, 1.0)]
    assert score(found, asked()) == pytest.approx(math.log(2.0))
    assert score(found, asked(over="mean")) == pytest.approx(math.log(1.25))
    inside = [TuningPoint(1.0, 1.5)]
    assert score(inside, asked(nees=(0.5, 2.0))) == 0.0
    assert score([TuningPoint(1.0, 4.0)], asked(nees=(0.5, 2.0))) == pytest.approx(10.0 * math.log(2.0))
    assert score([TuningPoint(1.0, 0.25)], asked(nees=(0.5, 2.0))) == pytest.approx(10.0 * math.log(2.0))
    assert score([TuningPoint(math.nan, 1.0)], asked()) > 1e5


REQUIREMENT = "requirements=[{name: v, metric: velocity_error_3d, at: injection, probability: 0.95, below: 1 m/s}]"
SHORT = ["monte_carlo=null", REQUIREMENT]


def test_what_is_no_case_requirement_or_number_of_the_filter_is_refused() -> None:
    campaign = load("campaigns/smoke.yaml", SHORT)
    for wrong, message in (
        (asked(hold_out=("nowhere",)), "no case 'nowhere'"),
        (asked(requirement="w"), "no requirement 'w'"),
        (Tune(variables=(Variable(path="imu.rate", between=("1 Hz", "2 Hz")),)), "a field of the filter"),
        (Tune(variables=(Variable(path="filter.gate", between=(0, 2)),)), "above zero"),
    ):
        with pytest.raises(InputError, match=message):
            tune(campaign, wrong)


@pytest.mark.slow
def test_a_tuned_filter_errs_less_where_its_unit_errs_more_than_it_models_and_its_card_says_so() -> None:
    """The unit's scale factor of 1500 ppm is no state: process noise for it makes the error smaller."""
    found = tune(load("campaigns/smoke.yaml", SHORT), asked(evaluations=10))
    (row,) = found.cases.itertuples()
    assert row.ratio_after < 0.9 * row.ratio_before
    assert row.nees_after < row.nees_before
    assert found.evaluations <= 11
    assert "tune of smoke" in found.card.source
    assert FilterCard.model_validate(found.card.model_dump(mode="json")).velocity_noise == found.card.velocity_noise
    assert found.values.after.iloc[0] != found.values.before.iloc[0]
