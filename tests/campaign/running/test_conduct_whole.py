"""A case without runs is done whole by one worker, and not again by a resumed campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import work
from lvnav_trade.campaign.running.conduct import analyse_case
from lvnav_trade.campaign.running.work import Job
from lvnav_trade.quantities.records import CovarianceRequest
from lvnav_trade.results.tables import scratch


@pytest.fixture(autouse=True)
def _forget() -> None:
    """Let no test find what another one prepared."""
    work._prepared_cases.clear()
    scratch.clear_cache()


@pytest.fixture
def case(study) -> Case:
    return cases(load(study.path))[0]


@pytest.fixture
def job(study, fakes):
    """Return what makes the job of a small engine."""

    def make(**how: Any) -> tuple[Any, Job]:
        fake = fakes.Fake(**how)
        results = fakes.store().open_results(Path(), "study", "", {}, "resume")
        return fake, Job(fake.engine(), results, 7, 1.0, CovarianceRequest(), Path("scratch"))

    return make


def test_a_case_without_runs_is_done_whole(job, case: Case) -> None:
    fake, todo = job()
    found = analyse_case(todo, case)
    assert found.is_whole
    assert [call.what for call in fake.calls] == ["covariance", "explain"]
    assert found._replace(is_whole=False) == work.compute_covariance(todo, case)
    assert [file.stem for file in Path().glob("*.pcase")] == [case.id]


def test_what_fails_beside_an_answer_is_left_to_its_stage(job, case: Case) -> None:
    def broken(*_: Any) -> None:
        raise ValueError("no diagnostics")

    _, todo = job()
    todo = todo._replace(engine=todo.engine._replace(diagnose=broken))
    found = analyse_case(todo, case)
    assert not found.is_whole
    assert not found.error
    assert work.diagnose(todo, case).error == "ValueError: no diagnostics"
    scratch.clear_cache()  # as another process: the stage finds the covariance on disk
    assert work.diagnose(todo, case).error == "ValueError: no diagnostics"


def test_a_finished_case_is_answered_from_disk_and_its_covariance_never_was_there(job, case: Case) -> None:
    fake, todo = job()
    found = analyse_case(todo, case)
    assert [file.suffix for file in Path("scratch").iterdir()] == [".whole"]
    scratch.clear_cache()
    assert analyse_case(todo, case) == found
    assert [call.what for call in fake.calls] == ["covariance", "explain"]


@pytest.mark.parametrize("harm", ["gone", "short", "another question"])
def test_a_case_whose_tables_are_not_those_that_it_left_is_done_again(job, case: Case, harm: str) -> None:
    fake, todo = job()
    found = analyse_case(todo, case)
    table = Path(f"{case.id}.pcase")
    if harm == "gone":
        table.unlink()
    elif harm == "short":
        table.write_bytes(table.read_bytes()[:-1])
    else:
        todo = todo._replace(request=CovarianceRequest(event="stage1_cutoff"))
    scratch.clear_cache()
    assert analyse_case(todo, case) == found
    assert [call.what for call in fake.calls] == ["covariance", "explain"] * 2
