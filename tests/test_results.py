"""Results in a notebook: names, repr, tables with the labels of their cases."""

from __future__ import annotations

import pandas as pd

import lvnav_trade
from lvnav_trade.metrics import METRICS
from lvnav_trade.results import Results
from lvnav_trade.store.schema import TABLES
from tests import synthetic


def test_the_package_lists_its_names() -> None:
    assert {"run", "load", "check", "Results", "InputError", "__version__"} <= set(dir(lvnav_trade))


def test_results_list_their_tables_and_metrics_and_show_what_they_are(tmp_path) -> None:
    found = Results(synthetic.results(tmp_path, n_run=8))
    assert {"history", "runs", "rms", "curves", "failures"} <= set(dir(found))
    assert repr(found) == "<Results of synthetic: 2 cases, 8 runs each>"
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
