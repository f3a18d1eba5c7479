"""A campaign is run, interrupted, resumed; what fails is reported and counted."""

from __future__ import annotations

import errno
import hashlib
import itertools
import re
import sys
from pathlib import Path

import pytest
from joblib.externals.loky.process_executor import TerminatedWorkerError

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import checking, execute
from lvnav_trade.campaign.running.conduct import RunOptions, Store
from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.simulation.settings_read import EffectiveSettings
from lvnav_trade.trajectory.truth import BEYOND, NOTE, WARNING, Remark

TWO = "axes: [{path: imu, cards: [imu/good, imu/poor]}]\nmonte_carlo: {runs: 100}\n"


@pytest.fixture
def run(study, fakes):
    """Run the study's campaign with the small engine; returns engine and outcome."""
    study.append(TWO)

    def call(engine=None, sets=(), full_after=None, **options):
        fake = engine or fakes.Fake()
        outcome = execute.run(
            load(study.path, sets),
            Path("results"),
            RunOptions(jobs=1, **options),
            engine=fake.engine(),
            store=fakes.store(full_after),
        )
        return fake, outcome

    return call


def simulated_blocks(fake) -> list[tuple[str, int, int]]:
    return [(call.case, call.first, call.n) for call in fake.calls if call.what == "block"]


ALL = [(case, first, n) for case in ("good near", "poor near") for first, n in ((0, 40), (40, 40), (80, 20))]


def test_linear_covariance_of_all_cases_comes_before_any_run(run) -> None:
    fake, _ = run()
    assert [call.what for call in fake.calls[:2]] == ["covariance", "covariance"]


def test_runs_are_flown_in_blocks_of_forty_case_by_case(run) -> None:
    fake, outcome = run()
    assert simulated_blocks(fake) == ALL
    assert outcome.failures == ()


def test_remarks_on_the_flights_are_kept_by_kind_each_once(study, fakes, monkeypatch) -> None:
    study.append(TWO)
    said = (Remark(BEYOND, "a: 33 g"), Remark(NOTE, "a: a hole"), Remark(WARNING, "a: no event"))
    engine = fakes.Fake().engine()._replace(remarks=lambda scenario: said)
    finished: list[dict[str, object]] = []
    kept = fakes.store()
    monkeypatch.setattr(sys.modules["fakes"].Kept, "finish", lambda self, extra, *_: finished.append(extra))
    execute.run(load(study.path), Path("results"), RunOptions(jobs=1), engine=engine, store=kept)
    names = ("beyond_limits", "warnings", "notes")
    assert [finished[0][name] for name in names] == [["a: 33 g"], ["a: no event"], ["a: a hole"]]


def test_a_mistake_that_shows_late_is_reported_at_its_place_before_anything_is_flown(run, fakes) -> None:
    def refuse(prepared_case) -> None:
        raise InputError(records=[Mistake("too late", "receiver.latency")])

    fake = fakes.Fake(on_covariance=refuse)
    with pytest.raises(InputError, match=r"^configs/receivers/plain.yaml:1:1: base.receiver.latency: too late$"):
        run(fake)
    assert simulated_blocks(fake) == []


def test_what_no_case_reads_is_reported_before_anything_is_flown(study, run, fakes, monkeypatch) -> None:
    study.edit("campaign.yaml", "filter: filters/near", "filter: {card: filters/near, gate: 5}")
    nothing = EffectiveSettings(frozenset(), (), {})

    def knowing(**known: EffectiveSettings | None):
        fake = fakes.Fake()
        monkeypatch.setattr(
            fake, "effective_settings", lambda prepared_case, read: known[prepared_case.name.split()[0]]
        )
        return fake

    assert run(knowing(good=nothing, poor=None))[1].failures == ()  # of one case nothing is known
    fake = knowing(good=nothing, poor=nothing)
    answers: list[object] = []
    with pytest.raises(InputError, match=r"^campaign.yaml:8:32: base.filter.gate: no effect: "):
        run(fake, mode="fresh", on_answers=lambda *found: answers.append(found))
    assert (simulated_blocks(fake), answers) == ([], [])


def test_the_tables_hold_every_run_once(run, fakes) -> None:
    run()
    found = fakes.tables(Path("results"))
    assert sorted(found) == ["imu=good", "imu=poor"]
    assert found["imu=good"][2] == [7000 + number for number in range(100)]


def test_answers_of_linear_covariance_come_in_the_units_of_people(run) -> None:
    seen = []
    _, outcome = run(on_answers=lambda answers, cases: seen.append((answers, cases)))
    assert [answer.event for answer in outcome.answers] == ["injection", "injection"]
    rows = {name: (true, formal, unit) for name, true, formal, unit in outcome.answers[0].rows}
    assert rows["position"] == (pytest.approx(2 * 3**0.5), pytest.approx(3**0.5), "m")
    assert rows["attitude"] == (pytest.approx(2000 * 3**0.5), pytest.approx(1000 * 3**0.5), "mrad")
    assert len(seen) == 1


def test_a_campaign_without_monte_carlo_flies_no_run(study, run, fakes) -> None:
    study.append("axes: [{path: imu, cards: [imu/good, imu/poor]}]\n")
    fake, _ = run()
    assert simulated_blocks(fake) == []
    assert fakes.tables(Path("results"))["imu=good"][2] is None


def test_the_budget_is_left_out_where_it_is_not_wanted(run, fakes) -> None:
    run(sets=["covariance.budget=false"])
    assert fakes.tables(Path("results"))["imu=good"][1] == ()


def test_a_second_call_flies_nothing_again(run) -> None:
    run()
    fake, _ = run()
    assert simulated_blocks(fake) == []


def test_a_fresh_call_flies_all_again(run) -> None:
    run()
    fake, _ = run(mode="fresh")
    assert simulated_blocks(fake) == ALL


def test_more_runs_fly_only_the_incomplete_last_block_and_the_new_ones(run, fakes) -> None:
    run()
    fake, _ = run(sets=["monte_carlo.runs=170"])
    assert simulated_blocks(fake)[:3] == [("good near", 80, 40), ("good near", 120, 40), ("good near", 160, 10)]
    assert fakes.tables(Path("results"))["imu=good"][2] == [7000 + number for number in range(170)]


class Interrupt:
    """Interrupts as Ctrl-C does, once, at the given block."""

    def __init__(self, at: int) -> None:
        self.left = at

    def __call__(self, first: int, n: int) -> None:
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt


def test_ctrl_c_leaves_whole_blocks_and_the_same_call_goes_on(run, fakes) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(fakes.Fake(on_block=Interrupt(4)))
    assert not Path("results/finished").exists()
    fake, _ = run()
    assert simulated_blocks(fake) == ALL[3:]
    assert fakes.tables(Path("results"))["imu=poor"][2] == [7000 + number for number in range(100)]


def test_a_resumed_campaign_leaves_the_same_bytes(run, fakes) -> None:
    run()
    once = {file.name: file.read_bytes() for file in Path("results").glob("*.p*")}
    run(mode="fresh")
    Path("results").rename("first")
    with pytest.raises(KeyboardInterrupt):
        run(fakes.Fake(on_block=Interrupt(2)))
    run()
    assert {file.name: file.read_bytes() for file in Path("results").glob("*.p*")} == once


def test_a_full_disk_ends_in_one_line_and_can_be_resumed(run) -> None:
    with pytest.raises(execute.Halted, match=r"^results: No space left on device; the same command resumes once") as e:
        run(full_after=2)
    assert "\n" not in str(e.value)
    fake, _ = run()
    assert simulated_blocks(fake) == ALL[2:]


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (errno.EDQUOT, "Disk quota exceeded; the same command resumes once there is space"),
        (errno.EROFS, "Read-only file system; the same command resumes once that is mended"),
        (errno.EIO, "Input/output error; the same command resumes once that is mended"),
        (errno.ESTALE, "Stale file handle; the same command resumes once that is mended"),
    ],
)
def test_what_the_system_refuses_ends_in_one_line_and_can_be_resumed(run, fakes, number: int, said: str) -> None:
    def refuse(first: int, n: int) -> None:
        if first == 80:
            raise OSError(number, "words of a library", "results/part")

    fake = fakes.Fake(on_block=refuse)
    with pytest.raises(execute.Halted) as caught:
        run(fake)
    assert str(caught.value) == f"results/part: {said}"
    assert simulated_blocks(fake) == ALL[:3]
    fake, _ = run()
    assert simulated_blocks(fake) == ALL[2:]


def dying_pool(monkeypatch: pytest.MonkeyPatch, deaths: list[int]) -> list[int]:
    """Let the pool take two units ahead and lose a worker before its n-th result; return the workers of each pool."""
    pools = []

    def each(jobs, function, units, is_ordered=False):
        if is_ordered:
            yield from (function(*unit) for unit in units)
            return
        pools.append(jobs)
        left = deaths.pop(0) if deaths else None
        taken = list(itertools.islice(units, 2))
        while taken:
            if left == 0:
                raise TerminatedWorkerError("a worker died")
            left = None if left is None else left - 1
            result = function(*taken.pop())  # in no particular order
            taken += itertools.islice(units, 1)
            yield result

    for module in (execute, checking):
        monkeypatch.setattr(module, "map_items", each)
    monkeypatch.setattr(execute, "end_workers", lambda jobs: None)
    return pools


def test_the_work_of_a_worker_that_died_is_done_again_by_fewer(study, fakes, monkeypatch) -> None:
    study.append(TWO)
    pools = dying_pool(monkeypatch, [9, 9, 3, 0])  # none in the first stages, then two among the blocks
    fake = fakes.Fake()
    execute.run(load(study.path), Path("results"), RunOptions(jobs=8), engine=fake.engine(), store=fakes.store())
    assert pools == [8, 8, 8, 4, 2, 2]
    assert sorted(simulated_blocks(fake)) == ALL
    assert fakes.tables(Path("results"))["imu=poor"][2] == [7000 + number for number in range(100)]


def test_the_third_death_ends_the_campaign_and_so_does_the_first_where_failures_should(
    study, fakes, monkeypatch
) -> None:
    study.append(TWO)
    for options, deaths in (({}, 3), ({"fail_fast": True}, 1)):
        pools = dying_pool(monkeypatch, [9, 9, 0, 0, 0])
        found, made = load(study.path), {"engine": fakes.Fake().engine(), "store": fakes.store()}
        with pytest.raises(execute.Halted, match=r"^a worker process died .* resumes, try --jobs 2$"):
            execute.run(found, Path("r"), RunOptions(jobs=4, **options), **made)
        assert len(pools) == 2 + deaths


def test_scratch_of_an_interrupted_campaign_that_is_damaged_is_computed_again(run, fakes, caplog) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(fakes.Fake(on_block=Interrupt(4)))
    files = sorted(Path("results/.scratch").iterdir())
    assert len(files) == 4
    content = files[0].read_bytes()
    files[0].write_bytes(content[:-9] + bytes([content[-9] ^ 1]) + content[-8:])
    files[1].write_bytes(b"")
    fake, outcome = run()
    assert outcome.failures == ()
    assert simulated_blocks(fake) == ALL[3:]
    assert sum(call.what in ("covariance", "explain") for call in fake.calls) == 2
    assert len(re.findall(r"not usable: .*; computed again", caplog.text)) == 2


def test_scratch_of_another_case_is_computed_again(run, fakes, caplog) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(fakes.Fake(on_block=Interrupt(4)))
    one, other = sorted(Path("results/.scratch").glob("*.covariance"))
    other.write_bytes(one.read_bytes())
    fake, _ = run()
    assert sum(call.what == "covariance" for call in fake.calls) == 1
    assert "computed from another campaign, case or code; computed again" in caplog.text


def test_a_disk_that_is_full_from_the_start_ends_in_the_same_line(study, fakes) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    study.append(TWO)
    with pytest.raises(execute.Halted, match=r"^results: No space left on device; the same command resumes once"):
        execute.run(
            load(study.path),
            Path("results"),
            RunOptions(jobs=1),
            engine=fakes.Fake().engine(),
            store=Store(full, lambda folder: None),
        )


def test_a_failed_run_is_reported_with_the_command_that_shows_it(run, study, fakes) -> None:
    def one_bad(first: int, n: int) -> list[int]:
        return [57] if first == 40 else []

    from_engine, outcome = run(fakes.Fake(on_block=one_bad))
    case = cases(load(study.path))[0]
    assert outcome.failures[0] == (f"imu=good, run 57 diverged at 1.5 s; lvnav-trade replay results {case.id} 57")
    assert len(outcome.failures) == 2
    assert simulated_blocks(from_engine) == ALL


def test_fail_fast_stops_at_the_first_failed_run(run, fakes) -> None:
    fake = fakes.Fake(on_block=lambda first, n: [first])
    with pytest.raises(execute.Halted, match="stopped at the first failure: imu=good, run 0 diverged"):
        run(fake, fail_fast=True)
    assert len(simulated_blocks(fake)) == 1


def test_an_error_in_one_block_loses_its_case_and_not_the_campaign(run, fakes) -> None:
    def broken(first: int, n: int) -> list[int]:
        if first == 40 and not broken.done:
            broken.done = True
            raise ZeroDivisionError("division by zero")
        return []

    broken.done = False
    fake, outcome = run(fakes.Fake(on_block=broken))
    assert simulated_blocks(fake) == ALL
    assert outcome.failures == ("imu=good, runs 40 to 79: ZeroDivisionError: division by zero",)
    assert sorted(fakes.tables(Path("results"))) == ["imu=poor"]


def test_a_case_whose_covariance_fails_is_reported_and_the_others_go_on(run, fakes) -> None:
    def broken(prepared_case) -> None:
        if prepared_case.name == "good near":
            raise ValueError("not positive")

    fake, outcome = run(fakes.Fake(on_covariance=broken))
    assert outcome.failures == ("imu=good: linear covariance: ValueError: not positive",)
    assert {case for case, _, _ in simulated_blocks(fake)} == {"poor near"}


def test_an_event_that_is_not_in_the_flight_is_refused_before_anything_is_computed(study, run, fakes) -> None:
    study.append(
        TWO + "requirements: [{name: a, metric: position_error_3d, at: stage1_cutof, probability: 0.5, below: 1 m}]\n"
    )
    fake = fakes.Fake()
    with pytest.raises(InputError) as caught:
        run(fake)
    assert str(caught.value) == (
        "campaign.yaml:12:57: requirements.0.at: 'stage1_cutof' is not an event of the trajectory"
        " (did you mean 'stage1_cutoff'?)"
    )
    assert fake.calls == []
    assert not Path("results").exists()


def test_a_trajectory_that_cannot_be_flown_is_reported_where_the_campaign_asks_for_it(study, fakes) -> None:
    study.edit("campaign.yaml", "trajectories/climb", "{card: trajectories/climb, vehicle: {payload: 60 t}}")
    with pytest.raises(InputError) as caught:
        execute.run(load("campaign.yaml"), Path("results"), RunOptions(jobs=1), store=fakes.store())
    (line,) = str(caught.value).splitlines()
    assert line.startswith("campaign.yaml:4:3: base.trajectory: climb: the first stage does not lift off: ")


def test_a_trajectory_of_an_axis_that_cannot_be_flown_is_reported_in_the_axis(study, fakes) -> None:
    study.append("axes: [{path: trajectory.vehicle.payload, values: [300 kg, 60 t]}]\n")
    with pytest.raises(InputError) as caught:
        execute.run(load("campaign.yaml"), Path("results"), RunOptions(jobs=1), store=fakes.store())
    assert "base.trajectory: climb: the first stage does not lift off: " in str(caught.value)


def test_another_campaign_in_the_folder_is_refused(study, run) -> None:
    run()
    with pytest.raises(InputError, match="holds another campaign"):
        run(sets=["seed=8"])


@pytest.mark.parametrize("mode", ["fresh", "resume"])
def test_a_folder_of_the_users_own_is_refused_and_no_lock_is_left_in_it(study, fakes, mode) -> None:
    study.append(TWO)
    mine = {"mine/manifest.json": '{"name": "a web page"}', "mine/parts/a.txt": "a", "mine/.scratch/b": "b"}
    for name, text in mine.items():
        study.write(name, text)
    with pytest.raises(InputError, match="holds files that lvnav-trade did not write"):
        execute.run(load(study.path), Path("mine"), RunOptions(jobs=1, mode=mode), engine=fakes.Fake().engine())
    assert {str(path): path.read_text() for path in Path("mine").rglob("*") if path.is_file()} == mine


def test_a_pickle_planted_as_a_scratch_file_is_computed_again_and_not_executed(run, fakes, caplog) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(fakes.Fake(on_block=Interrupt(4)))
    evil = b"cos\nsystem\n(S'touch executed'\ntR."
    for file in Path("results/.scratch").iterdir():
        file.write_bytes(hashlib.sha256(evil).digest() + evil)
    fake, outcome = run()
    assert outcome.failures == ()
    assert sum(call.what in ("covariance", "explain") for call in fake.calls) == 4
    assert caplog.text.count("computed again") == 4
    assert not Path("executed").exists()
    assert not Path("results/.scratch").exists()
