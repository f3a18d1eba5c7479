"""Every CSV that the tool writes holds its numbers as numbers: no quantity with a unit as text."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import pytest

import lvnav_trade
from lvnav_trade import api
from lvnav_trade.report.build import keep
from lvnav_trade.results.evaluation import CSV, METRICS
from lvnav_trade.results.tables.read import load
from tests import synthetic

# a number, perhaps with its unit
QUANTITY = re.compile(
    r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?( ?(%|ppm|k?m|[munk]?(s|g|rad|hz|w|t)|deg|arcsec|db\S*)([/^*]\S+)?)?", re.I
)
# names of people's own: a case is called by its levels, which may be numbers
NAMES = {"case", "label", "base", "candidate", "level", "value_text"}


def offences(name: str, frame: pd.DataFrame) -> list[str]:
    """Return the columns of text in which a number stands, first value of each."""
    found = []
    for column in frame.columns.difference(list(NAMES), sort=False):
        text = [one for one in frame[column].dropna() if isinstance(one, str)]
        found += [f"{name}.{column}: {one!r}" for one in text if QUANTITY.fullmatch(one.strip())][:1]
    return found


def of_files(folder: Path) -> list[str]:
    files = sorted(folder.rglob("*.csv"))
    assert files
    return [one for file in files for one in offences(str(file.relative_to(folder)), pd.read_csv(file))]


def test_a_number_with_its_unit_is_found() -> None:
    frame = pd.DataFrame({"good": [1.0], "bad": ["0.585 km"], "worse": ["3 %"], "case": ["2 ms"], "word": ["met"]})
    assert offences("x", frame) == ["x.bad: '0.585 km'", "x.worse: '3 %'"]


def test_tables_of_results_hold_numbers(tmp_path) -> None:
    tables = load(synthetic.results(tmp_path, n_run=8, failing=(3,), logic=True))
    found = [one for name in CSV for one in offences(name, METRICS[name](tables))]
    assert found == []


SMALL = [
    "requirements=[{name: v, metric: velocity_error_3d, at: injection, probability: 0.95, below: 1 m/s}]",
    "axes=[{path: receiver.latency, values: [0 ms, 2 ms]}]", "monte_carlo={runs: 8}",
]  # fmt: skip
ASKED = {
    "solve": "solve={vary: [{path: initial.tilt, between: [0.1 deg, 1 deg], points: 3},"
    " {path: initial.heading, values: [1 deg, 2 deg]}]}",
    "indices": "indices={sources: 2, samples: 16}",
    "tune": "tune={variables: [{path: filter.velocity_noise, between: [0.01 m/s/sqrt(h), 1 m/s/sqrt(h)]}], "
    "evaluations: 10}",
}


@pytest.mark.slow
def test_a_campaign_its_searches_and_a_study_write_numbers(tmp_path) -> None:
    lvnav_trade.run("campaigns/smoke.yaml", SMALL, tmp_path / "run", jobs=1)
    keep(tmp_path / "run", tmp_path / "kept")
    for name, words in ASKED.items():
        getattr(api, name)("campaigns/smoke.yaml", [*SMALL, words], folder=tmp_path / name, jobs=1)
    assert of_files(tmp_path) == []
    assert {file.parent.name for file in tmp_path.rglob("*.csv")} >= {"run", *ASKED}


@pytest.mark.parametrize(
    "folder",
    [
        "trade",
        "conae",
        "dlr",
        "drdc",
        "gains",
        "combinations",
        "demo",
        "error_budget",
        "requirements",
        "falcon9_formosat5",
    ],
)
def test_kept_pages_of_searches_and_studies_hold_numbers(folder) -> None:
    assert of_files(Path("reports") / folder) == []
