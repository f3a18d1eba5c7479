"""Numbers of what a filter's logic does, of runs whose changes are known: every fourth stops, and starts again."""

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.campaign.definition.published_cards import MeasuredMetric
from lvnav_trade.results.evaluate import evaluate, evaluate_single, name_of
from lvnav_trade.results.evaluation.published import references
from lvnav_trade.results.tables.read import load
from tests import synthetic

FINE = synthetic.CASES[0][0].id
RUNS = 16


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("modes"), n_run=RUNS, size=16, logic=True))


def number(tables, metric, mode, during="liftoff to end", unit="-", **more):
    return evaluate(tables, FINE, {"metric": metric, "mode": mode, "during": during, **more}, unit)


def test_the_time_of_an_entry_is_the_median_over_the_runs_from_the_start_of_the_phase(watched):
    first = number(watched, "mode_entry_time", "converging", unit="s")
    assert (first.monte_carlo, first.remark) == (5.0, f"the same in all {RUNS} runs")
    later = number(watched, "mode_entry_time", "aiding", "liftoff + 20 s to end", unit="s")
    assert later.monte_carlo == 5.0


def test_a_run_that_never_enters_has_the_length_of_the_phase(watched):
    found = number(watched, "mode_entry_time", "stopped", "liftoff + 50 s to liftoff + 90 s", unit="s")
    assert found.monte_carlo == 40.0
    assert found.remark == f"median of {RUNS} runs, 20 to 40"


def test_the_nth_entry_and_the_share_of_runs_that_have_it(watched):
    once = number(watched, "mode_entry_share", "converging")
    twice = number(watched, "mode_entry_share", "converging", number=2)
    assert (once.monte_carlo, twice.monte_carlo) == (1.0, 0.25)
    assert twice.is_share
    assert twice.runs.tolist() == [float(run % 4 == 0) for run in range(RUNS)]


def test_changes_are_counted_by_reason_where_one_is_stated(watched):
    lost = number(watched, "mode_entry_share", "stopped", reason="data loss persists")
    other = number(watched, "mode_entry_share", "stopped", reason="residual error persists")
    assert (lost.monte_carlo, other.monte_carlo) == (0.25, 0.0)
    assert number(watched, "mode_changes", "converging").monte_carlo == 1.0


def test_seconds_in_a_mode_count_those_before_the_first_change_and_end_with_the_phase(watched):
    assert number(watched, "mode_duration", "waiting", unit="s").monte_carlo == 5.0
    assert number(watched, "mode_duration", "converging", unit="s").monte_carlo == 20.0
    found = number(watched, "mode_duration", "aiding", "liftoff + 30 s to liftoff + 80 s", unit="s")
    assert (found.monte_carlo, found.remark) == (50.0, f"median of {RUNS} runs, 30 to 50")


def test_the_modes_of_a_run_fill_the_phase(watched):
    modes = ("waiting", "converging", "aiding", "predicting", "stopped")
    shares = [number(watched, "mode_duration", mode, "start to end", unit="min").monte_carlo for mode in modes]
    assert sum(shares) == pytest.approx(104.5 / 60.0)


def test_without_a_logic_or_outside_the_flight_there_is_no_number(good, watched):
    assert "without a logic" in number(good, "mode_entry_share", "aiding").remark
    assert np.isnan(number(watched, "mode_entry_time", "aiding", "kick to end", unit="s").monte_carlo)


def test_a_metric_of_modes_may_be_a_published_number(watched):
    about = {"metric": "mode_entry_time", "mode": "aiding", "during": "liftoff to end"}
    number = {"source": "a", "case": {"imu": "fine"}, "value": 25, "unit": "s", "band": [0.9, 1.1], **about}
    rows = references(watched, {"references": [number]})
    assert (rows.verdict.tolist(), rows.ours.tolist()) == (["holds"], [25.0])
    assert evaluate_single(watched, FINE, about, "s").value == 25.0


def test_the_name_says_mode_reason_and_which(watched):
    stated = {"metric": "mode_entry_time", "mode": "stopped", "number": 2, "reason": "data loss persists"}
    assert name_of({**stated, "during": "flight"}) == "2. stopped_entry_time (data loss persists), flight"


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"metric": "mode_entry_time", "during": "flight"}, "give during and mode"),
        ({"metric": "mode_changes", "mode": "aiding"}, "give during and mode"),
        ({"metric": "mode_duration", "during": "flight", "mode": "aiding", "number": 2}, "choose changes"),
        ({"metric": "position_error_3d", "mode": "aiding"}, "need a metric of the mode logic"),
        ({"metric": "mode_changes", "during": "flight", "mode": "flying"}, "aiding"),
    ],
)
def test_what_does_not_fit_is_refused(wrong, words):
    with pytest.raises(ValidationError, match=words):
        MeasuredMetric.model_validate(wrong)
