"""Figures of the study of couplings: a receiver's clock with its solutions, and the gain of its antennas."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.report.figures.raster import matplotlib_figure
from tests.building import LOOSE, flying, hop
from tests.scripts import module

figures = module("conae", "conae_figures")
SOLVES = (
    "base.receiver={card: receivers/l1_four_patch, solution: {kind: bancroft, range_sigma: 2 m, rate_sigma: 0.1 m/s, "
    "refinements: 0, reported: true}}"
)


def test_the_clock_of_a_flight_is_shown_with_what_the_receiver_makes_of_it():
    campaign = load(campaign_file("campaigns/smoke.yaml"), (LOOSE, SOLVES))
    case = cases(campaign)[0]
    with flying(hop()):
        found = figures.clocks_of(campaign, [case.axes], 2)
    solved = [f"bias_m {case.label}", f"drift_m_per_s {case.label}"]
    assert list(found.columns) == ["t_s", "bias_m", "drift_m_per_s", *solved]
    apart = found[f"bias_m {case.label}"] - found.bias_m
    assert 0.1 < np.nanstd(apart) < 20.0  # a point solution, not the clock itself
    assert np.ptp(found.bias_m) > 0.0


def test_a_receiver_without_a_solution_of_its_own_has_no_clock_to_show():
    campaign = load(campaign_file("campaigns/smoke.yaml"), (LOOSE,))
    with flying(hop()), pytest.raises(InputError, match="reports no solution"):
        figures.clocks_of(campaign, [{}], 0)


def test_antennas_are_heard_within_their_cutoff_and_look_where_they_are_told():
    campaign = load(campaign_file("campaigns/smoke.yaml"), (LOOSE, SOLVES))
    found = figures.antennas_of(cases(campaign)[0])
    assert list(found.columns[2:]) == ["right", "below", "left", "above"]
    assert found.right.idxmax() in (0, 360)  # y
    assert found.below.idxmax() == 90  # z
    assert np.isinf(found.right[180])
    assert np.isinf(found.off_boresight[150])
    np.testing.assert_array_equal(found.off_boresight[:100], found.right[:100])


def test_a_clock_is_drawn_as_values_with_the_truth_among_the_solutions():
    t = np.arange(5.0)
    table = pd.DataFrame({"t_s": t, "bias_m": t, "drift_m_per_s": t, "bias_m a": t + 1.0, "drift_m_per_s a": t - 1.0})
    bias, drift = matplotlib_figure(figures.clocks(table)).axes
    assert [line.get_label() for line in bias.lines[:2]] == ["a", "true"]
    np.testing.assert_array_equal(bias.lines[0].get_ydata(), t + 1.0)
    np.testing.assert_array_equal(drift.lines[1].get_ydata(), t)


def test_antennas_are_drawn_by_angle_and_not_where_nothing_is_heard():
    angle = np.arange(361.0)
    heard = np.where(angle <= 100.0, 5.0 - angle / 50.0, -np.inf)
    first, all_round = matplotlib_figure(
        figures.antennas(pd.DataFrame({"angle_deg": angle, "off_boresight": heard, "right": heard}))
    ).axes
    assert np.nanmax(first.lines[0].get_ydata()) == 5.0
    assert np.isnan(all_round.lines[0].get_ydata()[200])
