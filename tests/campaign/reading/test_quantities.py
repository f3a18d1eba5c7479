"""The list of metrics."""

from __future__ import annotations

import json

import pytest

from lvnav_trade.campaign.definition.metric_names import unit_of
from lvnav_trade.campaign.definition.published import Measured
from lvnav_trade.campaign.definition.schema import METRICS
from lvnav_trade.campaign.reading.quantities import BOTH, known_metrics
from tests.cli.calling import call


def test_every_metric_of_requirements_is_listed_with_its_unit_and_meaning() -> None:
    known = {one.metric: one for one in known_metrics()}
    assert len(known) == len(known_metrics())
    assert set(METRICS) == {one.metric for one in known.values() if one.named_by == BOTH}
    assert all(known[name].unit == unit_of(name) and len(known[name].meaning) > 5 for name in METRICS)


@pytest.mark.parametrize("one", known_metrics(), ids=lambda one: one.metric)
def test_what_is_listed_can_be_named_in_a_statement(one) -> None:
    quantity, _, kind = one.metric.partition("_")
    more = {"during": "flight"} if one.metric.endswith(("_nees", "_time", "_availability")) else {}
    if kind in ("convergence_time", "availability"):
        more |= {"below": f"1 {unit_of(f'{quantity}_error_3d')}"}
    if quantity == "mode":
        more = {"during": "flight", "mode": "aiding"}
    assert Measured.model_validate({"metric": one.metric, **more}).metric == one.metric
    assert unit_of(one.metric) in (one.unit, one.unit.replace("1", "dimensionless"))


def test_the_command_lists_metrics_and_tables_and_finds_what_is_meant() -> None:
    found = json.loads(call("metrics", "perigee", "--json").output)
    assert [one["metric"] for one in found["metrics"]] == ["perigee_error"]
    assert "curves" in json.loads(call("metrics", "--json").output)["tables"]
    wrong = call("metrics", "perige_eror")
    assert wrong.exit_code == 2
    assert "did you mean 'perigee_error'?" in wrong.stderr
