"""Designs: one row per case, in SI, the same numbers as the tables that they are taken from."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.designs import at_event, meanings, overall_verdicts, slug, unit_of
from lvnav_trade.results.tables.read import load
from tests import synthetic


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory):
    return load(synthetic.results(tmp_path_factory.mktemp("designs"), n_run=16))


def test_a_design_is_a_row_with_the_numbers_of_the_other_tables_in_si(tables) -> None:
    found = METRICS["designs"](tables)
    assert list(found.case) == list(tables.labels)
    history = tables.history
    injection = float(tables.events[tables.events.event == "injection"].t_s.iloc[0])
    for row in found.itertuples():
        rows = history[(history.case == row.case) & (history.quantity == "velocity") & (history.axis == "3d")]
        at = rows.iloc[int(np.argmin(np.abs(rows.t_s.to_numpy() - injection)))]
        assert row.velocity_m_per_s == pytest.approx(np.hypot(at.lincov_true_si, at.lincov_mean_si), rel=1e-12)
        assert row.velocity_formal_m_per_s == pytest.approx(at.lincov_formal_si, rel=1e-12)
    verdicts = METRICS["requirements"](tables).set_index(["requirement", "case"])
    for one in tables.campaign["requirements"]:
        for label, word in zip(found.label, found[f"{slug(one['name'])}_verdict"], strict=True):
            assert word == verdicts.verdict[one["name"], label]


def test_an_attitude_is_in_radians_although_the_report_has_milliradians(tables) -> None:
    found, ranking = METRICS["designs"](tables).set_index("label"), METRICS["ranking"](tables).set_index("case")
    assert tables.display_units["attitude", "3d"] == ("mrad", 1e3)
    assert (found.attitude_rad < 0.1).all()
    assert set(ranking.index) == set(found.index)


def test_every_column_has_a_meaning_and_every_number_a_unit(tables) -> None:
    found = METRICS["designs"](tables)
    known = meanings(found, tables.campaign["requirements"]).set_index("column")
    assert list(known.index) == list(found.columns)
    assert known.meaning.astype(bool).all()
    without = [name for name in found.select_dtypes("number") if not unit_of(name)]
    assert set(without) <= {"run_count", "failed_count", "cost"}


def test_the_binding_requirement_is_the_one_nearest_to_its_limit() -> None:
    import pandas as pd

    ratios = pd.DataFrame({"a": [0.5, 2.0, np.nan], "b": [0.9, 0.1, 0.3]})
    words = pd.DataFrame({"a": ["met", "violated", "not applicable"], "b": ["met", "met", "met"]})
    found = overall_verdicts(ratios, words)
    assert list(found.limiting_requirement) == ["b", "a", ""]
    assert list(found.error_ratio[:2]) == [0.9, 2.0]
    assert np.isnan(found.error_ratio[2])
    assert list(found.verdict) == ["met", "violated", "not applicable"]


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("axis_random_walk_rad_per_sqrt_s", "rad/s**0.5"),
        ("velocity_at_liftoff_m_per_s", "metre per second"),
        ("realism_quantile_sigma", "multiple of the filter's own sigma"),
        ("design_number", ""),
        ("label", ""),
    ],
)
def test_a_unit_is_the_longest_end_of_a_column(column: str, unit: str) -> None:
    assert unit_of(column) == unit


def test_a_column_at_an_event_is_explained_by_that_of_injection() -> None:
    column = at_event("velocity_m_per_s", "Stage 1")
    assert column == "velocity_at_stage_1_m_per_s"
    frame = pd.DataFrame({column: [1.0], "axis_angle_at_rest_rad": [1.0]})
    assert list(meanings(frame, ()).meaning) == [
        "the same as velocity_m_per_s, at the event stage_1",
        "level of the axis",
    ]
