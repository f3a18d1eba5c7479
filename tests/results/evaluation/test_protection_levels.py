"""Protection levels: numbers of a statement and of a requirement, and errors of runs beyond them."""

from __future__ import annotations

import pandas as pd
import pytest

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.protection_levels import level_exceedances
from tests.synthetic import EVENTS, with_protection_levels

BOX = 3.0**0.5
LEVEL = {"metric": "position_protection_level", "at": "injection"}


def test_errors_beyond_a_level_are_counted_axis_by_axis(good):
    case, tables = with_protection_levels(good, level=1e9)
    failed = (tables.runs[tables.runs.case == case].failure != "").sum()
    assert level_exceedances(tables, case, "position")[0] == failed
    _, close = with_protection_levels(good, level=1e-9)
    count, total = level_exceedances(close, case, "position")
    assert count == total > 0


def test_an_alarm_before_the_event_takes_a_run_out_of_the_count(good):
    case, tables = with_protection_levels(good, level=1e-9)
    count, total = level_exceedances(tables, case, "position")
    rows = [(case, 0, 0.0, "separation", "G01 range"), (case, 1, 0.0, "channel", "G01 range")]
    rows += [(case, 2, max(EVENTS.values()), "separation", "G01 range")]
    named = pd.DataFrame(rows, columns=["case", "run_number", "t_s", "isolated_element", "channel"])
    n_event = total // len(tables.runs[tables.runs.case == case].run_number.unique())
    # run 0 at every event, run 2 at the last one
    assert level_exceedances(tables.with_frames(integrity=named), case, "position") == (count - n_event - 1, total)


def test_the_metric_has_a_row_for_each_quantity_of_a_case_with_levels(good):
    _, tables = with_protection_levels(good)
    frame = METRICS["protection"](tables)
    assert list(frame.quantity) == ["position", "velocity"]
    assert frame.final.iloc[0] == pytest.approx(1.5 * frame.fault_free.iloc[0])
    assert (frame.low_ratio <= frame.beyond_count / frame.error_count).all()
    assert (frame.beyond_count / frame.error_count <= frame.high_ratio).all()
    assert METRICS["protection"](good).empty
