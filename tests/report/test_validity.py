"""What limits a verdict is on the first screen: inconsistent filters, errors that grow after the event."""

from __future__ import annotations

import pytest

from lvnav_trade.report.blocks import Text
from lvnav_trade.report.summary import summary
from lvnav_trade.report.validity import (
    empty_stages,
    filter_cells,
    filter_verdict,
    sigma_warnings,
    window_cells,
    window_warning,
)
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.requirements.margins import margins
from lvnav_trade.results.requirements.windows import windows
from lvnav_trade.results.tables.read import Tables, load
from tests import synthetic
from tests.injections import with_injections

BRIEF = {"name": "velocity", "metric": "velocity_error_3d", "at": "stage1_cutoff", "probability": 0.95,
         "below": "0.65 m/s", "confidence": 0.9}  # fmt: skip


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> Tables:
    return load(synthetic.results(tmp_path_factory.mktemp("alone"), n_run=0))


def scaled(tables: Tables, **factors: float) -> Tables:
    """Return results in which the expected NEES of a case is multiplied."""
    rows = tables.consistency
    by_case = rows.case.map({case: factors.get(label.partition("=")[2], 1.0) for case, label in tables.labels.items()})
    return tables.with_frames(consistency=rows.assign(expected_nees_ratio=rows.expected_nees_ratio * by_case))


def leads(blocks: list, lead: str) -> list[str]:
    return [block.text for block in blocks if isinstance(block, Text) and block.lead == lead]


@pytest.mark.parametrize(("verdict", "ratio", "cell"), [
    ("overconfident", 19.84, "✗ overconfident x20"), ("conservative", 1.0 / 3.0, "! conservative x3"),
    ("consistent", 0.98, "✓ consistent"), ("unknown", float("nan"), "–")])  # fmt: skip
def test_a_verdict_on_a_filter_has_a_sign_and_a_factor(verdict, ratio, cell):
    assert filter_verdict(verdict, ratio) == cell


def test_the_first_screen_warns_of_overconfident_filters_and_the_matrix_shows_each(alone):
    found = scaled(alone, fine=400.0, coarse=49.0)
    first = summary(found)
    (warning,) = leads(first, "Warning:")
    assert warning.startswith(
        "2 of 2 filters are overconfident: their sigma is 7.1 to 20 times too small; do not fly these covariances."
    )
    matrix = next(block for block in first if block.block_type == "table")
    at = matrix.head.index("filter consistent over the run?")
    assert (
        "Filter consistent: mean NEES (normalised estimation error squared) over the run and at injection."
        in matrix.caption
    )
    assert {row[0]: row[at] for row in matrix.rows} == {
        "imu=coarse": "✗ overconfident x7.1", "imu=fine": "✗ overconfident x20",
    }  # fmt: skip


def test_consistent_filters_are_no_warning_and_conservative_ones_a_note(alone):
    assert sigma_warnings(alone) == []
    assert set(filter_cells(alone).values()) == {"✓ consistent"}
    (note,) = leads(sigma_warnings(scaled(alone, fine=1.0 / 9.0)), "Note:")
    assert note == "1 of 2 filters is conservative: its sigma is 3 times too large."


def test_a_requirement_that_is_met_at_its_event_and_not_after_it_is_a_warning(alone):
    """The 95 % quantile of the fine case is 0.61 m/s at the event and 0.70 m/s 20 s after it; of the coarse 1.8 m/s."""
    found = alone.with_frames()
    found.__dict__["campaign"] = {**alone.campaign, "requirements": [BRIEF]}
    (warning,) = leads(window_warning(found), "Warning:")
    assert warning == (
        "Velocity is met at stage1 cutoff only. The design that meets it exceeds 0.65 m/s between 5 s before and 20 s "
        "after the event (95 % quantile by linear covariance): imu=fine: 0.698 m/s 20.0 s after the event."
    )
    (column,) = window_cells(found).items()
    assert column == (
        "worst from -5 to +20 s (m/s)", {"imu=fine": "✗ 0.698 at +20.0 s", "imu=coarse": "✗ 2.09 at +20.0 s"}
    )  # fmt: skip
    assert leads(window_warning(alone), "Warning:") == []


def of_two(tables: Tables, **columns: object) -> Tables:
    """Return results in which both cases meet a requirement at its event, with other columns in `windows`."""
    found = tables.with_frames()
    found.__dict__["campaign"] = {**tables.campaign, "requirements": [{**BRIEF, "below": "2.0 m/s"}]}
    frame = windows(found)
    assert list(frame.case) == ["imu=fine", "imu=coarse"]
    found.cache[windows.__module__, "windows"] = frame.assign(**columns)
    return found


def test_a_warning_says_how_many_designs_stay_below_the_limit_and_which_do_not(alone):
    """The 95 % quantile of the fine case is 0.70 m/s at most, of the coarse one 2.09 m/s after the event."""
    (warning,) = leads(window_warning(of_two(alone)), "Warning:")
    assert warning == (
        "Velocity around stage1 cutoff: 2 designs meet the requirement at the event. Between 5 s before and 20 s after "
        "the event, 1 stays below the limit of 2 m/s and 1 exceeds it (95 % quantile by linear covariance): "
        "imu=coarse: 2.09 m/s 20.0 s after the event."
    )
    both = of_two(alone, worst=3.0, verdict_changes=True)
    (warning,) = leads(window_warning(both), "Warning:")
    assert warning.startswith(
        "Velocity is met at stage1 cutoff only. All 2 designs that meet it exceed 2 m/s between 5 s before and 20 s"
    )
    missing = of_two(alone)
    missing.cache[windows.__module__, "windows"] = windows(missing).iloc[1:]
    (warning,) = leads(window_warning(missing), "Warning:")
    assert "after the event, none stays below the limit of 2 m/s, 1 is not" in warning
    assert "1 is not evaluated and 1 exceeds it (95 %" in warning


def test_window_columns_are_marked_as_the_verdicts_are(alone):
    found = of_two(alone, by=["LinCov", "runs, extrapolated"])
    (column,) = window_cells(found).values()
    assert column == {"imu=fine": "✓ 0.698 at +20.0 s", "imu=coarse": "✗ 2.09 at +20.0 s ‡"}
    frame = METRICS["margins"](found)
    found.cache[margins.__module__, "margins"] = frame.assign(by=["runs", "LinCov"])
    (column,) = window_cells(found).values()
    assert column == {"imu=fine": "✓ 0.698 at +20.0 s †", "imu=coarse": "✗ 2.09 at +20.0 s ‡"}
    matrix = next(block for block in summary(found) if block.block_type == "table")
    assert " † by linear covariance, ‡ extrapolated from few runs. " in matrix.caption


def test_a_filter_that_is_inconsistent_at_an_event_alone_says_at_which(alone, monkeypatch):
    frame = METRICS["filter_verdicts"](alone).assign(verdict="overconfident", sigma_ratio=4.0,
                                                     moment=["run", "stage1_cutoff"])  # fmt: skip
    monkeypatch.setattr("lvnav_trade.report.validity.METRICS", {"filter_verdicts": lambda _: frame})
    assert list(filter_cells(alone).values()) == ["✗ overconfident x4", "✗ overconfident x4 at stage1 cutoff"]


def test_one_reason_is_said_once_for_several_requirements(alone):
    found = alone.with_frames()
    realism = {**BRIEF, "metric": "normalised_attitude_error", "below": "9 sigma"}
    both = [{**realism, "name": "realism"}, {**realism, "name": "realism twice"}]
    found.__dict__["campaign"] = {**alone.campaign, "requirements": both}
    (note,) = leads(window_warning(found), "Note:")
    assert note == (
        "The duration of the verdict is unknown for realism, realism twice, around stage1 cutoff: the covariance "
        "between the axes of attitude is stored at events only."
    )


def test_what_the_extent_of_a_window_rests_on_is_said_case_by_case_where_it_differs(alone):
    found = alone.with_frames()
    found.__dict__["campaign"] = {**alone.campaign, "requirements": [{**BRIEF, "below": "2.0 m/s"}]}
    frame = windows(found).assign(verdict_changes=True, by=["LinCov", "runs, extrapolated"])
    found.cache[windows.__module__, "windows"] = frame
    (warning,) = leads(window_warning(found), "Warning:")
    assert "(95 % quantile): imu=fine: 0.698 m/s 20.0 s after the event, by linear covariance; imu=coarse: " in warning
    assert warning.endswith(" 20.0 s after the event, extrapolated from few runs.")


def test_the_first_screen_says_of_what_no_window_could_be_evaluated(alone):
    found = alone.with_frames()
    realism = {**BRIEF, "name": "realism", "metric": "normalised_attitude_error", "below": "9 sigma"}
    found.__dict__["campaign"] = {**alone.campaign, "requirements": [BRIEF, realism]}
    (note,) = leads(summary(found), "Note:")
    assert note == (
        "The duration of the verdict is unknown for realism, around stage1 cutoff: the covariance between the axes of "
        "attitude is stored at events only."
    )
    assert leads(window_warning(alone), "Note:") == []


def test_more_requirements_than_there_is_room_for_are_in_a_table_of_their_own(alone):
    found = alone.with_frames()
    found.__dict__["campaign"] = {**alone.campaign, "requirements": [{**BRIEF, "name": f"v{k}"} for k in range(3)]}
    assert window_cells(found) == {}


def test_runs_that_empty_their_stage_are_stated_with_the_worst_design(tmp_path) -> None:
    plain = load(synthetic.results(tmp_path, n_run=8, size=8))
    assert empty_stages(plain) == []
    tables = with_injections(plain)
    label = next(iter(tables.labels.values()))
    (note,) = empty_stages(tables)
    assert note.lead == "Empty stages."
    assert note.text == (
        f"In 1 of 1 designs, the last stage is empty before its cut-off in 1 of 8 runs (most: {label}). The orbit "
        "error of these runs counts as infinite. Their draws are listed under Injection accuracy."
    )
    assert note in summary(tables)
