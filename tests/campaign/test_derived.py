"""Process noise from an ensemble becomes a filter card; what cannot be estimated is reported in one line."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.derived import antennas_of, behind, clocks_of, process_noise
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.reading.study import Part
from lvnav_trade.campaign.syntax.cards import campaign_file
from lvnav_trade.errors import InputError
from tests.building import LOOSE, MATCHED, flying, hop

RUNS = 20


def estimated(*settings, runs=RUNS, step=None):
    campaign = load(campaign_file("campaigns/smoke.yaml"), (LOOSE, *settings))
    with flying(hop()):
        return process_noise(campaign, cases(campaign)[0], runs, step)


def test_a_unit_that_the_filter_models_asks_for_next_to_no_noise_beyond_its_own():
    found = estimated(MATCHED)
    imu = found.card.model_dump()
    assert imu["velocity_noise"] < 0.5 * found.whole.velocity
    assert found.card.source.startswith("estimate-q of smoke: 20 runs, steps of 1 s")


def test_errors_that_it_does_not_model_ask_for_more_the_longer_the_step():
    one, ten = estimated(), estimated(step=10.0)
    assert one.card.velocity_noise > 3.0 * estimated(MATCHED).card.velocity_noise
    assert 2.0 < ten.whole.velocity / one.whole.velocity < 4.0  # what lasts: the root of ten


def test_the_table_covers_the_flight_and_phases_lie_between_its_events():
    found = estimated()
    assert found.steps.t_s.iloc[-1] == 30.0
    assert [name for name, *_ in found.phases] == ["start to end0", "end0 to end1"]
    assert (found.steps.velocity_missed_m_per_s < found.steps.velocity_error_m_per_s).all()


@pytest.mark.parametrize(
    ("runs", "step", "reported"), [(5, None, "too few"), (20, 0.0, "no length"), (20, -1.0, "no length")]
)
def test_what_gives_no_covariance_is_refused(runs, step, reported):
    with pytest.raises(InputError, match=reported):
        estimated(runs=runs, step=step)


SOLVES = (
    "base.receiver={card: receivers/l1_four_patch, solution: {kind: bancroft, range_sigma: 2 m, rate_sigma: 0.1 m/s, "
    "refinements: 0, reported: true}}"
)


def test_the_clock_of_a_flight_is_shown_with_what_the_receiver_makes_of_it():
    campaign = load(campaign_file("campaigns/smoke.yaml"), (LOOSE, SOLVES))
    case = cases(campaign)[0]
    with flying(hop()):
        found = clocks_of(campaign, [case], 2)
    solved = [f"bias_m {case.label}", f"drift_m_per_s {case.label}"]
    assert list(found.columns) == ["t_s", "bias_m", "drift_m_per_s", *solved]
    apart = found[f"bias_m {case.label}"] - found.bias_m
    assert 0.1 < np.nanstd(apart) < 20.0  # a point solution, not the clock itself
    assert np.ptp(found.bias_m) > 0.0


def test_a_receiver_without_a_solution_of_its_own_has_no_clock_to_show():
    campaign = load(campaign_file("campaigns/smoke.yaml"), (LOOSE,))
    with flying(hop()), pytest.raises(InputError, match="reports no solution"):
        clocks_of(campaign, [cases(campaign)[0]], 0)


def test_antennas_are_heard_within_their_cutoff_and_look_where_they_are_told():
    campaign = load(campaign_file("campaigns/smoke.yaml"), (LOOSE, SOLVES))
    found = antennas_of(cases(campaign)[0])
    assert list(found.columns[2:]) == ["right", "below", "left", "above"]
    assert found.right.idxmax() in (0, 360)  # y
    assert found.below.idxmax() == 90  # z
    assert np.isinf(found.right[180])
    assert np.isinf(found.off_boresight[150])
    np.testing.assert_array_equal(found.off_boresight[:100], found.right[:100])


def test_a_figure_that_results_do_not_give_is_computed_for_its_place_among_the_figures():
    campaign = load(campaign_file("campaigns/smoke.yaml"), (LOOSE, SOLVES))
    label = cases(campaign)[0].axes
    figures = [{"plot": "errors"}, {"plot": "single", "cases": [label, label], "run": 1}, {"plot": "antennas"}]
    with flying(hop()):
        found = behind(Part.model_validate({"campaign": "smoke", "figures": figures}), campaign)
    assert list(found.drawn) == [1, 2]
    left = found.drawn[1]
    assert (left.velocity_down_estimated == 0.0).all()  # the aided system and the unaided one are the same case
    assert (left.velocity_down_true != 0.0).any()
