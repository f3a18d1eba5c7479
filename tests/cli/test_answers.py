"""What the verbs that run campaigns answer."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

from lvnav_trade.campaign.running.work import CovarianceResult
from lvnav_trade.cli import answers
from lvnav_trade.cli.answers import _designs, _verdicts, check_preferred, combine_components, covariance_collector
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.evaluation.designs import designs
from lvnav_trade.simulation.settings_read import EffectiveSettings
from tests import many_designs


def test_only_what_cards_state_can_be_preferred() -> None:
    check_preferred(["cost", "mass", "error"])
    with pytest.raises(InputError, match=r"^--prefer weigth: should be one of "):
        check_preferred(["cost", "weigth"])


def test_answers_are_kept_where_json_is_wanted_and_not_printed(capsys: pytest.CaptureFixture[str]) -> None:
    found, show = covariance_collector(as_json=True)
    show(["an answer"], ["a case"])
    assert found == ["an answer"]
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(("count", "lines"), [(20, 21), (400, 23)])
def test_of_many_rows_the_worst_are_printed(count: int, lines: int) -> None:
    verdicts = ["met", "undecided", "met", "violated"] * (count // 4) + ["met"] * (count % 4)
    text = _verdicts(
        pd.DataFrame({"requirement": "fast", "case": range(count), "verdict": verdicts}), "requirements.csv"
    ).splitlines()
    assert len(text) == lines
    if count == 400:
        assert all("violated" in line for line in text[1:-2])
        assert text[-2] == "380 more rows, none worse: requirements.csv"
        assert text[-1] == "fast: met 200, undecided 100, violated 100"


def test_of_many_cases_those_with_the_smallest_and_the_largest_errors_are_printed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def answer(k: int) -> SimpleNamespace:
        sizes = (("position", 100.0 - k, 1.0, "m"), ("velocity", float(k), 1.0, "m/s"))
        return SimpleNamespace(event="injection", rows=sizes, error="")

    _, show = covariance_collector(as_json=False)
    show([answer(k) for k in range(1, 51)], [SimpleNamespace(label=f"case {k}") for k in range(1, 51)])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 7
    assert [line.split()[:4] for line in lines[2:6]] == [
        ["position", "smallest", "case", "50"],
        ["position", "largest", "case", "1"],
        ["velocity", "smallest", "case", "1"],
        ["velocity", "largest", "case", "50"],
    ]
    assert lines[-1].startswith("50 cases")


def test_the_summary_of_many_designs_counts_the_filters_that_cannot_be_trusted(tmp_path) -> None:
    tables = many_designs.tables(tmp_path, 60)
    frame = designs(tables)
    met = frame[frame.verdict == "met"]
    doubtful = (met.nees_per_state_ratio > 2.0).sum()
    assert 0 < doubtful < len(met)
    results = SimpleNamespace(cases=frame, tables=tables, folder="results/mine")
    first, second, third = _designs(results, tables.manifest["space"]).splitlines()
    assert first == (
        f"60 designs, 2 of them impossible: {len(met)} meet all requirements by linear covariance, "
        f"{doubtful} of these with an overconfident filter"
    )
    assert second.endswith('results/mine --where "verdict == met" --sort error')
    assert third == "verdicts of the 2 that are analysed whole:"


def test_the_summary_of_many_designs_says_which_requirement_is_met(tmp_path) -> None:
    tables = many_designs.tables(tmp_path, 60)
    frame = designs(tables).assign(verdict="violated", true_verdict="violated")
    met = (frame.fast_verdict == "met").sum()
    asked = [many_designs.REQUIREMENT, {**many_designs.REQUIREMENT, "name": "true"}]
    tables.__dict__["campaign"] = {**tables.campaign, "requirements": asked}
    results = SimpleNamespace(cases=frame, tables=tables, folder="results/mine")
    first, second, _ = _designs(results, tables.manifest["space"]).splitlines()
    assert first.endswith(f": 0 meet all requirements by linear covariance (fast {met}, true 0)")
    assert second.endswith("results/mine --sort error")


def test_designs_without_requirements_are_not_said_to_meet_none(tmp_path) -> None:
    tables = many_designs.tables(tmp_path, 60)
    tables.__dict__["campaign"] = {**tables.campaign, "requirements": []}
    results = SimpleNamespace(cases=designs(tables), tables=tables, folder="results/mine")
    first, second = _designs(results, tables.manifest["space"]).splitlines()
    assert first == "60 designs, 2 of them impossible"
    assert second == "list them: lvnav-trade cases results/mine --sort velocity"


def test_components_of_one_quantity_share_a_line() -> None:
    metrics = [
        ("position_error_3d", "m", "length of the three-axis error of position"),
        ("position_error_x", "m", "x component of the error of position"),
        ("impact_error", "m", "distance"),
        ("impact_error_down", "m", "along the velocity"),
        ("impact_error_cross", "m", "across it"),
    ]
    assert combine_components(metrics) == [
        ("position_error_*", "m", "error of position; *: 3d, x"),
        *metrics[2:],
    ]


def test_json_has_plain_values_of_linear_covariance_and_nothing_of_the_engine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(answers, "_campaign_lines", lambda *_: [])
    settings = EffectiveSettings(frozenset({"imu.rate"}), (), {})
    result = CovarianceResult("a0", "injection", (("position", 3.0, 2.0, "m"),), effective_settings=settings)
    results = SimpleNamespace(
        folder=tmp_path,
        failures=[],
        tables=SimpleNamespace(manifest={}),
        requirements=pd.DataFrame({"verdict": ["met"]}),
        exit_code=0,
    )
    content = answers.answer_of(results, [result], report=False).content
    assert json.loads(json.dumps(content["covariance"])) == [
        {"case": "a0", "event": "injection", "rows": [["position", 3.0, 2.0, "m"]], "error": ""}
    ]


class _CountedResults:
    """Results without runs, which count how often the table of verdicts is computed."""

    folder = Path("results")
    failures: tuple[str, ...] = ()
    tables = SimpleNamespace(manifest={"space": {}})
    exit_code = 0
    computed = 0

    @property
    def requirements(self) -> pd.DataFrame:
        self.computed += 1
        return pd.DataFrame({"verdict": []})


def test_the_table_of_verdicts_is_computed_once() -> None:
    results = _CountedResults()
    answers.answer_of(results, [], report=False)
    assert results.computed == 1
