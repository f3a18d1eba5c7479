"""A run of many designs: one row each, a few whole, resumed part by part, the same bytes whoever works."""

from __future__ import annotations

import pytest

import lvnav_trade
from lvnav_trade import api
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.space import evaluate as evaluated
from lvnav_trade.campaign.space import stage
from lvnav_trade.errors import InputError

SETS = ["covariance.spot_check=0", "covariance.adjoint=false", "covariance.observability=false"]
SETS += ["covariance.nonlinearity=false", "samples=12"]


@pytest.fixture
def parts_of_five(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stage, "PART", 5)


def test_every_design_has_a_row_and_the_best_is_whole(written, tmp_path, parts_of_five) -> None:
    found = lvnav_trade.run(written, SETS, tmp_path / "out", jobs=1)
    rows = found.cases
    assert list(rows.design_number) == list(range(12))
    assert len(found.tables.labels) == 1
    (whole,) = found.tables.labels
    best = rows.loc[rows.error_ratio.idxmin()]
    assert whole == best.case
    assert found.tables.manifest["space"]["designs"] == 12
    page = (tmp_path / "out/report.html").read_text()
    assert "The designs together" in page
    assert not (tmp_path / "out/.scratch").exists()


def test_the_row_of_a_design_agrees_with_its_full_analysis(written, tmp_path) -> None:
    """Covariance steps are cut at history times, of which a row has few: the numbers agree to a thousandth."""
    found = lvnav_trade.run(written, SETS, tmp_path / "out", jobs=1, report=False)
    (case,) = found.tables.labels
    row = found.cases.set_index("case").loc[case]
    (ranked,) = found.ranking.itertuples()
    assert row.velocity_m_per_s == pytest.approx(ranked.velocity, rel=1e-3)
    assert row.position_m == pytest.approx(ranked.position, rel=1e-3)


def test_parts_that_are_stored_are_not_evaluated_again(written, tmp_path, monkeypatch, parts_of_five) -> None:
    real, calls = evaluated.evaluate, []

    def failing(question, part):
        calls.append(part.numbers)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(question, part)

    monkeypatch.setattr(stage, "evaluate", failing)
    with pytest.raises(KeyboardInterrupt):
        lvnav_trade.run(written, SETS, tmp_path / "out", jobs=1, report=False)
    lvnav_trade.run(written, SETS, tmp_path / "out", jobs=1, report=False)
    assert [len(numbers) for numbers in calls] == [5, 5, 2, 2]


def test_designs_that_are_all_impossible_are_one_line(written, tmp_path) -> None:
    text = written.read_text().replace("cards: [filters/loose, filters/tight]", "values: [10 Hz, 20 Hz]")
    written.write_text(text.replace("path: filter,", "path: filter.update_rate,"))
    with pytest.raises(InputError, match=r"all 12 designs are impossible: filter.update_rate: … Hz does not divide .*"):
        lvnav_trade.run(written, SETS, tmp_path / "out", jobs=1)


def test_work_items_are_counted(written) -> None:
    assert stage.Space(load(written, ["samples=201"])).parts == 3


def test_shards_put_together_have_the_same_bytes(written, tmp_path, parts_of_five) -> None:
    whole = lvnav_trade.run(written, SETS, tmp_path / "whole", jobs=1, report=False)
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
