"""Totals of a design, the Pareto front, and the order of choice."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load as load_campaign
from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.raster import matplotlib_figure
from lvnav_trade.results.evaluation import METRICS, resources
from lvnav_trade.results.evaluation.resources import PREFERRED, sort_by_preference
from lvnav_trade.results.tables.read import load
from tests import synthetic

BASE = """\
base:
  imu: {units: [{resources: {cost: 10, mass: 2 kg, mtbf: 1000 h}}, {resources: {cost: 10, mass: 2 kg, mtbf: 1000 h}}]}
  receiver: {resources: {cost: 5, mass: 0.5 kg, power: 3 W, volume: 100 cm^3}}
  sensors: {one: {resources: null}, two: null, three: {resources: {cost: 1, mtbf: 500 h}}}
axes:
  - {path: imu, values: [{resources: {cost: 100, mass: 1 kg}}, {resources: {mass: 9 kg}}], labels: [fine, coarse]}
"""
TWO = """\
requirements:
  - {name: slow, metric: velocity_error_3d, at: injection, probability: 0.9, below: 2.0 m/s, confidence: 0.9}
"""


@pytest.fixture(scope="module")
def stated(tmp_path_factory):
    head = synthetic.CAMPAIGN.partition("requirements:")[0]
    return load(synthetic.results(tmp_path_factory.mktemp("stated"), n_run=40, campaign=head + BASE + TWO))


def test_totals_are_those_of_inertial_units_receiver_and_sensors(stated) -> None:
    found = METRICS["resource_totals"](stated).set_index("case")
    fine, coarse = found.loc["imu=fine"], found.loc["imu=coarse"]
    assert (fine.cost, fine.mass_kg, fine.power_w, fine.volume_l) == pytest.approx((106.0, 1.5, 3.0, 0.1))
    assert (coarse.cost, coarse.mass_kg, coarse.unknown) == pytest.approx((6.0, 9.5, 1))
    assert fine.mtbf_h == pytest.approx(500.0)
    base = stated.with_frames(cases=stated.cases.assign(axes=json.dumps({"imu": "base"})))
    both = METRICS["resource_totals"](base).iloc[0]
    assert (both.cost, both.mass_kg) == pytest.approx((26.0, 4.5))
    assert both.mtbf_h == pytest.approx(1.0 / (1 / 1000 + 1 / 1000 + 1 / 500))


def test_the_front_has_no_dominated_case_and_the_cheapest_that_meets_comes_first(stated) -> None:
    """The coarse unit has three times the error of the fine one: 2.3 of 2 m/s."""
    frame = METRICS["pareto"](stated).set_index("case")
    assert frame.front.all()
    assert frame.meets.to_dict() == {"imu=fine": True, "imu=coarse": False}
    ratio = frame.error_ratio
    assert ratio["imu=coarse"] / ratio["imu=fine"] == pytest.approx(3.0, rel=1e-6)
    assert list(sort_by_preference(frame.reset_index(), ["cost"]).case) == ["imu=fine", "imu=coarse"]
    heavier = frame.reset_index().assign(meets=True)
    assert list(sort_by_preference(heavier, ["cost"]).case) == ["imu=coarse", "imu=fine"]
    assert set(PREFERRED.values()) <= set(heavier.columns)


def test_runs_that_contradict_an_estimate_decide_what_meets(stated, monkeypatch) -> None:
    """A design meets the requirements where its verdict says so, whatever linear covariance expects."""
    own = resources.margins(stated)
    for verdict, meets in (("violated", False), ("not confirmed", False), ("undecided", False), ("met", True)):
        changed = own.assign(verdict=own.verdict.where(own.case != "imu=fine", verdict))
        monkeypatch.setattr(resources, "margins", lambda _, found=changed: found)
        row = resources.pareto.__wrapped__(stated).set_index("case").loc["imu=fine"]
        assert (row.verdict, row.meets) == (verdict, meets)
        assert row.error_ratio < 1.0


def test_a_case_that_is_worse_in_everything_is_dominated(tmp_path) -> None:
    head = synthetic.CAMPAIGN.partition("requirements:")[0]
    worse = BASE.replace("{resources: {mass: 9 kg}}", "{resources: {cost: 200, mass: 9 kg}}")
    tables = load(synthetic.results(tmp_path, n_run=0, campaign=head + worse + TWO))
    frame = METRICS["pareto"](tables).set_index("case")
    assert frame.front.to_dict() == {"imu=fine": True, "imu=coarse": False}
    assert frame.dominated_by["imu=coarse"] == "imu=fine"


def test_without_resources_there_is_nothing_to_total(tmp_path) -> None:
    tables = load(synthetic.results(tmp_path, n_run=0))
    assert METRICS["resource_totals"](tables).empty
    assert METRICS["pareto"](tables).empty


def test_resources_are_in_no_digest() -> None:
    plain = load_campaign("campaigns/smoke.yaml")
    priced = load_campaign(
        "campaigns/smoke.yaml", ["imu.resources={cost: 7, mass: 1 kg}", "receiver.resources={cost: 2}"]
    )
    assert priced.base.imu.resources.mass == 1.0
    assert [case.id for case in cases(priced)] == [case.id for case in cases(plain)]
    assert np.isfinite(priced.base.receiver.resources.cost)


def test_the_front_is_drawn_with_a_cross_for_a_case_that_violates(stated) -> None:
    (ax,) = matplotlib_figure(PLOTS["pareto"](stated)).axes
    points = {line.get_marker(): line.get_xydata()[0] for line in ax.lines if line.get_marker() in ("o", "x")}
    frame = METRICS["pareto"](stated).set_index("case")
    assert points["o"] == pytest.approx([106.0, frame.error_ratio["imu=fine"]])
    assert points["x"] == pytest.approx([6.0, frame.error_ratio["imu=coarse"]])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("cost", "largest error over its limit (-)")


def test_a_demonstrated_design_comes_before_a_cheaper_one_that_is_undecided(stated) -> None:
    frame = METRICS["pareto"](stated)
    cheap = frame.case == "imu=coarse"
    changed = frame.assign(verdict=np.where(cheap, "undecided", "met"), error_ratio=0.9, meets=~cheap)
    assert list(sort_by_preference(changed, ["cost"]).case) == ["imu=fine", "imu=coarse"]
    violated = changed.assign(verdict=np.where(cheap, "undecided", "violated"), meets=False)
    assert list(sort_by_preference(violated, ["cost"]).case) == ["imu=coarse", "imu=fine"]
