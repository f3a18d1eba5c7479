"""The campaigns of the DRDC study on a short flight: they run from file to verdict, and say what theirs say."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from unittest.mock import patch

import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.reading.study_card import load_study
from lvnav_trade.campaign.running.conduct import RunOptions
from lvnav_trade.campaign.running.execute import run
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.report import build
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.verdicts import FAILS
from lvnav_trade.results.tables.read import load as results_of
from lvnav_trade.simulation import nozzle as controlled
from tests.building import flying, hop
from tests.scripts import publication
from tests.trajectory.guided.launches import fly_steady, steady_launch

EVENTS = {
    "liftoff": 0.0, "kick": 1.0, "stage1_cutoff": 13.0, "stage1_separation": 13.5, "stage2_ignition": 14.0,
    "stage2_cutoff": 20.0, "stage2_separation": 20.5, "stage3_ignition": 27.0, "stage3_cutoff": 28.0, "injection": 29.0,
}  # fmt: skip
NO_DIAGNOSTICS = ("covariance.adjoint=false", "covariance.nonlinearity=false", "covariance.spot_check=0")


@lru_cache(maxsize=1)
def flight():
    return replace(hop(), events=EVENTS)


def run_campaign(name, tmp_path, *settings):
    """Results of a campaign of the study on the short flight, in this process."""
    campaign = load(campaign_file(f"campaigns/drdc/{name}.yaml"), settings)
    with flying(flight()):
        outcome = run(campaign, tmp_path / name, RunOptions(jobs=1))
    assert outcome.failures == ()
    return results_of(tmp_path / name)


def test_every_campaign_of_the_study_is_good_and_its_page_is_written():
    study, parts = load_study("drdc", None, publication("drdc").figures)
    assert len(parts) == len(study.campaigns) == 7
    assert len(study.assumptions) > 5
    assert {part.study_campaign.campaign for part in parts if not part.campaign.references} == {
        "guidance",
        "envelope",
        "nozzle",
        "schuler",
    }


@pytest.mark.slow  # a campaign of half a minute
def test_rates_and_accelerations_are_better_than_the_samples_and_the_navigation_hardly(tmp_path):
    tables = run_campaign("rates_and_accelerations", tmp_path, "monte_carlo.runs=16", "report.sections=[motion]")
    found = METRICS["rate_and_acceleration"](tables)
    roll = found[
        found.case.str.contains("as published") & found.case.str.contains("vehicle model") & (found.axis == "roll")
    ]
    assert (roll.formal_reduction_percent - 88.1).abs().max() < 1.0  # table 2
    assert roll.reduction_percent.min() > 85.0
    frame = publication("drdc").table(tables)
    unknown = frame[frame["item"].str.startswith("unknown dynamics")]
    assert len(unknown) == 4
    assert unknown.in_band.all()
    closed = frame[frame.source.str.startswith("Closed form")]
    assert (closed.repeats != "").all()
    worse = frame[frame["item"].str.startswith("never worse")]
    assert worse.in_band.all()
    assert "Rate and acceleration" in build(tables.folder).read_text(encoding="utf-8")


def test_twenty_launches_say_whether_errors_are_as_the_filter_assumes(tmp_path):
    only = ("base.trajectory=trajectories/churchill_sso",
            "axes=[{path: receiver.mask, values: [5 deg, 10 deg]}]", "references=[]", *NO_DIAGNOSTICS)  # fmt: skip
    found = METRICS["rate_and_acceleration"](run_campaign("twenty_launches", tmp_path, *only))
    assert set(found.verdict) <= {"as modelled", "smaller"}


@pytest.mark.slow  # two campaigns of a quarter of a minute
def test_launches_of_a_mission_count_as_one_case(tmp_path):
    """Two launches of the real mission: their rates differ, and a row of both has the runs of both."""
    settings = ("axes.0.values=[0, 1]", "monte_carlo.runs=8", "report.sections=[references]")
    run(load(campaign_file("campaigns/drdc/twenty_launches.yaml"), settings), tmp_path / "r", RunOptions(jobs=1))
    tables = results_of(tmp_path / "r")
    frame = publication("drdc").table(tables).set_index("item")
    row = frame.loc["table 2 by Monte Carlo, rate roll, boost"]
    assert row["case"] == "base; 2 levels of realisation together"
    assert row["formal"] == pytest.approx(88.1, abs=0.5)
    assert row["monte_carlo"] > 88.0
    frame = frame.set_index("id")
    sigma = frame.loc["sigma of rate roll, boost"]
    assert sigma["formal"] == pytest.approx(1.0)
    assert 0.5 < sigma["monte_carlo"] < 1.0
    assert (sigma["band_low"], sigma["band_high"]) == pytest.approx((0.522, 1.480), abs=2e-3)  # chi-square of 8 runs
    assert frame.loc["sigma over the phase, rate roll, boost", "verdict"] == FAILS


@pytest.mark.slow  # kernels of its own
def test_all_states_are_observable_only_with_a_time_constant_of_the_position_bias(tmp_path):
    tables = run_campaign("observability", tmp_path, "covariance.window=10 s")
    frame = publication("drdc").table(tables)
    ranks = frame[frame["item"].str.startswith("rank")]
    assert ranks.in_band.all()
    assert set(ranks.ours) == {24.0, 18.0}


@pytest.mark.slow  # a campaign of half a minute
def test_the_nozzle_moves_less_with_the_filtered_rate(tmp_path):
    launch = steady_launch(20.0, gust=3.0, moment=0.003, force=0.03)
    with (
        patch.object(controlled, "launch_of", lambda _: launch),
        patch.object(controlled, "fly_missions", fly_steady),
        patch.object(controlled, "_burns_of", lambda _: [(0.0, 13.0)]),
    ):
        only_one = ("axes.1.values=[1]", 'axes.1.labels=["1"]', "report.sections=[control]")
        tables = run_campaign("nozzle", tmp_path, "monte_carlo.runs=8", *only_one)
    found = METRICS["nozzle_travel"](tables)
    whole = found[(found.burn == "flight")].set_index(["case", "axis"]).reduction_percent
    assert len(whole) == 6
    assert whole.min() > 0.0
    rows = publication("drdc").table(tables).set_index("item")
    assert rows.loc["jerk along z stays in its envelope", "ours"] > 99.0
    assert "last burn, pitch" in set(rows["id"])
    assert "Vehicle under attitude control" in build(tables.folder).read_text(encoding="utf-8")


def test_a_narrower_envelope_moves_the_nozzle_less_where_the_air_is_thin(tmp_path):
    launch = steady_launch(20.0, gust=0.2, moment=0.003, force=0.03)  # thin air: wind hardly turns it

    def believing(scenario):
        burn = scenario.filter.envelope.burn
        return launch._replace(envelope=launch.envelope.model_copy(update={"burn": burn}))

    with (
        patch.object(controlled, "launch_of", believing),
        patch.object(controlled, "fly_missions", fly_steady),
        patch.object(controlled, "_burns_of", lambda _: [(0.0, 13.0)]),
    ):
        only = ("monte_carlo.runs=8", "axes.0.cards=[imu/kvh1750_003]", "axes.0.labels=[datasheet]", *NO_DIAGNOSTICS)
        found = METRICS["rate_filter_benefit"](run_campaign("envelope", tmp_path, *only))
    pitch = found[found.case.str.contains("datasheet") & (found.axis == "pitch")]
    assert len(pitch) == 4
    assert pitch.reduction_percent.is_monotonic_increasing
    assert (pitch.reduction_percent < pitch.possible_percent).all()


@pytest.mark.slow
def test_the_page_of_the_study_states_table_2_within_three_points(tmp_path):
    campaign = load(campaign_file("campaigns/drdc/rates_and_accelerations.yaml"), ["monte_carlo.runs=8"])
    run(campaign, tmp_path / "r", RunOptions(jobs=1))
    frame = publication("drdc").table(results_of(tmp_path / "r"))
    assert frame[frame["item"].str.startswith("table 2")].in_band.all()
