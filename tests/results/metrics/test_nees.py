"""The normalised estimation error squared, against the filter's sigmas by hand."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.evaluate import evaluate
from lvnav_trade.results.statistics.select import errors_by_axis
from tests import synthetic

CASE = "aaaaaaaaaaaa"


def test_it_is_the_mean_over_events_of_squares_in_sigmas(good):
    squares = []
    for event in ("stage1_cutoff", "injection"):
        errors = errors_by_axis(good, CASE, event, "velocity").query("failure == ''").drop(columns="failure")
        sigma = synthetic.SIGMA[3:6] * (1.0 + 0.01 * synthetic.EVENTS[event])
        squares.append(np.mean((errors.to_numpy() / sigma) ** 2, axis=1))
    found = evaluate(good, CASE, {"metric": "velocity_nees", "during": "stage1_cutoff to injection"}, "-")
    sound = found.runs[np.isfinite(found.runs)]
    assert sound == pytest.approx(np.mean(squares, axis=0), rel=1e-9)
    assert (found.formal, found.remark, found.is_root) == (1.0, "at 2 events", False)


def test_without_an_event_in_the_phase_there_is_none(good):
    found = evaluate(
        good, CASE, {"metric": "velocity_nees", "during": "stage1_cutoff + 1 s to stage1_cutoff + 2 s"}, "-"
    )
    assert found.remark == "no event with a covariance in this phase"
