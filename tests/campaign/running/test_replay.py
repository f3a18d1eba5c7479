"""The run that is asked for is found, or the mistake reported; what it leaves is a table with units."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import replay, work
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables.run_tables import trace_columns
from tests.building import flying, hop
from tests.campaign import fakes


@pytest.fixture
def found(study) -> list[Case]:
    study.append("axes: [{path: imu, cards: [imu/good, imu/poor]}]\n")
    return cases(load(study.path))


def test_a_case_is_known_by_its_digest_its_beginning_or_its_label(found: list[Case]) -> None:
    for wanted in (found[1].id, found[1].id[:6], "imu=poor"):
        assert replay.find(found, wanted) is found[1]


def test_a_beginning_that_several_cases_share_is_refused(found: list[Case]) -> None:
    with pytest.raises(InputError, match=r"^'' fits several cases, give more of one: "):
        replay.find(found, "")


def test_an_unknown_case_is_refused_with_the_nearest(found: list[Case]) -> None:
    with pytest.raises(InputError) as caught:
        replay.find(found, "imu=por")
    ids = ", ".join(case.id for case in found)
    assert str(caught.value) == f"no case 'imu=por' (did you mean 'imu=poor'?); the cases are {ids}"


def test_runs_are_counted_from_zero(study, found: list[Case]) -> None:
    with pytest.raises(InputError, match=r"^run -1: runs are counted from 0$"):
        replay.replay(load(study.path), found[0], -1)


@pytest.fixture(scope="module")
def again() -> replay.RunReplay:
    """Return run 3 of the smoke campaign's scenario, flown again on a short flight."""
    campaign = load("campaigns/smoke.yaml")
    with flying(hop()):
        return replay.replay(campaign, cases(campaign)[0], 3)


def test_the_trace_holds_every_covariance_step_with_the_unit_in_every_name(again: replay.RunReplay) -> None:
    t = again.trace.t_s.to_numpy()
    assert np.max(np.diff(t)) < 0.1 + 1e-9  # 10 Hz
    assert {"position_north_error_m", "position_north_sigma_m", "attitude_roll_error_rad"} <= set(again.trace.columns)
    assert np.all(np.isfinite(again.trace.to_numpy()))
    assert again.failure == ""


def test_the_events_come_in_time_order_in_the_units_of_people(again: replay.RunReplay) -> None:
    names = [name for name, *_ in again.event_errors]
    assert names == ["liftoff", "end0", "end1"]
    _, t, sizes, units = again.event_errors[-1]
    row = again.trace[again.trace.t_s == t].iloc[0]
    norm = np.linalg.norm([row[f"attitude_{axis}_error_rad"] for axis in ("roll", "pitch", "yaw")])
    assert sizes["attitude"] == pytest.approx(1e3 * norm, rel=1e-12)
    assert units == {"position": "m", "velocity": "m/s", "attitude": "mrad"}


def test_the_trace_is_kept_beside_the_results(again: replay.RunReplay, found: list[Case], tmp_path: Path) -> None:
    path = replay.write_trace(again, tmp_path, found[0], 3)
    assert path == tmp_path / "traces" / f"{found[0].id}-3.parquet"
    pd.testing.assert_frame_equal(pd.read_parquet(path), again.trace)


def test_a_trace_that_cannot_be_written_is_reported(again: replay.RunReplay, found: list[Case], tmp_path: Path) -> None:
    (tmp_path / "traces").write_text("")
    with pytest.raises(InputError, match="cannot be written: "):
        replay.write_trace(again, tmp_path, found[0], 3)


def test_a_worst_run_over_time_is_the_same_run(again: replay.RunReplay, tmp_path: Path) -> None:
    """Run 3 flown by a unit of work, against the run that was flown again for `again`."""
    written: dict[str, object] = {}

    class Results:
        def write_traces(self, case: str, prepared_case: Any, blocks: Any) -> None:
            written.update(trace_columns(prepared_case.outputs, blocks), case=case)

    campaign = load("campaigns/smoke.yaml")
    case = cases(campaign)[0]
    with flying(hop()):
        job = work.job_of(campaign, work.ENGINE, tmp_path)._replace(results=Results())
        assert replay.trace(job, case, [3]).error == ""
    assert (written["case"], set(written["run_number"])) == (case.id, {3})
    frame = pd.DataFrame(written)
    for quantity, axes in (("position", ("north", "east", "down")), ("attitude", ("roll", "pitch", "yaw"))):
        mine = frame[frame.quantity == quantity]
        unit = "m" if quantity == "position" else "rad"
        there = again.trace.set_index("t_s").loc[mine.t_s, [f"{quantity}_{axis}_error_{unit}" for axis in axes]]
        np.testing.assert_allclose(mine.error_si, np.linalg.norm(there, axis=1), rtol=1e-12)


def test_a_worst_run_that_is_lost_is_named(found: list[Case], study, tmp_path: Path) -> None:
    class Results:
        def write_traces(self, case: str, prepared_case: Any, blocks: Any) -> None:
            raise ValueError("no room")

    engine = fakes.Fake().engine()
    job = work.job_of(load(study.path), engine, tmp_path)._replace(results=Results())
    assert replay.trace(job, found[0], [0]) == work.WorkOutcome(found[0].id, 0, 0, error="ValueError: no room")
