"""What every metric keeps to."""

from __future__ import annotations

import pandas as pd
import pytest

from lvnav_trade.results.evaluation import CSV, METRICS


@pytest.mark.parametrize("name", METRICS)
@pytest.mark.parametrize("which", ["good", "alone"])
def test_every_metric_gives_a_tidy_frame(name, which, request):
    frame = METRICS[name](request.getfixturevalue(which))
    assert isinstance(frame, pd.DataFrame)
    assert frame.columns.is_unique
    assert list(frame.index) == list(range(len(frame))) or name not in CSV
    assert "case" in frame.columns or name in ("effects", "regions", "swings")  # of all cases together
