"""Shards of a campaign are its blocks, each in one of them; merged they are the campaign, byte for byte."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import execute, shards
from lvnav_trade.campaign.running.conduct import RunOptions, Scope
from lvnav_trade.campaign.running.shards import Shard
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables.versions import environment

TWO = "axes: [{path: imu, cards: [imu/good, imu/poor]}]\nmonte_carlo: {runs: 100}\n"


@pytest.mark.parametrize(("units", "total"), [(12, 1), (12, 5), (7, 3), (2, 4)])
def test_every_unit_of_work_is_in_one_shard_and_their_sizes_differ_by_one(units: int, total: int) -> None:
    parts = [Shard(number, total).select(range(units)) for number in range(1, total + 1)]
    assert [unit for part in parts for unit in part] == list(range(units))
    sizes = {len(part) for part in parts}
    assert max(sizes) - min(sizes) <= 1


def test_a_shard_is_named_by_its_number_and_their_total() -> None:
    assert shards.parse("2/8") == Shard(2, 8)
    for text in ("0/3", "4/3", "2", "2/", "-1/3", "1/0", "1/3/5", "one/2", "\u0661/2"):
        with pytest.raises(InputError, match=rf"^--shard {text}: should be NUMBER/TOTAL, such as 1/4"):
            shards.parse(text)


def simulated_blocks(fake) -> list[tuple[str, int, int]]:
    return [(call.case, call.first, call.n) for call in fake.calls if call.what == "block"]


def fly(campaign, place, part, fake, store):
    conduct, scope = RunOptions(jobs=1), Scope(shard=part)
    return execute.run(campaign, place, conduct, scope, engine=fake.engine(), store=store)


def share(study, fakes, number: int, total: int, folder: str = "shared"):
    fake, part = fakes.Fake(), Shard(number, total)
    place = Path(folder) / part.folder
    outcome = fly(load(study.path), place, part, fake, fakes.store())
    return fake, outcome


def test_shards_fly_each_block_once_and_leave_no_tables(study, fakes) -> None:
    study.append(TWO)
    done = [share(study, fakes, number, 4) for number in (1, 2, 3, 4)]
    blocks = [block for fake, _ in done for block in simulated_blocks(fake)]
    assert blocks == [(case, *at) for case in ("good near", "poor near") for at in ((0, 40), (40, 40), (80, 20))]
    assert not list(Path("shared").glob("*/*.pcase"))
    answers = [[call.case for call in fake.calls if call.what == "covariance"] for fake, _ in done]
    assert answers == [["good near"], ["good near"], ["poor near"], ["poor near"]]  # of the cases whose blocks it has
    explained = [[call.case for call in fake.calls if call.what == "explain"] for fake, _ in done]
    assert explained == [["good near"], [], ["poor near"], []]


def test_a_shard_of_a_campaign_without_runs_has_its_share_of_the_cases(study, fakes) -> None:
    study.append("axes: [{path: imu, cards: [imu/good, imu/poor]}]\n")
    done = [share(study, fakes, number, 3)[0].calls for number in (1, 2, 3)]
    explained = [[call.case for call in calls if call.what == "explain"] for calls in done]
    assert explained == [[], ["good near"], ["poor near"]]


def test_a_shard_does_not_stop_early(study, fakes) -> None:
    study.append(
        TWO.replace("100}", "120, stop: decided}")
        + "requirements: [{name: a, metric: velocity_error_3d, probability: 0.5, below: 1 m/s, confidence: 0.5}]\n"
    )
    assert sum(len(simulated_blocks(share(study, fakes, number, 2)[0])) for number in (1, 2)) == 6


def test_a_shard_that_was_interrupted_goes_on(study, fakes) -> None:
    study.append(TWO)
    fake, part = fakes.Fake(), Shard(1, 1)
    with pytest.raises(execute.Halted):
        fly(load(study.path), Path("one"), part, fake, fakes.store(2))
    again = fakes.Fake()
    fly(load(study.path), Path("one"), part, again, fakes.store())
    assert len(simulated_blocks(again)) == 4


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """Return a folder with the manifests of two finished shards."""
    for number in (1, 2):
        folder = tmp_path / Shard(number, 2).folder
        folder.mkdir()
        content = {**environment(), "campaign_digest": "d", "shard": [number, 2], "shard_finished": True, "seed": 7}
        content |= {"asked_runs": 100, "asked_block": 40}
        (folder / "manifest.json").write_text(json.dumps(content))
    return tmp_path


def changed(place: Path, number: int, **content: object) -> None:
    file = place / Shard(number, 2).folder / "manifest.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **content}))


def test_all_shards_of_a_campaign_are_found_in_their_order(place: Path) -> None:
    (place / "merged").mkdir()
    (place / "shard-notes").mkdir()
    assert shards.all_shard_folders(place) == [place / "shard-1-of-2", place / "shard-2-of-2"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"shard_finished": False}, "not finished; the same lvnav-trade run with --shard 2/2 goes on with it"),
        ({"campaign_digest": "e"}, "holds another campaign than .*shard-1-of-2"),
        ({"asked_runs": 200}, "runs 200, but .*shard-1-of-2 has 100"),
        ({"shard": [1, 2]}, "does not hold shard 2 of 2"),
    ],
)
def test_shards_that_do_not_belong_together_are_refused(place: Path, content, said) -> None:
    changed(place, 2, **content)
    with pytest.raises(InputError, match=f"shard-2-of-2: {said}$"):
        shards.all_shard_folders(place)


def test_shards_of_another_code_are_refused(place: Path) -> None:
    for number in (1, 2):
        changed(place, number, code_digest="other")
    with pytest.raises(InputError, match=r"was computed by another code .*; merge with the code of the shards$"):
        shards.all_shard_folders(place)


def test_a_folder_without_all_shards_is_refused(place: Path, tmp_path: Path) -> None:
    shutil.rmtree(place / "shard-1-of-2")
    with pytest.raises(InputError, match=r": of 2 shards these are missing: 1$"):
        shards.all_shard_folders(place)
    (place / "shard-1-of-3").mkdir()
    with pytest.raises(InputError, match=r": holds shards of 2 and of 3; keep those of one division$"):
        shards.all_shard_folders(place)
    with pytest.raises(InputError, match=r"nowhere: no shards here \(no folder shard-1-of-2 or the like\)$"):
        shards.all_shard_folders(place / "nowhere")
    (place / "shard-2-of-2" / "manifest.json").write_text("{")
    shutil.rmtree(place / "shard-1-of-3")
    (place / "shard-1-of-2").mkdir()
    with pytest.raises(InputError, match=r"manifest.json: cannot be read: "):
        shards.all_shard_folders(place)
