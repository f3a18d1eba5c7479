"""Protection levels and availability as metrics."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.evaluate import evaluate, evaluate_single
from lvnav_trade.results.requirements.requirements import errors_of
from tests.synthetic import EVENTS, with_protection_levels

BOX = 3.0**0.5
LEVEL = {"metric": "position_protection_level", "at": "injection"}


def test_a_level_is_the_length_of_the_box_at_an_event_and_the_largest_of_a_phase(good):
    case, tables = with_protection_levels(good)
    assert evaluate(tables, case, LEVEL, "-").true == pytest.approx(9.0 * BOX)
    assert evaluate(tables, case, {**LEVEL, "at": None, "during": "start to end"}, "-").true == pytest.approx(
        18.0 * BOX
    )
    assert evaluate_single(tables, case, LEVEL, "km").value == pytest.approx(9e-3 * BOX)
    assert evaluate(tables, case, LEVEL, "m").true == pytest.approx(9.0 * BOX)
    assert np.isnan(evaluate(good, case, LEVEL, "-").true)


def test_availability_is_the_share_of_time_below_a_limit(good):
    case, tables = with_protection_levels(good)
    asked = {"metric": "position_availability", "during": "start to end"}
    rows = tables.protection[tables.protection.axis == "3d"]
    first, last = rows.t_s.min(), rows.t_s.max()
    share = (last - EVENTS["stage1_cutoff"]) / (last - first)
    assert evaluate(tables, case, {**asked, "below": "20 m"}, "-").true == pytest.approx(share, abs=0.02)
    assert evaluate(tables, case, {**asked, "below": "40 m"}, "-").true == 1.0
    assert evaluate(tables, case, {**asked, "below": "10 m"}, "-").true == 0.0


def test_a_requirement_on_a_level_holds_in_every_run_that_does_not_fail(good):
    case, tables = with_protection_levels(good)
    runs = tables.runs[tables.runs.case == case].drop_duplicates("run_number")
    found = errors_of(tables, case, {**LEVEL, "below": "20 m"})
    assert len(found.magnitude) == len(runs)
    assert (found.magnitude == pytest.approx(9.0 * BOX)) or np.isinf(found.magnitude).any()
    assert np.isinf(found.magnitude).sum() == (runs.failure != "").sum()
    assert errors_of(good, case, {**LEVEL, "below": "20 m"}) is None
