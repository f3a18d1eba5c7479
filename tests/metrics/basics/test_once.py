"""What is asked for again is not worked out again, and nobody spoils what another one is reported."""

from __future__ import annotations

import pandas as pd

from lvnav_trade.metrics.basics.once import once
from lvnav_trade.store import load


def counted():
    calls = []

    @once
    def metric(results, case="all"):
        calls.append(case)
        return pd.DataFrame({"case": [case]})

    return metric, calls


def test_tables_are_asked_once_for_each_question_and_tables_read_again_anew(good):
    metric, calls = counted()
    tables = load(good.folder)
    for case in ("all", "a", "a", "all"):
        assert metric(tables, case).case.tolist() == [case]
    assert calls == ["all", "a"]
    metric(load(good.folder), "a")
    assert calls == ["all", "a", "a"]


def test_a_caller_that_changes_its_frame_changes_nobody_elses(good):
    metric, _ = counted()
    tables = load(good.folder)
    frame = metric(tables)
    frame["case"] = "other"
    assert metric(tables).case.tolist() == ["all"]
