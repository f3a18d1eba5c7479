"""The registry of metrics: one object each, found by name, complete and without pandas."""

from __future__ import annotations

import subprocess
import sys

import pytest

from lvnav_trade.quantities.units import parse
from lvnav_trade.results.metric import BOTH, REQUIREMENTS, STATEMENTS
from lvnav_trade.results.metrics.state_errors import StateError
from lvnav_trade.results.registry import find, metric_of, names, registry


@pytest.mark.parametrize("metric", registry().values(), ids=lambda one: one.name)
def test_every_metric_has_a_unit_a_meaning_and_blocks_that_can_name_it(metric):
    assert find(metric.name) is metric
    assert metric.unit in ("-", "%", "sigma") or parse(f"1 {metric.unit}", metric.unit) == 1.0
    assert len(metric.meaning) > 5
    assert metric.named_by in (REQUIREMENTS, BOTH, STATEMENTS)


def test_metrics_of_requirements_come_first():
    blocks = [metric.named_by for metric in registry().values()]
    assert sorted(blocks, key=lambda block: block == STATEMENTS) == blocks


def test_a_name_that_only_results_hold_is_the_error_of_a_state():
    assert find("altimeter_bias_error_up") is None
    found = metric_of("altimeter_bias_error_up")
    assert isinstance(found, StateError)
    assert (found.quantity, found.axis) == ("altimeter_bias", "up")


def test_names_are_those_for_which_a_condition_holds():
    assert names(lambda one: one.names_mode) == (
        "mode_entry_time", "mode_entry_share", "mode_duration", "mode_changes",
    )  # fmt: skip


def test_worker_processes_and_the_reading_of_campaigns_need_no_pandas():
    code = (
        "import sys, lvnav_trade.campaign.running.stopping as stopping\n"
        "stopping.metric_of('node_error')\n"
        "print('pandas' in sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "False"
