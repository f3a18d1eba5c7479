"""Names of metrics and their units."""

import json

import pytest

from lvnav_trade.campaign.definition.metric_names import known_metric, known_metrics, required_metrics, unit_of
from lvnav_trade.campaign.definition.published_cards import MeasuredMetric
from lvnav_trade.results.metric import BOTH, REQUIREMENTS
from tests.cli.calling import call


@pytest.mark.parametrize(
    ("metric", "unit"),
    [("mode_entry_time", "s"), ("mode_entry_share", "-"), ("velocity_coverage", "-"), ("position_error_3d", "m"),
     ("reacquisition_time", "s"), ("apogee_error", "m")],
)  # fmt: skip
def test_a_metric_has_its_unit(metric, unit):
    assert known_metric(metric) == metric
    assert unit_of(metric) == unit


def test_what_is_no_metric_is_refused_with_what_may_be_meant():
    with pytest.raises(ValueError, match="did you mean 'mode_entry_time'"):
        known_metric("mode_entry_tim")


def test_every_metric_of_requirements_is_listed_with_its_unit_and_meaning() -> None:
    known = {one.metric: one for one in known_metrics()}
    assert len(known) == len(known_metrics())
    assert set(required_metrics()) == {one.metric for one in known.values() if one.named_by in (BOTH, REQUIREMENTS)}
    assert all(known[name].unit == unit_of(name) and len(known[name].meaning) > 5 for name in required_metrics())


@pytest.mark.parametrize(
    "one", [one for one in known_metrics() if one.named_by != REQUIREMENTS], ids=lambda one: one.metric
)
def test_what_is_listed_can_be_named_in_a_statement(one) -> None:
    quantity, _, kind = one.metric.partition("_")
    more = {"during": "flight"} if one.metric.endswith(("_nees", "_time", "_availability", "_rate")) else {}
    if kind in ("convergence_time", "availability"):
        more |= {"below": f"1 {unit_of(f'{quantity}_error_3d')}"}
    if quantity == "mode":
        more = {"during": "flight", "mode": "aiding"}
    assert MeasuredMetric.model_validate({"metric": one.metric, **more}).metric == one.metric
    assert unit_of(one.metric) in (one.unit, one.unit.replace("1", "dimensionless"))


def test_the_command_lists_metrics_and_tables_and_finds_what_is_meant() -> None:
    found = json.loads(call("metrics", "perigee", "--json").output)
    assert [one["metric"] for one in found["metrics"]] == ["injection_perigee_error", "perigee_error"]
    assert "curves" in json.loads(call("metrics", "--json").output)["tables"]
    wrong = call("metrics", "perige_eror")
    assert wrong.exit_code == 2
    assert "did you mean 'perigee_error'?" in wrong.stderr
