"""Flown missions in the distribution of ours."""

from __future__ import annotations

import pytest

from lvnav_trade.plots.missions import missions
from lvnav_trade.store import load
from tests import synthetic

FLOWN = [
    {"item": f"{name}, {what}", "metric": metric, "value": value, "unit": unit, "case": {"imu": "fine"}}
    for name, value in (("C20", 0.2), ("C19", 0.4))
    for what, metric, unit in (("velocity", "velocity_error_3d", "m/s"), ("position", "position_error_3d", "m"))
]


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("missions"), n_run=40))


def test_a_panel_for_every_metric_with_its_unit_and_a_line_for_every_mission(tables):
    figure = missions(tables, FLOWN)
    assert [ax.get_xlabel() for ax in figure.axes] == ["|velocity error 3d| (m/s)", "|position error 3d| (m)"]
    lines = {line.get_label(): line.get_xdata()[0] for line in figure.axes[0].lines}
    assert (lines["C20"], lines["C19"]) == (0.2, 0.4)
    assert figure.axes[0].get_ylabel() == "flights below (%)"


def test_without_missions_or_of_a_case_that_is_not_flown_there_is_no_figure(tables):
    assert missions(tables, []) is None
    assert missions(tables, [{**FLOWN[0], "case": {"imu": "none"}}]) is None
