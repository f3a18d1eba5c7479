"""Margins: how far the error that counts is from its limit, of runs or of linear covariance."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.requirements.margins import key_cases, severest_verdict, worst_runs
from lvnav_trade.results.requirements.requirements import errors_of
from lvnav_trade.results.tables.read import load
from tests import synthetic


@pytest.fixture(scope="module")
def loaded_results(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("margins"), n_run=80))


def test_a_margin_is_the_part_of_the_limit_that_the_runs_leave(loaded_results):
    stated = METRICS["requirements"](loaded_results).set_index(["requirement", "case"])
    frame = METRICS["margins"](loaded_results)
    assert len(frame) == len(stated)
    for row in frame.itertuples():
        one = stated.loc[(row.requirement, row.case)]
        assert (row.verdict, row.by) == (one.verdict, "runs")
        assert row.margin_ratio == pytest.approx(1.0 - one.estimate / one.limit, rel=1e-12)


def test_the_smallest_margin_comes_first(loaded_results):
    least = METRICS["margins"](loaded_results).groupby("case", sort=False).margin_ratio.min()
    assert (np.diff(least) >= 0.0).all()


def test_cases_that_decide_are_the_worst_the_binding_and_the_best(loaded_results, monkeypatch):
    assert list(key_cases(loaded_results).values()) == ["worst", "best"]
    frame = METRICS["margins"](loaded_results)
    sizes = {"a": -0.5, "b": 0.1, "c": 0.3, "d": 0.9}
    made = frame.iloc[[0] * 4].assign(case=list(sizes), margin_ratio=list(sizes.values()))
    monkeypatch.setattr("lvnav_trade.results.requirements.margins._margins_without_check", lambda tables: made)
    assert key_cases(loaded_results) == {"a": "worst", "b": "binding", "d": "best"}


def test_the_worst_verdict_counts():
    frame = pd.Series(["met", "not confirmed", "undecided"])
    assert severest_verdict(frame) == "not confirmed"


def test_the_worst_run_of_a_requirement_has_the_largest_error_of_its_case(loaded_results):
    found, stated = worst_runs(loaded_results), {one["name"]: one for one in loaded_results.campaign["requirements"]}
    assert set(found.case.map(loaded_results.labels)) == set(key_cases(loaded_results))
    for row in found.itertuples():
        errors = errors_of(loaded_results, row.case, stated[row.requirement])
        assert row.error == pytest.approx(errors.magnitude.max() * errors.label_factor, rel=1e-12)
        assert errors.magnitude[row.run_number] == errors.magnitude.max()
