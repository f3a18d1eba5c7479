"""Single runs for scripts: the errors and the clock of a run, on the draws of its campaign."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.api.flights import case_with, receiver_clock, run_errors
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.prepare import prepare
from tests.building import LOOSE, flying, hop


@pytest.fixture(scope="module")
def campaign():
    return load(campaign_file("campaigns/smoke.yaml"), (LOOSE,))


def test_the_errors_of_a_run_are_those_of_the_same_run_of_the_campaign(campaign):
    case = case_with(campaign, {})
    with flying(hop()):
        found = run_errors(campaign, case, 3)
        block = run_block(prepare(case.scenario, campaign.keep.history), campaign.seed, 0, 8)
    np.testing.assert_array_equal(found.velocity_down, block.err[3][:, 5])
    assert found.t_s.iloc[-1] == 30.0


def test_the_clock_is_true_at_epochs_and_differs_from_run_to_run(campaign):
    case = case_with(campaign, {})
    with flying(hop()):
        first, other = (receiver_clock(campaign, case, run) for run in (0, 1))
    assert list(first.columns) == ["t_s", "bias_m", "drift_m_per_s"]
    assert np.all(first.bias_m != other.bias_m)


def test_levels_that_no_case_has_are_reported(campaign):
    with pytest.raises(InputError, match="smoke: no case"):
        case_with(campaign, {"imu": "none"})
