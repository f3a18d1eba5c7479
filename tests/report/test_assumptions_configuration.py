"""The section on the configuration."""

from __future__ import annotations

from lvnav_trade.report.assumptions import configuration
from lvnav_trade.results.tables.read import load
from tests import synthetic


def test_without_a_base_scenario_there_is_no_configuration(tmp_path) -> None:
    assert configuration(load(synthetic.results(tmp_path, n_run=8))) == []
