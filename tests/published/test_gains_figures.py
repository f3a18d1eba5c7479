"""Figures of the study of gains: one flight aided and unaided, flown missions among ours, process noise."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.report.figures.raster import matplotlib_figure
from lvnav_trade.results.tables.read import load as results_of
from lvnav_trade.simulation.montecarlo import run_block
from tests import synthetic
from tests.building import INERTIAL, LOOSE, MATCHED, case, flying, hop
from tests.scripts import module

figures = module("gains", "gains_figures")
STEPS = pd.DataFrame(
    {"t_s": [0.0, 1.0]}
    | {
        f"{name}_{what}_{unit}": [1.0, 2.0]
        for name, unit in (("attitude", "rad"), ("velocity", "m_per_s"), ("position", "m"))
        for what in ("error", "missed", "missed_mean")
    }
)
AXIS = "axes=[{path: filter, cards: [filters/loose, filters/inertial]}]"
FLOWN = [
    {"item": f"{name}, {what}", "metric": metric, "value": value, "unit": unit, "case": {"imu": "fine"}}
    for name, value in (("C20", 0.2), ("C19", 0.4))
    for what, metric, unit in (("velocity", "velocity_error_3d", "m/s"), ("position", "position_error_3d", "m"))
]


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return results_of(synthetic.results(tmp_path_factory.mktemp("published"), n_run=40))


def test_one_flight_is_the_run_of_both_cases_and_the_estimate_their_difference():
    campaign = load(campaign_file("campaigns/smoke.yaml"), (MATCHED, AXIS))
    with flying(hop()):
        single = figures.flight_of(campaign, [{"filter": "loose"}, {"filter": "inertial"}], 3)
    aided, unaided = (run_block(case(MATCHED, one), campaign.seed, 3, 1).err[0] for one in (LOOSE, INERTIAL))
    np.testing.assert_array_equal(single.position_down_true, unaided[:, 8])
    np.testing.assert_array_equal(single.position_down_left, aided[:, 8])
    np.testing.assert_allclose(single.velocity_north_estimated, unaided[:, 3] - aided[:, 3])


def test_a_case_that_is_not_there_is_reported():
    campaign = load(campaign_file("campaigns/smoke.yaml"), (MATCHED, AXIS))
    with pytest.raises(InputError, match="no case"):
        figures.flight_of(campaign, [{"filter": "tight"}, {"filter": "inertial"}], 0)


def test_a_panel_for_every_metric_with_its_unit_and_a_line_for_every_mission(tables):
    figure = matplotlib_figure(figures.missions(tables, FLOWN))
    assert [ax.get_xlabel() for ax in figure.axes] == ["|velocity error 3d| (m/s)", "|position error 3d| (m)"]
    lines = {line.get_label(): line.get_xdata()[0] for line in figure.axes[0].lines}
    assert (lines["C20"], lines["C19"]) == (0.2, 0.4)
    assert figure.axes[0].get_ylabel() == "flights below (%)"


def test_without_missions_or_of_a_case_that_is_not_flown_there_is_no_figure(tables):
    assert figures.missions(tables, []) is None
    assert figures.missions(tables, [{**FLOWN[0], "case": {"imu": "none"}}]) is None


def test_every_axis_has_its_error_and_its_estimate_and_what_is_left_with_units():
    names = [f"{kind}_{axis}" for kind in ("velocity", "position") for axis in ("radial", "along", "cross")]
    table = {f"{name}_{what}": np.linspace(0.0, k, 20) for k, name in enumerate(names)
             for what in ("true", "estimated", "left")}  # fmt: skip
    figure = matplotlib_figure(figures.single(pd.DataFrame({"t_s": np.arange(20.0), **table})))
    assert [ax.get_title() for ax in figure.axes[:3]] == ["position, radial", "position, along", "position, cross"]
    assert [ax.get_ylabel() for ax in figure.axes[::3]] == ["m", "left (m)", "m/s", "left (m/s)"]
    assert [len(ax.lines) for ax in figure.axes[:6]] == [2, 2, 2, 2, 2, 2]
    assert "s)" in figure.axes[-1].get_xlabel()


def test_missions_stand_in_rows_and_ours_below_them(tables):
    flown = [
        {
            "item": f"{name}, apogee",
            "metric": "velocity_error_3d",
            "value": value,
            "unit": "m/s",
            "case": {"imu": "fine"},
        }
        for name, value in (("C20", 1e-9), ("C19", 1e9))
    ]
    (block,) = figures.missions_table(tables, flown)
    column = [dict(zip(block.head, row, strict=True)) for row in block.rows]
    assert [row["mission"] for row in column] == ["C20", "C19", "ours, RMS", "ours, 50 %", "ours, 95 %"]
    assert [row["ours below it, apogee (%)"] for row in column[:2]] == ["0", "100"]
    assert figures.missions_table(tables, []) == []


def test_process_noise_is_reported_in_the_units_of_people():
    noise = SimpleNamespace(attitude=2.9088820866572158e-06, velocity=0.001, position=0.0)
    found = SimpleNamespace(
        flight_densities=noise, phases=(("liftoff to stage1_cutoff", 0.0, 1.0, noise),), steps=STEPS
    )
    table, picture = figures.noise_blocks("validation", found, 10.0)
    assert table.rows[0][:2] == ("whole flight", "0.0100")  # deg/sqrt(h)
    assert table.rows[1][0] == "liftoff to stage1 cutoff"
    assert "10 s" in table.caption
    assert picture.name == "validation-steps-10"
