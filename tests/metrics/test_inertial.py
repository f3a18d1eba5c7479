"""Allan deviations in units for people."""

from __future__ import annotations

import pytest

from lvnav_trade.metrics import METRICS
from tests.synthetic import with_allan_curves


def test_the_metric_is_in_units_for_people(good):
    _, tables = with_allan_curves(good)
    frame = METRICS["allan"](tables)
    assert list(dict.fromkeys(frame.unit)) == ["deg/h", "mg"]
    assert frame.white.iloc[1] == pytest.approx(0.20626480624709636, rel=1e-12)
    assert frame.ratio.to_numpy() == pytest.approx(1.1)
    assert METRICS["allan"](good).empty
