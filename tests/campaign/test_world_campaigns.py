"""The campaigns that come with the tool are well put; those of `world` run, and both engines agree."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pandas as pd
import pytest

from lvnav_trade import api
from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.quantities.reads import result_cache
from lvnav_trade.report.build import SECTIONS
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.trajectory import flight

FOLDER = Path(__file__).resolve().parents[2] / "campaigns"
BESIDE = {"configs", "statements"}  # folders of what campaigns use, and of what studies claim of them
FILES = sorted(path for path in FOLDER.rglob("*.yaml") if path.name != "study.yaml" and not BESIDE & set(path.parts))
WORLD = sorted((FOLDER / "world").glob("*.yaml"))

# Where linear covariance does not describe the case, as its campaign says: words of the label, and why.
BEYOND = {
    # a sway that seems to tell heading, and the second order of 4 deg of heading: docs/alignment.md
    "alignment": ["wind, .*sigma=2 cm/s", "imu=navigation, .*pad_hold=60 s", "FOG, bias known"],
    "faults": ["frozen output"],  # kilometres of error within a second, in a filter without a gate
    "latency": ["300 ms late#1"],  # taken for present: the mean error is 2.3 km at injection
}
ALIKE = {"twenty_launches": ("axes.0.values=[0, 1]",)}  # launches that differ in the draw of their wind alone
BY_COVARIANCE = ["validity"]  # without runs of their own: their spot check is what they are about
FAULTS = 11


def name(path: Path) -> str:
    return path.stem


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=name)
def test_whatever_a_campaign_states_has_an_effect(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert api.check(path).campaign.name == path.stem


@pytest.fixture(scope="module")
def _each_flight_once() -> Iterator[None]:
    """Compute once the trajectories that campaigns share; named times and oscillations are added to them afterwards."""

    def smooth(card: Any) -> Any:
        return card.model_copy(update={"oscillation": ()}) if hasattr(card, "oscillation") else card

    def kept(build: Callable[[Any], Any]) -> Callable[[Any], Any]:
        trajectories = result_cache(100)(lambda _, card: build(card))
        return lambda card: trajectories(flight.identity(smooth(card)), card)

    builders = {kind: kept(build) for kind, build in flight._BUILDERS.items()}
    with patch.dict(flight._BUILDERS, builders):
        yield


@pytest.mark.usefixtures("_each_flight_once")
@pytest.mark.parametrize("path", FILES, ids=name)
def test_every_campaign_is_well_put(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign = load(path, ALIKE.get(path.stem, ()))
    assert campaign.name == path.stem
    assert set(campaign.report.sections or ()) <= set(SECTIONS)
    monkeypatch.setattr("lvnav_trade.api.campaigns.load_campaign", lambda *_: campaign)  # read once
    planned = api.plan(path, ALIKE.get(path.stem, ()), tmp_path)
    if planned.designs is not None:
        assert planned.designs.designs == campaign.samples
        return
    labels = [case.label for case in cases(campaign)]
    assert len(set(labels)) == len(labels)
    assert list(planned.cases.label) == labels


@pytest.mark.parametrize("wanted", ["world/faults", "world/faults.yaml", "campaigns/world/faults.yaml"])
def test_a_campaign_of_the_world_is_found_far_from_the_checkout(
    wanted: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert campaign_file(wanted) == FOLDER / "world" / "faults.yaml"
    assert campaign_file("campaigns") == Path("campaigns")


def test_every_model_of_the_world_has_its_campaign() -> None:
    reported = {path.stem: load(path) for path in WORLD}
    kinds = [fault.kind for case in cases(reported["faults"]) for fault in case.scenario.faults]
    assert len(kinds) == len(set(kinds)) == FAULTS
    flown = {case.scenario.trajectory.name for case in cases(reported["vehicles"])}
    shipped = {path.stem for path in (FOLDER.parent / "configs" / "trajectories").glob("*.yaml")}
    # An approach to landing is no ascent; a study has its campaign.
    landed = {case.scenario.trajectory.name for case in cases(load(FOLDER / "gains" / "landing.yaml"))}
    assert landed == {"landing_approach"}
    assert flown | landed == shipped
    corrected = {case.scenario.filter.corrections.troposphere.kind for case in cases(reported["troposphere"])}
    assert corrected == {"none", "any_elevation", "spilker", "saastamoinen", "niell", "matched", "ray_traced", "stanag"}


@pytest.mark.slow
@pytest.mark.parametrize("path", WORLD, ids=name)
def test_monte_carlo_and_linear_covariance_agree_in_every_world_campaign(path: Path, tmp_path: Path) -> None:
    results = api.run(path, (), tmp_path, jobs=1, report=False)
    if path.stem in BY_COVARIANCE:
        return
    assert results.exit_code == 0
    found = METRICS["agreement"](results.folder)
    beyond = found.case.str.contains("|".join(BEYOND.get(path.stem, ["(?!)"])))
    outside = found[(found.agree != "agree") & ~beyond]
    assert outside.empty, outside.to_string()
    ratio: pd.Series = found[~beyond].groupby("case").ratio.mean()
    assert ratio.between(0.9, 1.1).all(), ratio.to_string()
