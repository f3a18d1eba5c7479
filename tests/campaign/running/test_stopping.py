"""A case ends when its requirements are decided, by its runs in order and by nothing else."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import execute
from lvnav_trade.campaign.running.conduct import RunOptions
from lvnav_trade.campaign.running.stopping import Stopping, violating_runs
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.requirements.requirements import decide, errors_of
from lvnav_trade.results.tables.read import load as read
from lvnav_trade.simulation.statistics import summarise
from tests import synthetic

ASKED = """\
axes: [{path: imu, cards: [imu/good, imu/poor]}]
monte_carlo: {runs: 2000, stop: decided}
requirements:
  - {name: speed, metric: velocity_error_3d, probability: 0.95, below: 1 m/s}
  - {name: height, metric: position_error_3d, probability: 0.9, below: 9 m}
"""


@pytest.fixture
def campaign(study):
    return load(study.append(ASKED))


def run_campaign(fakes, campaign, folder, jobs=1, **how):
    fake = fakes.Fake(**how)
    folder.mkdir(parents=True, exist_ok=True)
    execute.run(campaign, folder, RunOptions(jobs), engine=fake.engine(), store=fakes.store())
    return fake, {label: len(row[2]) for label, row in fakes.tables(folder).items()}


def test_a_case_flies_no_further_than_to_its_decision(fakes, campaign, tmp_path):
    fake, runs = run_campaign(fakes, campaign, tmp_path / "a")
    good = max(decide([0] * 50, 0.95, 0.9, 40)[1], decide([0] * 50, 0.9, 0.9, 40)[1])
    poor = max(decide(list(range(10, 500, 10)), p, 0.9, 40)[1] for p in (0.95, 0.9))
    assert runs == {"imu=good": good, "imu=poor": poor}
    assert good == 80
    assert sum(call.n for call in fake.calls if call.what == "block") == good + poor


@pytest.mark.slow
def test_the_runs_do_not_depend_on_the_number_of_workers(fakes, campaign, tmp_path):
    script = (
        "import sys, fakes\nfrom pathlib import Path\n"
        "from lvnav_trade.campaign.reading import load\nfrom lvnav_trade.campaign.running import conduct, execute\n"
        "folder = Path(sys.argv[2]); folder.mkdir()\n"
        "execute.run(load.load('campaign.yaml'), folder, conduct.RunOptions(int(sys.argv[1])),"
        " engine=fakes.Fake().engine(), store=fakes.store())\n"
    )
    here = Path(__file__).resolve().parents[1]
    environment = {**os.environ, "PYTHONPATH": f"{here}{os.pathsep}{here.parents[1]}"}
    for jobs in "124":
        subprocess.run([sys.executable, "-c", script, jobs, str(tmp_path / jobs)], env=environment, check=True)
    for jobs in "24":
        for file in sorted((tmp_path / "1").glob("*.pcase")):
            assert (tmp_path / jobs / file.name).read_bytes() == file.read_bytes()
    assert len(list((tmp_path / "1").glob("*.pcase"))) == 2


def test_a_campaign_that_was_interrupted_ends_at_the_same_runs(fakes, campaign, tmp_path):
    def interrupt(first, n):
        if first == 40:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_campaign(fakes, campaign, tmp_path / "b", on_block=interrupt)
    run_campaign(fakes, campaign, tmp_path / "a")
    run_campaign(fakes, campaign, tmp_path / "b")
    assert fakes.tables(tmp_path / "a") == fakes.tables(tmp_path / "b")
    again, _ = run_campaign(fakes, campaign, tmp_path / "b")
    assert [call for call in again.calls if call.what == "block"] == []


def test_more_runs_may_be_allowed_later_and_change_nothing_that_was_decided(fakes, campaign, study, tmp_path):
    fewer = load(study.append(ASKED.replace("2000", "80")))
    run_campaign(fakes, fewer, tmp_path / "a")
    run_campaign(fakes, campaign, tmp_path / "a")
    run_campaign(fakes, campaign, tmp_path / "b")
    assert fakes.tables(tmp_path / "a") == fakes.tables(tmp_path / "b")


def test_blocks_may_come_in_any_order(campaign):
    blocks = [(first, 40, (0, 0)) for first in (0, 40, 80, 120)]
    ends = set()
    for order in itertools.permutations(blocks):
        rule = Stopping(campaign)
        for block in order:
            rule.note("case", *block)
        ends.add(rule.runs("case"))
    assert ends == {80}


def test_a_block_that_is_not_whole_or_whose_metric_is_unknown_decides_nothing(campaign):
    rule = Stopping(campaign)
    rule.note("a", 0, 24, (24, 24))
    for first in range(0, 2000, 40):
        rule.note("b", first, 40, (0, None))
    assert (rule.runs("a"), rule.runs("b")) == (2000, 2000)
    assert rule.wants("b", 1960)


def test_without_the_word_every_run_is_flown(study, fakes, tmp_path):
    campaign = load(study.append(ASKED.replace("2000, stop: decided", "200")))
    assert not Stopping(campaign).is_early
    assert set(run_campaign(fakes, campaign, tmp_path / "a")[1].values()) == {200}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "runs: 2000",
            "runs: 2010",
            "monte_carlo: stop tests after every block of 40 runs; 2040 runs are a multiple of it",
        ),
        ("stop: decided", "stop: soon", "monte_carlo.stop: 'soon' is not one of decided"),
        (ASKED[ASKED.index("requirements") :], "", "monte_carlo.stop: there is no requirement that could be decided"),
    ],
)
def test_what_cannot_stop_is_refused_in_one_line(study, old, new, message):
    assert old in ASKED
    with pytest.raises(InputError) as caught:
        load(study.append(ASKED.replace(old, new)))
    assert str(caught.value).partition(": ")[2] == message


def test_what_a_block_counts_is_what_the_verdicts_count(tmp_path):
    """The whole of two blocks, from what the worker holds in memory and from the tables on disk."""
    stored = read(synthetic.results(tmp_path, n_run=80, failing=(3, 50)))
    asked = [
        {"metric": "velocity_error_3d", "below": "0.4 m/s"},
        {"metric": "position_error_3d", "during": "flight", "below": "35 m"},
        {"metric": "impact_error", "below": "0.1 km"},
        {"metric": "heading_error_3d", "below": "1 deg"},
    ]
    cov = synthetic.covariance()
    counts = []
    for first in (0, 40):
        block = synthetic.block(cov, first, 40, failing=(3, 50))
        summary = summarise(block, synthetic.EVENTS, cov.true_sigma, synthetic.OUTPUTS)
        counts.append(violating_runs(asked, "aaaaaaaaaaaa", synthetic.prepared_case(), cov, summary))
    total = [None if None in pair else sum(pair) for pair in zip(*counts, strict=True)]
    bounds = (0.4, 35.0, 100.0)
    on_disk = [
        int(np.sum(errors_of(stored, "aaaaaaaaaaaa", one).magnitude >= bound))
        for one, bound in zip(asked[:3], bounds, strict=True)
    ]
    assert total == [*on_disk, None]
    assert all(2 < count < 80 for count in on_disk), on_disk
