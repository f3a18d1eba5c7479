"""Allan deviations in units for people."""

from __future__ import annotations

import pandas as pd
import pytest

from lvnav_trade.results.evaluation import METRICS
from tests.synthetic import with_allan_curves


def test_the_metric_is_in_units_for_people(good):
    _, tables = with_allan_curves(good)
    frame = METRICS["allan"](tables)
    assert list(dict.fromkeys(frame.unit)) == ["deg/h", "mg"]
    assert frame.white_noise.iloc[1] == pytest.approx(0.20626480624709636, rel=1e-12)
    assert frame.ratio.to_numpy() == pytest.approx(1.1)
    assert METRICS["allan"](good).empty


def test_exclusions_of_units_are_counted_by_case_and_unit(good):
    case = next(iter(good.labels))
    start = float(good.events[(good.events.case == case) & (good.events.kind == "fault")].t_s.iloc[0])
    runs = int(good.cases[good.cases.case == case].run_count.iloc[0])
    rows = [(case, run, start + 1.0 + run, "unit", "unit 2") for run in range(3)] + [(case, 0, 1.0, "channel", "G01")]
    named = pd.DataFrame(rows, columns=["case", "run_number", "t_s", "isolated_element", "channel"])
    frame = METRICS["exclusions"](good.with_frames(integrity=named))
    assert list(frame.unit) == ["unit 2"]
    assert (frame.excluded_count.iloc[0], frame.run_count.iloc[0]) == (3, runs)
    assert frame.after_s.iloc[0] == pytest.approx(2.0)
    assert frame.low_ratio.iloc[0] < 3 / runs < frame.high_ratio.iloc[0]
    assert METRICS["exclusions"](good).empty
