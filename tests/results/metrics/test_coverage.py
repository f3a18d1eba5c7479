"""Coverage as a metric."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.definition.published_cards import PublishedNumber
from lvnav_trade.results.evaluate import evaluate, name_of
from lvnav_trade.results.statistics.select import errors_by_axis


def test_coverage_is_of_an_event():
    with pytest.raises(ValueError, match="of an event"):
        PublishedNumber(source="x", metric="attitude_coverage", during="liftoff to injection", value=0.99, unit="-")


def test_coverage_with_a_limit_is_the_share_of_runs_with_an_error_below_it(good):
    case = good.cases.case[0]
    runs = errors_by_axis(good, case, "injection", "velocity")
    sizes = np.linalg.norm(runs.drop(columns="failure").to_numpy(dtype=float), axis=1)
    limit = float(np.median(sizes))
    stated = {"metric": "velocity_coverage", "at": "injection", "below": f"{limit!r} m/s"}
    found = evaluate(good, case, stated, "-")
    assert found.is_share
    assert found.runs.tolist() == ((sizes < limit) & (runs.failure == "").to_numpy()).astype(float).tolist()
    assert np.isnan(found.formal)
    assert "below" in name_of(stated)
