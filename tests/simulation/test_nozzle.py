"""A scenario's launcher under control: the same missions as flown by hand, its sums, and what a scenario must have."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation import nozzle as room
from lvnav_trade.simulation.nozzle import FEEDS, nozzle_statistics
from lvnav_trade.trajectory.guided.autopilot import MOVED, TICKS
from tests.trajectory.guided.launches import fly_steady, steady_launch

WINDY = {"gust": 3.0, "moment": 0.003, "force": 0.03}


@pytest.fixture(scope="module")
def scenario():
    return load(campaign_file("campaigns/drdc/nozzle.yaml"), ["monte_carlo.runs=8"]).base


@pytest.fixture(scope="module")
def found(scenario):
    launch = steady_launch(30.0, **WINDY)
    with (
        patch.object(room, "launch_of", lambda _: launch),
        patch.object(room, "fly_missions", fly_steady),
        patch.object(room, "_burns_of", lambda _: [(0.0, 20.0)]),
    ):
        return nozzle_statistics(scenario, 3, 4), launch


def test_missions_are_those_of_the_loop_on_the_campaigns_draws(scenario, found):
    missions, launch = found
    for feed in FEEDS:
        flown = fly_steady(launch, room.feedback(scenario, feed), 4, 3)
        np.testing.assert_array_equal(missions.total[FEEDS.index(feed), :, 0], flown.movement)
        np.testing.assert_allclose(missions.mean[FEEDS.index(feed)], flown.history[..., MOVED].mean(axis=0))
        ticks = flown.sums[..., TICKS].sum(axis=0)
        np.testing.assert_array_equal(missions.turning[FEEDS.index(feed), ..., 0], ticks)
    assert (missions.low <= missions.mean).all()
    assert (missions.total[:, :, 1] <= missions.total[:, :, 0]).all()


def test_the_filtered_rate_errs_as_little_as_its_filter_assumes_and_moves_the_nozzle_less(found):
    missions, _ = found
    raw, filtered = (missions.turning[FEEDS.index(feed), :, 0] for feed in ("raw", "filtered"))
    # the error of the raw rate is the noise of a sample, and what the vehicle turns in the half tick that it is late
    assert (raw[:, 6] > raw[:, 7]).all()
    assert (raw[:, 6] < 1.06 * raw[:, 7]).all()
    assert (filtered[:, 6] < 1.2 * filtered[:, 7]).all()
    assert (missions.total[1, :, 0] < missions.total[0, :, 0]).all()
    inside = missions.bin_motion[..., 0] / missions.bin_motion[..., 1]
    assert np.abs(inside).max() == pytest.approx(missions.turning[1, :, 0, 3].max(), rel=0.5)


def test_a_scenario_without_a_vehicle_under_control_has_none(scenario):
    assert nozzle_statistics(scenario.model_copy(update={"control": None}), 1, 1) is None


@pytest.mark.parametrize(
    ("setting", "reported"),
    [
        ("base.trajectory=trajectories/falcon9_formosat5", "is steered, not a trajectory of kind"),
        ("base.control.rate_gain=-1", "rate_gain"),
        (
            "base.control.rotation.stacks=[{length: 5 m}]",
            "control.rotation.stacks: 1 of them, the vehicle has 3 stages",
        ),
    ],
)
def test_what_cannot_be_steered_is_refused(setting, reported):
    with pytest.raises(InputError, match=reported):
        load(campaign_file("campaigns/drdc/nozzle.yaml"), [setting])
