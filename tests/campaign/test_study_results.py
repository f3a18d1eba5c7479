"""What a study computes beside its results: an ensemble's process noise, one flight aided and unaided."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.derived import behind
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.reading.study import Part
from lvnav_trade.campaign.syntax.cards import campaign_file
from lvnav_trade.engines.simulate.montecarlo import run_block
from lvnav_trade.errors import InputError
from tests.building import INERTIAL, LOOSE, MATCHED, case, flying, hop

AXIS = "axes=[{path: filter, cards: [filters/loose, filters/inertial]}]"


def found(**asked):
    campaign = load(campaign_file("campaigns/smoke.yaml"), (MATCHED, AXIS))
    with flying(hop()):
        return behind(Part(campaign="smoke", **asked), campaign), campaign


def test_a_part_that_asks_for_nothing_gets_nothing():
    nothing, _ = found()
    assert nothing.noise == ()
    assert not nothing.drawn


def test_one_flight_is_the_run_of_both_cases_and_the_estimate_their_difference():
    asked = {"plot": "single", "cases": [{"filter": "loose"}, {"filter": "inertial"}], "run": 3}
    single = found(figures=[asked])[0].drawn[0]
    seed = load(campaign_file("campaigns/smoke.yaml")).seed
    aided, unaided = (run_block(case(MATCHED, one), seed, 3, 1).err[0] for one in (LOOSE, INERTIAL))
    np.testing.assert_array_equal(single.position_down_true, unaided[:, 8])
    np.testing.assert_array_equal(single.position_down_left, aided[:, 8])
    np.testing.assert_allclose(single.velocity_north_estimated, unaided[:, 3] - aided[:, 3])


def test_noise_is_estimated_of_the_first_case_for_every_length_of_a_step():
    noise, campaign = found(noise={"runs": 10, "steps": ["1 s", "5 s"]})
    assert [step for step, _ in noise.noise] == [1.0, 5.0]
    assert cases(campaign)[0].label in noise.noise[0][1].card.source


def test_a_case_that_is_not_there_is_reported():
    with pytest.raises(InputError, match="no case"):
        found(figures=[{"plot": "single", "cases": [{"filter": "tight"}, {"filter": "inertial"}]}])
