"""Results in a notebook: names, repr, tables with the labels of their cases."""

from __future__ import annotations

import pandas as pd
import pytest

import lvnav_trade
from lvnav_trade.api import Results
from lvnav_trade.api.table_names import Frames
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.tables.dictionary import TABLES, unit_suffix
from lvnav_trade.results.tables.read import load
from tests import many_designs, synthetic
from tests.results.variants import variant


def test_the_package_lists_its_names() -> None:
    assert {"run", "load", "check", "Results", "InputError", "__version__"} <= set(dir(lvnav_trade))


def test_tables_that_editors_complete_are_those_that_there_are() -> None:
    assert set(Frames.__annotations__) == {*TABLES, *METRICS}
    assert not {*TABLES, *METRICS} & set(vars(Results))  # no method hides a table


def test_a_summary_counts_verdicts_and_shows_itself(tmp_path) -> None:
    found = Results(synthetic.results(tmp_path, n_run=8, failing=(3,)))
    short = found.summary()
    assert (short.campaign, short.cases, short.runs) == ("synthetic", 2, (8, 8))
    assert short.verdicts == dict(found.requirements.verdict.value_counts())
    assert sum(short.verdicts.values()) == len(short.requirements) > 0
    assert len(short.failures) == len(found.failures) > 0
    assert short.exit_code == found.exit_code == 4
    for text in (found._repr_html_(), str(short)):
        assert "2 cases, 8 runs each" in text
        assert "loose bound" in text
        assert "run 3" in text


def test_computed_tables_are_found_by_name_too(tmp_path) -> None:
    found = Results(synthetic.results(tmp_path, n_run=8))
    pd.testing.assert_frame_equal(found.metric("budget"), METRICS["budget"](found.tables))
    assert list(found.metric("budget").columns) != list(found.budget.columns)
    with pytest.raises(InputError, match=r"no table 'budgett' \(did you mean 'budget'"):
        found.metric("budgett")
    with pytest.raises(AttributeError):
        found.budgett  # noqa: B018


def test_errors_are_chosen_by_quantity_axis_and_event(tmp_path) -> None:
    found = Results(synthetic.results(tmp_path, n_run=8))
    chosen = found.errors("velocity")
    assert list(chosen.case) == ["imu=fine", "imu=coarse"]
    assert list(chosen.rms) == list(found.ranking.velocity)
    assert set(found.errors(axis="roll", at="flight").metric) == {"attitude_error"}
    with pytest.raises(InputError, match="phase or event 'landing': there are flight, start to liftoff"):
        found.errors(at="landing")
    with pytest.raises(InputError, match="metric 'heat_error'"):
        found.errors("heat")


def test_units_of_columns_are_attributes_of_a_table(tmp_path) -> None:
    found = Results(synthetic.results(tmp_path, n_run=8))
    units = found.runs.attrs["units"]
    assert units["t_s"] == "s"
    assert units["velocity_3d_error_m_per_s"] == "m/s"
    assert units["attitude_roll_error_rad"] == "rad"
    assert "label" not in units
    assert found.metric("nonlinearity").attrs["units"]["t_s"] == "s"


def test_results_list_their_tables_and_metrics_and_show_what_they_are(tmp_path) -> None:
    found = Results(synthetic.results(tmp_path, n_run=8))
    assert {"history", "runs", "rms", "curves", "failures"} <= set(dir(found))
    assert repr(found) == "<Results of synthetic: 2 cases, 8 runs each>"
    found.tables._read["designs"] = many_designs.frame(60)
    assert repr(found) == "<Results of synthetic: 60 designs, of which whole 2 cases, 8 runs each>"
    assert len(found.ranking) == 2


def test_tables_are_joined_with_the_labels_and_levels_of_their_cases(tmp_path) -> None:
    found = Results(synthetic.results(tmp_path, n_run=8))
    assert list(found.history.columns[:3]) == ["case", "label", "axis_imu"]
    assert set(found.history.label) == set(found.tables.labels.values())
    by_level = found.budget.groupby("axis_imu", observed=True).size()
    assert set(by_level.index) == {"fine", "coarse"}
    attributes = set(dir(pd.DataFrame))
    for name in {**TABLES, **METRICS}:
        assert not attributes & set(getattr(found, name).columns), name


def test_an_axis_of_quantities_is_a_column_of_numbers_in_si_beside_its_label(tmp_path) -> None:
    def numeric(campaign):
        axis = {"path": "base.imu.gyro.bias_repeatability", "labels": ["fine", "coarse"]}
        axis |= {"values": ["0.001 rad/s", "0.002 rad/s"]}
        return campaign | {"axes": [axis], "base": {"imu": {"gyro": {"bias_repeatability": "0.003 rad/s"}}}}

    found = Results(variant(load(synthetic.results(tmp_path, n_run=8)), tmp_path / "numeric", campaign=numeric).folder)
    assert list(found.runs.columns[:4]) == ["case", "label", "axis_imu", "axis_imu_rad_per_s"]
    assert dict(zip(found.runs.axis_imu, found.runs.axis_imu_rad_per_s, strict=True)) == {
        "fine": 0.001, "coarse": 0.002,
    }  # fmt: skip
    assert found.runs.axis_imu_rad_per_s.dtype == float


@pytest.mark.parametrize(
    ("unit", "suffix"),
    [
        ("rad/s**0.5", "rad_per_sqrt_s"), ("rad/s**1.5", "rad_per_s_sqrt_s"), ("m/s**2", "m_per_s2"),
        ("m/s**2.5", "m_per_s_s_sqrt_s"), ("kg", "kg"), ("Hz", "hz"), ("dB-Hz", "db_hz"), ("", "ratio"),
        ("1/m**2", "1_per_m2"),
    ],
)  # fmt: skip
def test_a_column_of_numbers_ends_with_its_unit(unit, suffix) -> None:
    assert unit_suffix(unit) == suffix
