"""A run of many designs: one row each, a few whole, resumed part by part, the same bytes whoever works."""

from __future__ import annotations

from typing import Any

import pytest

import lvnav_trade
from lvnav_trade import api
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running.status import status
from lvnav_trade.campaign.space import evaluate_designs as evaluated
from lvnav_trade.campaign.space import stage
from lvnav_trade.quantities.errors import InputError

SETS = ["covariance.spot_check=0", "covariance.adjoint=false", "covariance.observability=false"]
SETS += ["covariance.nonlinearity=false", "samples=12"]


@pytest.fixture
def parts_of_five(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stage, "PART", 5)


_ROWS: dict[tuple[Any, ...], evaluated.EvaluatedDesigns] = {}


def evaluate_once(question: evaluated.EvaluationRequest, part: Any) -> evaluated.EvaluatedDesigns:
    """Return the rows of a part of the campaign's designs; those of an earlier test are not evaluated again."""
    key = (repr(question), tuple(part.numbers))
    if key not in _ROWS:
        _ROWS[key] = evaluated.evaluate(question, part)
    return _ROWS[key]


@pytest.fixture
def known_parts(parts_of_five, monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the rows of parts that an earlier test evaluated."""
    monkeypatch.setattr(stage, "evaluate", evaluate_once)


@pytest.fixture(scope="module")
def whole(text: str, tmp_path_factory: pytest.TempPathFactory) -> api.Results:
    """Return the results of the campaign, evaluated in parts of five, with a report."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "many.yaml").write_text(text)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(stage, "PART", 5)
        patched.setattr(stage, "evaluate", evaluate_once)
        return lvnav_trade.run(folder / "many.yaml", SETS, folder / "out", jobs=1)


def test_every_design_has_a_row_and_the_best_is_whole(whole) -> None:
    rows = whole.cases
    assert list(rows.design_number) == list(range(12))
    assert len(whole.tables.labels) == 1
    (case,) = whole.tables.labels
    best = rows.loc[rows.error_ratio.idxmin()]
    assert case == best.case
    assert whole.tables.manifest["space"]["designs"] == 12
    page = (whole.folder / "report.html").read_text()
    assert "All designs" in page
    assert not (whole.folder / ".scratch").exists()


def test_the_row_of_a_design_agrees_with_its_full_analysis(whole) -> None:
    """Covariance steps are cut at history times, of which a row has few: the numbers agree to a thousandth."""
    (case,) = whole.tables.labels
    row = whole.cases.set_index("case").loc[case]
    (ranked,) = whole.ranking.itertuples()
    assert row.velocity_m_per_s == pytest.approx(ranked.velocity, rel=1e-3)
    assert row.position_m == pytest.approx(ranked.position, rel=1e-3)


def test_parts_that_are_stored_are_not_evaluated_again(written, tmp_path, monkeypatch, parts_of_five) -> None:
    calls = []

    def failing(question, part):
        calls.append(part.numbers)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return evaluate_once(question, part)

    monkeypatch.setattr(stage, "evaluate", failing)
    with pytest.raises(KeyboardInterrupt):
        lvnav_trade.run(written, SETS, tmp_path / "out", jobs=1, report=False)
    lvnav_trade.run(written, SETS, tmp_path / "out", jobs=1, report=False)
    assert [len(numbers) for numbers in calls] == [5, 5, 2, 2]


def test_parts_of_other_requirements_are_evaluated_again(written, tmp_path, monkeypatch, parts_of_five) -> None:
    calls = []

    def failing(question, part):
        calls.append(part.numbers)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return evaluate_once(question, part)

    monkeypatch.setattr(stage, "evaluate", failing)
    with pytest.raises(KeyboardInterrupt):
        lvnav_trade.run(written, SETS, tmp_path / "out", jobs=1, report=False)
    changed = [*SETS, "requirements.0.below=1 mm/s"]
    found = lvnav_trade.run(written, changed, tmp_path / "out", jobs=1, report=False)
    assert len(calls) == 5
    assert set(found.cases.verdict) == {"violated"}
    assert (found.cases.error_ratio > 1.0).all()
    assert not (tmp_path / "out/.scratch").exists()


def test_more_runs_and_runs_of_others_do_not_evaluate_the_designs_again(
    written, tmp_path, monkeypatch, known_parts
) -> None:
    few, more = ([*SETS, f"monte_carlo={{runs: {8 * n}, most_cases: {n}, block: 8}}"] for n in (1, 2))
    first = lvnav_trade.run(written, few, tmp_path / "out", jobs=1, report=False)
    rows = (tmp_path / "out/designs.parquet").read_bytes()
    assert set(first.tables.cases.run_count) == {8}

    def never(*_: object) -> None:
        raise AssertionError("evaluated again")

    monkeypatch.setattr(stage, "evaluate", never)
    again = lvnav_trade.run(written, more, tmp_path / "out", jobs=1, report=False)
    assert set(again.tables.cases.run_count) == {16}
    assert (tmp_path / "out/designs.parquet").read_bytes() == rows
    about, before = again.tables.manifest["space"], first.tables.manifest["space"]
    assert (before["whole"], about["whole"]) == ({"best": 1, "undecided": 1}, {"best": 1, "undecided": 2})
    assert about == {**before, "whole": about["whole"]}


def test_a_finished_space_keeps_no_blocks_and_its_status_counts_the_runs_of_its_tables(
    written, tmp_path, known_parts
) -> None:
    sets = [*SETS, "monte_carlo={runs: 16, most_cases: 1, block: 8}"]
    found = lvnav_trade.run(written, sets, tmp_path / "out", jobs=1, report=False)
    assert not list((tmp_path / "out").rglob("parts/*"))
    assert len(found.tables.runs.run_number.unique()) == 16
    about = status(tmp_path / "out")
    whole = len(found.tables.labels)
    assert (about.state, about.required_runs, about.stored_runs, about.failed_runs) == (
        "finished",
        16 * whole,
        16 * whole,
        0,
    )


def test_events_store_the_errors_at_each_event(written, tmp_path) -> None:
    found = lvnav_trade.run(written, [*SETS, "store=events"], tmp_path / "out", jobs=1, report=False)
    rows = found.cases
    (case,) = found.tables.labels
    row = rows.set_index("case").loc[case]
    events = found.tables.events
    names = set(events[(events.case == case) & (events.kind == "event")].event)
    for name in ("liftoff", "injection"):
        assert name in names
        assert row[f"velocity_at_{name}_m_per_s"] > 0.0
    assert row.velocity_at_injection_m_per_s == row.velocity_m_per_s
    known = api.cases(tmp_path / "out", ["velocity_at_injection < 1 m/s"], ["velocity_at_liftoff"])
    assert len(known.rows) == (rows.velocity_m_per_s < 1.0).sum()
    assert list(known.rows.velocity_at_liftoff_m_per_s) == sorted(known.rows.velocity_at_liftoff_m_per_s)
    meaning = known.columns.set_index("column")
    assert meaning.meaning["velocity_at_liftoff_m_per_s"] == "the same as velocity_m_per_s, at the event liftoff"
    assert meaning.unit["fast_quantile_at_liftoff_m_per_s"] == "metre per second"


def test_designs_that_are_all_impossible_are_one_line(written, tmp_path) -> None:
    text = written.read_text().replace("cards: [filters/loose, filters/tight]", "values: [10 Hz, 20 Hz]")
    written.write_text(text.replace("path: filter,", "path: filter.update_rate,"))
    with pytest.raises(InputError, match=r"all 12 designs are impossible: filter.update_rate: … Hz does not divide .*"):
        lvnav_trade.run(written, SETS, tmp_path / "out", jobs=1)


def test_work_items_are_counted(written) -> None:
    assert stage.SpaceEvaluation(load(written, ["samples=201"])).item_count == 3


def test_shards_put_together_have_the_same_bytes(written, tmp_path, parts_of_five, whole) -> None:
    shares = [api.run_shard(written, f"{number}/2", SETS, tmp_path / "shared", jobs=1) for number in (1, 2)]
    assert sum(one.cases for one in shares) == 12
    merged = api.merge(tmp_path / "shared", jobs=1, report=False)
    for name in ("designs", "history", "cases"):
        both = [(folder.folder / f"{name}.parquet").read_bytes() for folder in (whole, merged)]
        assert both[0] == both[1], name


@pytest.mark.slow
def test_several_workers_have_the_same_bytes(written, tmp_path, parts_of_five) -> None:
    one, two = (lvnav_trade.run(written, SETS, tmp_path / f"{jobs}", jobs=jobs, report=False) for jobs in (1, 2))
    assert (tmp_path / "1/designs.parquet").read_bytes() == (tmp_path / "2/designs.parquet").read_bytes()
    assert one.tables.manifest["space"] == two.tables.manifest["space"]


@pytest.mark.slow
def test_a_cluster_has_the_same_bytes(written, tmp_path, parts_of_five) -> None:
    pytest.importorskip("distributed")
    whole = lvnav_trade.run(written, SETS, tmp_path / "whole", jobs=1, report=False)
    with api.dask(tmp_path / "cluster", jobs=2) as jobs:
        lvnav_trade.run(written, SETS, tmp_path / "cluster", jobs=jobs, report=False)
    assert (tmp_path / "cluster/designs.parquet").read_bytes() == (whole.folder / "designs.parquet").read_bytes()
