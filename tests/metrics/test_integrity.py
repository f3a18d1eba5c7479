from types import SimpleNamespace

import pandas as pd
import pytest
from scipy.stats import beta

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.integrity import expected, integrity
from lvnav_trade.store.read import load
from tests import synthetic


def tables(rows, faults=(("clock_jump 1", 50.0),), runs=20):
    """Return results of one case: rows of run, time and what was isolated; faults by name and start."""
    return SimpleNamespace(
        cases=pd.DataFrame({"case": ["a"], "label": ["base"], "integrity": [True], "run_count": [runs]}),
        integrity=pd.DataFrame(
            [("a", *row, "") for row in rows], columns=["case", "run_number", "t_s", "isolated", "channel"]
        ),
        events=pd.DataFrame(
            [("a", name, "fault", t) for name, t in faults] + [("a", "liftoff", "event", 0.0)],
            columns=["case", "event", "kind", "t_s"],
        ),
    )


def test_runs_are_counted_by_their_first_decision_after_the_fault():
    rows = [(0, 51.0, "clock"), (0, 52.0, "inertial"), (1, 53.0, "clock"), (2, 51.0, "inertial"), (3, 20.0, "channel")]
    found = integrity(tables(rows)).set_index("outcome")
    assert found["count"].to_dict() == {
        "false alarm": 1,
        "detected": 3,
        "isolated": 2,
        "wrong isolation": 1,
        "missed": 17,
    }
    assert found.median_s["detected"] == 1.0
    assert found.median_s["isolated"] == 2.0
    assert set(found.fault) == {"clock_jump 1"}


def test_intervals_are_exact():
    found = integrity(tables([(0, 51.0, "clock"), (1, 51.0, "clock")])).set_index("outcome")
    detected = found.loc["detected"]
    assert detected.low_ratio == pytest.approx(beta.ppf(0.025, 2, 19))
    assert detected.high_ratio == pytest.approx(beta.ppf(0.975, 3, 18))
    assert (found.loc["false alarm"].low_ratio, found.loc["false alarm"].share_ratio) == (0.0, 0.0)


def test_without_a_fault_every_decision_is_a_false_alarm():
    found = integrity(tables([(4, 51.0, "clock"), (4, 60.0, "channel")], faults=()))
    assert found.outcome.tolist() == ["false alarm"]
    assert found["count"].tolist() == [1]


def test_decisions_reach_the_tables_with_the_name_of_the_channel(tmp_path):
    written = load(synthetic.results(tmp_path / "watched", n_run=8, size=8, logic=True))
    rows = written.integrity
    assert sorted(rows.run_number) == sorted([*range(8)] * 2)
    assert set(rows.isolated) == {"channel"}
    assert set(rows.channel) == {synthetic.prepared().channel_names[1]}
    assert set(METRICS["integrity"](written).outcome) >= {"false alarm"}


def test_what_should_be_isolated_of_each_kind():
    names = ("range_bias 1", "clock_drift 2", "dead_axis 1", "gyro_bias_step 1", "satellite_outage 1", "spoofing 1")
    assert [expected(name) for name in names] == ["channel", "clock", "inertial", "inertial", "inertial", ""]
