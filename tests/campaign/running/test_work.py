"""A unit of work is done whole by one worker, or says in one line why not."""

from __future__ import annotations

import gc
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import conduct, work
from lvnav_trade.campaign.running.plan import Block
from lvnav_trade.campaign.running.pool import map_items
from lvnav_trade.campaign.running.work import Job
from lvnav_trade.quantities.errors import InputError, Mistake
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


def test_linear_covariance_is_computed_once_and_left_for_all_workers(job, case: Case) -> None:
    fake, todo = job()
    first = work.compute_covariance(todo, case)
    scratch.clear_cache()  # as another process
    assert work.compute_covariance(todo, case) == first
    assert [call.what for call in fake.calls] == ["covariance"]
    assert [file.name for file in Path("scratch").iterdir()] == [f"{case.id}.1.0.covariance"]


def test_an_answer_that_fails_is_reported_in_one_line(job, case: Case) -> None:
    def broken(prepared_case: Any) -> None:
        raise ValueError("first line\nsecond line")

    _, todo = job(on_covariance=broken)
    assert work.compute_covariance(todo, case).error == "ValueError: first line"
    assert not list(Path().glob("scratch/*"))  # nothing half written


def test_an_error_without_words_is_reported_by_its_name(job, case: Case) -> None:
    def broken(prepared_case: Any) -> None:
        raise KeyError

    _, todo = job(on_covariance=broken)
    assert work.compute_covariance(todo, case).error == "KeyError: no message"


def test_a_full_disk_stops_the_campaign(job, case: Case) -> None:
    def broken(prepared_case: Any) -> None:
        raise OSError(28, "No space left on device")

    _, todo = job(on_covariance=broken)
    with pytest.raises(OSError, match="No space left"):
        work.compute_covariance(todo, case)


def test_a_users_mistake_is_handed_back_as_one(job, case: Case) -> None:
    def broken(prepared_case: Any) -> None:
        raise InputError(records=[Mistake("not so", "receiver.latency")])

    _, todo = job(on_covariance=broken)
    assert work.compute_covariance(todo, case).mistakes == (Mistake("not so", "receiver.latency"),)


def test_an_answer_holds_the_mean_error_too(job, case: Case) -> None:
    _, todo = job()
    still = {row[0]: row[1:3] for row in work.compute_covariance(todo, case).rows}
    _, todo = job(mean=1.5)
    biased = {row[0]: row[1:3] for row in work.compute_covariance(todo._replace(scratch=Path("other")), case).rows}
    assert biased["position"][0] == pytest.approx(math.hypot(still["position"][0], 1.5 * math.sqrt(3.0)))
    assert biased["position"][1] == still["position"][1]


def test_a_block_is_flown_stored_and_its_failed_runs_are_reported(job, case: Case) -> None:
    _, todo = job(on_block=lambda first, n: [first + 3])
    work.compute_covariance(todo, case)
    done = work.simulate_block(todo, Block(case, 40, 20))
    assert (done.first_run, done.n_run, done.error) == (40, 20, "")
    assert done.failures == ((43, "diverged at 1.5 s"),)
    assert todo.results.block_spans(case.id) == [(40, 20)]


def test_a_block_that_breaks_is_lost_and_stores_nothing(job, case: Case) -> None:
    def broken(first: int, n: int) -> None:
        raise FloatingPointError("overflow")

    _, todo = job(on_block=broken)
    work.compute_covariance(todo, case)
    assert work.simulate_block(todo, Block(case, 0, 40)).error == "FloatingPointError: overflow"
    assert todo.results.block_spans(case.id) == []


def test_a_worker_keeps_two_prepared_cases_and_no_more(study, job) -> None:
    _, todo = job()
    study.append("axes: [{path: filter.gate, values: [3, 4, 5]}]\n")
    found = cases(load(study.path))
    for case in found:
        work.compute_covariance(todo, case)
    assert [key[1] for key in work._prepared_cases] == [case.id for case in found[-2:]]


def test_a_flight_that_cannot_be_is_returned_and_not_raised(job, case: Case, monkeypatch) -> None:
    _, todo = job()

    def out_of_reach(scenario: Any) -> dict[str, float]:
        raise InputError("lacks 300 m/s")

    found = work.trajectory_summary(todo.engine._replace(events=out_of_reach), case)
    assert isinstance(found, InputError)
    assert work.trajectory_summary(todo.engine, case) == ({"liftoff": 0.0, "stage1_cutoff": 1.0, "injection": 2.0}, ())


def test_an_almanac_that_cannot_be_read_is_found_before_anything_is_flown(study) -> None:
    study.write("broken.alm", "******** Week 1 almanac for PRN-01 ********\nID: one\n")
    case = cases(load(study.path, ["constellation.almanac=broken.alm", "trajectory.vehicle.payload=100 kg"]))[0]
    with pytest.raises(InputError) as caught:
        work.ENGINE.events(case.scenario)
    assert caught.value.records[0].path == "base.constellation"
    assert "broken.alm" in str(caught.value)


def test_an_orbit_out_of_reach_is_reported_with_the_field_that_asks_for_it(study) -> None:
    case = cases(load(study.path, ["trajectory.vehicle.payload=60 t"]))[0]
    with pytest.raises(InputError) as caught:
        work.ENGINE.events(case.scenario)
    (record,) = caught.value.records
    assert record.path == "base.trajectory"
    assert "\n" not in record.message


def test_what_is_behind_a_covariance_is_found_once_and_reported_to_the_store(job, case: Case, fakes) -> None:
    fake, todo = job()
    work.compute_covariance(todo, case)
    assert work.diagnose(todo, case).error == ""
    work.diagnose(todo, case)
    assert [call.what for call in fake.calls] == ["covariance", "explain"]
    work.write_tables(todo, case, 0)
    (row,) = fakes.tables(Path()).values()
    assert row[3][0] == "explained"


def test_another_question_is_answered_anew(job, case: Case) -> None:
    fake, todo = job()
    work.compute_covariance(todo, case)
    work.diagnose(todo, case)
    work.diagnose(todo._replace(request=CovarianceRequest(sensitivity=True)), case)
    assert [call.what for call in fake.calls] == ["covariance", "explain", "explain"]


def test_a_campaign_asks_for_the_events_of_its_requirements(study) -> None:
    study.append(
        "covariance: {at: stage1_cutoff, sensitivity: true}\n"
        "requirements: [{name: a, metric: velocity_error_3d, at: liftoff, probability: 0.9, below: 1 m/s}]\n"
    )
    campaign = load(study.path)
    runs = {"spot_check": 32, "seed": campaign.seed}
    assert work.covariance_request(campaign) == CovarianceRequest(
        "stage1_cutoff", ("liftoff",), sensitivity=True, **runs
    )


def test_a_worker_that_computes_and_stores_holds_neither_pandas_nor_figures_nor_statistics_in_memory(tmp_path) -> None:
    code = (
        "import sys\nfrom pathlib import Path\nfrom lvnav_trade.campaign.running import execute, work\n"
        "from tests import synthetic\nsynthetic.results(Path(sys.argv[1]), n_run=20, traced=False)\n"
        "heavy = ('pandas', 'pyarrow.dataset', 'matplotlib', 'scipy.stats', 'scipy.signal')\n"
        "print([name for name in heavy if name in sys.modules])"
    )
    root = Path(__file__).resolve().parents[3]
    command = [sys.executable, "-c", code, str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    found = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert found.stdout == "[]\n"


def test_a_worker_does_not_search_what_it_has_loaded_for_garbage_and_a_process_of_the_users_own_does() -> None:
    before = gc.get_freeze_count()
    work.begin_worker()
    assert gc.get_freeze_count() == before
    assert min(map_items(2, gc.get_freeze_count, [()] * 4)) > 50_000


def test_an_interrupt_within_compiled_code_is_no_error_of_a_unit_of_work() -> None:
    """Else `run -j 1` would count a case as lost and go on."""
    error = SystemError("returned a result with an exception set")
    error.__cause__ = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        work.message_of(error)

    def ahead(*_: object) -> None:
        raise error

    with pytest.raises(KeyboardInterrupt):
        conduct.covariance_or_early_task(None, None, ahead)  # type: ignore[arg-type]
