from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import beta

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.integrity import (
    applied_faults,
    decisions,
    expected_element,
    integrity,
    rate,
    share,
    without_fault,
)
from lvnav_trade.results.tables.read import load
from tests import synthetic

COLUMNS = ["case", "run_number", "t_s", "isolated_element", "channel"]


def tables(rows, faults=(("clock_jump 1", 50.0, ""),), runs=20, nominal=()):
    """Return results of one case: rows of run, time, what was isolated, channel; faults by name, start, satellites."""
    every = [("a", *row, *("",) * (4 - len(row))) for row in rows]
    return SimpleNamespace(
        cases=pd.DataFrame({"case": ["a"], "label": ["base"], "integrity": [True], "run_count": [runs]}),
        labels={"a": "base"},
        levels={"a": {}},
        cache={},
        runs=pd.DataFrame({"case": "a", "run_number": range(runs)}),
        innovations=pd.DataFrame({"case": "a", "t_s": np.arange(100.0)}),
        integrity=pd.DataFrame(every, columns=COLUMNS),
        nominal_integrity=pd.DataFrame([("a", 0, *row) for row in nominal], columns=COLUMNS),
        events=pd.DataFrame(
            [("a", name, "fault", t, names) for name, t, names in faults] + [("a", "liftoff", "event", 0.0, "")],
            columns=["case", "event", "kind", "t_s", "satellites"],
        ),
    )


def test_runs_are_counted_by_what_they_decide_after_the_fault():
    rows = [(0, 51.0, "clock"), (0, 52.0, "inertial"), (1, 53.0, "clock"), (2, 51.0, "inertial"), (3, 20.0, "channel")]
    found = integrity(tables(rows)).set_index("outcome")
    assert found.outcome_count.to_dict() == {
        "false alarm": 1,
        "detected": 3,
        "isolated": 1,
        "isolated in part": 0,
        "wrong isolation": 2,  # one names something else a second later
        "missed": 17,
    }
    assert found.median_s["detected"] == 1.0
    assert found.median_s["isolated"] == 3.0
    assert set(found.fault) == {"clock_jump 1"}


def test_a_decision_long_after_the_first_one_does_not_count():
    rows = [(0, 51.0, "clock"), (0, 56.0, "inertial"), (1, 51.0, "clock"), (1, 55.0, "inertial")]
    found = integrity(tables(rows)).set_index("outcome").outcome_count
    assert (found["isolated"], found["wrong isolation"]) == (1, 1)


def test_every_struck_satellite_and_no_other_is_to_be_excluded():
    faults = (("range_bias 1", 50.0, "G05"), ("range_bias 2", 50.0, "G12"))
    excluded = {
        0: ["G05 range", "G05 range rate", "G12 range", "G12 range rate"],
        1: ["G05 range", "G05 range rate"],
        2: ["G05 range", "G12 range", "G20 range"],
    }
    rows = [(run, 51.0, "channel", name) for run, names in excluded.items() for name in names]
    results = tables(rows, faults)
    found = integrity(results).set_index("outcome").outcome_count
    assert (found["isolated"], found["isolated in part"], found["wrong isolation"]) == (1, 1, 1)
    every = decisions(results)
    assert every[["satellites", "run_count", "run_ratio"]].values.tolist() == [
        ["G05", 1, 0.05], ["G05 G12", 1, 0.05], ["G05 G12 G20", 1, 0.05],
    ]  # fmt: skip
    assert applied_faults(results, "a").satellites == {"G05", "G12"}


def test_a_sound_satellite_that_is_excluded_beside_the_right_decision_makes_it_wrong():
    rows = [(0, 51.0, "clock"), (1, 51.0, "clock", "G05 range")]
    found = integrity(tables(rows)).set_index("outcome").outcome_count
    assert (found["isolated"], found["wrong isolation"]) == (1, 1)
    of_all = (("degraded_noise 1", 50.0, ""),)  # any satellite is affected
    found = integrity(tables([(0, 51.0, "channel", "G05 range")], of_all)).set_index("outcome").outcome_count
    assert (found["isolated"], found["wrong isolation"]) == (1, 0)


def test_one_of_several_units_that_is_excluded_is_the_inertial_failure():
    faults = (("accel_bias_step 1", 50.0, ""),)
    results = tables([(0, 51.0, "unit", "unit 2")], faults)
    found = integrity(results).set_index("outcome").outcome_count
    assert (found["isolated"], found["wrong isolation"]) == (1, 0)
    assert decisions(results)[["isolated_element", "satellites"]].values.tolist() == [["unit", "unit 2"]]


def test_an_alarm_of_solution_separation_isolates_the_satellite_that_it_names():
    faults = (("range_bias 1", 50.0, "G05"),)
    rows = [(0, 60.0, "separation", "G05 range"), (1, 60.0, "separation", "G12 range")]
    found = integrity(tables(rows, faults)).set_index("outcome").outcome_count
    assert (found["detected"], found["isolated"], found["wrong isolation"]) == (2, 1, 1)


def test_linear_covariance_stands_beside_the_runs():
    results = tables([(0, 52.0, "clock")], nominal=[(51.0, "clock", "")])
    found = integrity(results).set_index("outcome")
    assert (found.median_s["detected"], found.lincov_s["detected"], found.lincov_s["isolated"]) == (2.0, 1.0, 1.0)
    assert np.isnan(found.lincov_s["wrong isolation"])
    assert decisions(results)[["t_s", "run_count", "lincov"]].values.tolist() == [[51.0, 0, True], [52.0, 1, False]]


@pytest.mark.parametrize(
    ("metric", "runs", "nominal"),
    [("detection_rate", [0, 1, 2], 1.0), ("isolation_rate", [0], 1.0), ("wrong_isolation_rate", [1, 2], 0.0)],
)
def test_a_rate_counts_the_runs_by_their_decisions_during_a_phase(metric, runs, nominal):
    rows = [(0, 51.0, "clock"), (0, 70.0, "inertial"), (1, 52.0, "clock"), (1, 53.0, "inertial"),
            (2, 50.0, "inertial"), (3, 49.0, "clock")]  # fmt: skip
    each, own = rate(tables(rows, nominal=[(51.0, "clock", "")]), "a", metric, (50.0, 55.0))
    assert np.flatnonzero(each).tolist() == runs
    assert (each.size, own) == (20, nominal)


def test_intervals_are_exact():
    found = integrity(tables([(0, 51.0, "clock"), (1, 51.0, "clock")])).set_index("outcome")
    detected = found.loc["detected"]
    assert detected.low_ratio == pytest.approx(beta.ppf(0.025, 2, 19))
    assert detected.high_ratio == pytest.approx(beta.ppf(0.975, 3, 18))
    assert (found.loc["false alarm"].low_ratio, found.loc["false alarm"].share_ratio) == (0.0, 0.0)
    assert share(20, 20) == (1.0, pytest.approx(beta.ppf(0.025, 20, 1)), 1.0)


def test_without_a_fault_every_decision_is_a_false_alarm():
    found = integrity(tables([(4, 51.0, "clock"), (4, 60.0, "channel")], faults=()))
    assert found.outcome.tolist() == ["false alarm"]
    assert found.outcome_count.tolist() == [1]


def test_decisions_reach_the_tables_with_the_name_of_the_channel(tmp_path):
    written = load(synthetic.results(tmp_path / "watched", n_run=8, size=8, logic=True))
    rows = written.integrity
    assert sorted(rows.run_number) == sorted([*range(8)] * 2)
    assert set(rows.isolated_element) == {"channel"}
    assert set(rows.channel) == {synthetic.prepared_case().channel_names[1]}
    assert set(METRICS["integrity"](written).outcome) >= {"false alarm"}
    satellite = synthetic.prepared_case().channel_names[1].split()[0]
    found = METRICS["decisions"](written)
    assert found[["t_s", "satellites", "run_count", "run_ratio"]].values.tolist() == [[40.0, satellite, 8, 1.0]] * 2
    assert METRICS["fault_test_errors"](written).empty  # both cases are tested
    assert without_fault(written, "aaaaaaaaaaaa") == ""  # and both have the fault


def test_what_should_be_isolated_of_each_kind():
    names = ("range_bias 1", "clock_drift 2", "dead_axis 1", "gyro_bias_step 1", "satellite_outage 1", "spoofing 1")
    assert [expected_element(name) for name in names] == ["channel", "clock", "inertial", "inertial", "inertial", ""]
