"""Sections on the covariance diagnostics and on the tests for faults."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.report.blocks import (
    Block,
    Details,
    SourceScaling,
    Table,
    Text,
    figure,
    figures,
    formatted_table,
    number,
    table_section,
    words,
)
from lvnav_trade.report.escape import data_json, note
from lvnav_trade.report.evidence import NAVIGATION, separate_events
from lvnav_trade.report.figures.integrity import is_a_grid
from lvnav_trade.report.selection import chosen_cases, first_cases, key_cases_and_quantities, omission_note
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.integrity import IN_PART, ISOLATED, WRONG
from lvnav_trade.results.statistics.gaussian import gaussian
from lvnav_trade.results.statistics.select import final_event, mean_at
from lvnav_trade.results.tables.read import Tables

_LEAST_SHARE = 0.01  # share of the variance below which a table combines a source with others
_SCALE_FACTORS = (0.1, 0.3, 1.0, 3.0, 10.0)  # factors on the sigma of a source in the tables


@table_section("budget", "The campaign requests no error budget.")
def budget(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the error budget by linear covariance: tables by source and event, stacked plots, and when each source
    acted.
    """
    key_cases, required_quantities = key_cases_and_quantities(tables)
    blocks: list[Block] = [Text(note("budget"))]
    details: list[Block] = list(omission_note(tables))
    for case in dict.fromkeys([*key_cases, *chosen_cases(tables)]):
        has_times = (tables.adjoint.case == case).any()
        for quantity in NAVIGATION:
            rows = frame[(frame.case == tables.labels[case]) & (frame.metric == f"{quantity}_error")]
            if rows.empty:
                continue
            if case in key_cases and quantity in required_quantities:
                blocks.append(figure(tables, "budget", case, quantity))
            elif quantity != "attitude":
                details.append(figure(tables, "budget", case, quantity))
            details.append(_event_table(tables, case, quantity, rows))
            if has_times and quantity != "attitude":
                details.append(figure(tables, "heatmap", case, quantity, name="when"))
    title = "Budgets at every event, other cases and quantities, and the times at which errors enter"
    return [*blocks, Details(title, details)]


def _event_table(tables: Tables, case: str, quantity: str, rows: pd.DataFrame) -> Table:
    """Return the table of error sources by event: sigma and share of the variance, largest at the final event first.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    quantity : str
        Quantity of the error, such as "velocity".
    rows : pandas.DataFrame
        Rows of the error budget for this case and quantity.
    """
    events = separate_events(tables, case)
    is_final = events.event == final_event(tables, case)
    end = events.t_s[is_final].max()
    names = list(events.event[events.t_s <= end])
    by_source = {"index": "source", "columns": "event", "sort": False}
    sigma = rows.pivot_table(values="sigma", **by_source)[names]
    share = rows.pivot_table(values="share_ratio", **by_source)[names]
    share = share.sort_values(names[-1], ascending=False, kind="stable")
    variance = sigma.loc[share.index] ** 2
    is_large = share.max(axis=1) >= _LEAST_SHARE

    lines = [(source, variance.loc[source], share.loc[source]) for source in share.index[is_large]]
    if not is_large.all():
        small_variance = variance[~is_large].sum()
        small_share = share[~is_large].sum()
        lines.append((f"{(~is_large).sum()} others", small_variance, small_share))
    total_variance = variance.sum()
    lines.append(("all", total_variance, share.sum()))
    cells: list[tuple[str, ...]] = []
    for name, variances, shares in lines:
        texts = map(_sigma_and_share, np.sqrt(variances), shares)
        cells.append((name, *texts))
    cells += _mean_lines(tables, case, quantity, total_variance)
    return Table(
        head=(f"{quantity} ({rows.unit.iloc[0]})", *map(words, names)),
        rows=tuple(cells),
        numeric=(False,) + (True,) * len(names),
        caption=(
            f"{tables.labels[case]}: {quantity} error, 3D, by source at every event; a dash is below half a percent."
        ),
    )


def _mean_lines(tables: Tables, case: str, quantity: str, variance: pd.Series[float]) -> list[tuple[str, ...]]:
    """Return the table rows of the mean error and of the RMS error at the events.

    The result is empty if the mean error is insignificant at every event.

    case : digest of the case
    variance : variance of the error by event, in the square of the table's unit
    """
    mean = np.array([mean_at(tables, case, event, quantity) for event in variance.index])
    mean_square = mean**2 + variance
    if not (mean**2 >= _LEAST_SHARE * mean_square).any():
        return []
    rms = np.hypot(mean, np.sqrt(variance))
    significant_mean = np.where(mean >= _LEAST_SHARE * rms, mean, np.nan)
    return [
        ("mean, the same in every run", *map(number, significant_mean)),
        ("root mean square", *map(number, rms)),
    ]


def _sigma_and_share(sigma: float, share: float) -> str:
    """Return a sigma with two digits and its share of the variance.

    A share that rounds to 0 % becomes a dash; for a share of 100 % only the sigma is written.
    """
    if share > 1.0 - 1e-9:
        return number(sigma)
    if share >= 0.005:
        return f"{float(f'{sigma:.2g}'):g} ({100.0 * share:.0f} %)"
    return "–"


def grades(tables: Tables) -> list[Block]:
    """Return the effect of a larger or smaller error source on the errors at the diagnosed event: a control, and
    tables.
    """
    retuned_errors = METRICS["sensitivity"](tables)
    scalings = []
    for case in chosen_cases(tables):
        for quantity in NAVIGATION:
            scaling = _source_scaling(tables, case, quantity, retuned_errors)
            if scaling is not None:
                scalings.append(scaling)
    if not scalings:
        return [Text("The campaign requests no covariance by source at the event (covariance: {adjoint: true}).")]
    if len(retuned_errors):
        remark = note("retuned")
    else:
        remark = "The campaign requests no re-tuned numbers (covariance: {sensitivity: true})."
    text = Text(f"{note('grades')} {remark}")
    return [text, SourceScaling(data_json(scalings)), *map(_scaling_table, scalings)]


def _source_scaling(tables: Tables, case: str, quantity: str, retuned_errors: pd.DataFrame) -> dict[str, Any] | None:
    """Return the mean square of an error and of its sources, with the re-tuned points of each source.

    Squares are in the square of the display unit. None if linear covariance has no budget of the error.

    case : digest of the case
    retuned_errors : rows of the metric `sensitivity`: error for factors on the sigma of a source, filter re-tuned
    """
    rows = tables.adjoint[tables.adjoint.case == case]
    if len(rows):
        event = str(rows.event.iloc[0])
    else:
        event = final_event(tables, case)
    law = gaussian(tables, case, event, quantity, "3d")
    if law is None or not law.sources:
        return None
    unit, factor = tables.display_units[quantity, "3d"]
    label = tables.labels[case]
    points: dict[str, list[list[float]]] = {name: [] for name in law.sources}
    case_rows = retuned_errors[(retuned_errors.case == label) & (retuned_errors.metric == f"{quantity}_error")]
    for row in case_rows.itertuples():
        error = float(f"{row.retuned:.6g}")
        points.setdefault(row.source, []).append([row.factor_ratio, error])
    sources: list[dict[str, Any]] = []
    for name, covariance in law.sources.items():
        square = float(np.trace(covariance)) * factor**2
        sources.append({"name": name, "square": square, "retuned": points[name]})
    sources.sort(key=lambda source: -source["square"])
    mean_square = float(np.trace(law.covariance) + law.mean @ law.mean)
    return {
        "case": label,
        "metric": f"{quantity} error, 3D RMS at {words(event)}",
        "unit": unit,
        "square": mean_square * factor**2,
        "sources": sources,
    }


def _scaling_table(scaling: dict[str, Any]) -> Table:
    """Return the table of the error for factors on the sigma of each source."""
    rows = []
    for source in scaling["sources"]:
        share = source["square"] / scaling["square"]
        if share >= _LEAST_SHARE:
            rows.append((source["name"], f"{100 * share:.0f} %", *_scaled_errors(scaling["square"], source)))
    has_retuned = any(source["retuned"] for source in scaling["sources"])
    gains = "gains frozen / filter re-tuned" if has_retuned else "gains frozen"
    return Table(
        head=("source", "part of the mean square", *(f"x {factor:g}" for factor in _SCALE_FACTORS)),
        rows=tuple(rows),
        numeric=(False, True) + (True,) * len(_SCALE_FACTORS),
        caption=(
            f"{scaling['case']}: {scaling['metric']} ({scaling['unit']}), {gains}; sigma of one source times a factor."
        ),
    )


@table_section("observability", "The campaign requests no observability.")
def observability(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return rank, smallest singular values and weakest direction of each phase of flight."""
    rank = frame.rank_count.astype(str) + " / " + frame.state_count.astype(str)
    frame = frame.assign(rank=rank)
    tolerance = frame.tolerance_ratio.iloc[0]
    blocks: list[Block] = [Text(note("observability", tolerance=tolerance))]
    blocks += omission_note(tables)
    for label in chosen_cases(tables).values():
        rows = frame[frame.case == label]
        blocks.append(formatted_table("observability", rows, label=label))
    return blocks + error_bound(tables)


def error_bound(tables: Tables) -> list[Block]:
    """Return whether the noise that each filter models bounds its error, if the campaign requests this analysis.

    The error is bounded if the system is observable (full rank) and every measurement noise is positive.
    """
    rows = []
    for case, group in tables.error_bound.groupby("case", sort=False):
        first = group.iloc[0]
        noise = group[group.matrix == "R"]
        is_bounded = first.rank_count == first.state_count and (noise.lower_bound_si > 0.0).all()
        noise_texts = []
        for row in noise.itertuples():
            low = number(row.lower_bound_si)
            high = number(row.upper_bound_si)
            noise_texts.append(f"{low} to {high} {row.unit}")
        rows.append(
            (
                tables.labels[case],
                f"{first.rank_count} / {first.state_count}",
                first.lower_bound_si,
                first.upper_bound_si,
                first.weakest_direction,
                "; ".join(noise_texts),
                "yes" if is_bounded else "no",
            )
        )
    if not rows:
        return []
    return [Text(note("error_bound")), formatted_table("error_bound", pd.DataFrame(rows))]


def spot_check(tables: Tables) -> list[Block]:
    """Return how a few runs of each case agree with linear covariance: the least likely result of each case."""
    frame = METRICS["spot_check"](tables)
    if frame.empty:
        return [Text("No spot check: only the runs of the campaign, if any, test linear covariance.")]
    tested_rows = frame[frame.verdict != "not applicable"]
    if tested_rows.empty:
        return []
    cases = tested_rows.sort_values("chance_ratio", kind="stable").groupby("case", sort=False)
    outside_counts = tested_rows.verdict.eq("disagree").groupby(tested_rows.case).sum()
    worst_rows = cases.head(1)
    worst_rows = worst_rows.assign(
        rows=worst_rows.case.map(cases.size()),
        outside=worst_rows.case.map(outside_counts),
    )
    run_counts = dict.fromkeys((str(frame.runs.min()), str(frame.runs.max())))
    text = Text(note("spot_check", runs=" to ".join(run_counts)))
    blocks: list[Block] = [text, formatted_table("spot_check", worst_rows)]
    if is_a_grid(tables):
        blocks.append(figure(tables, "validity"))
    return blocks


@table_section("nonlinearity")
def nonlinearity(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the nonlinearity index of each case at its worst event."""
    cases = frame.groupby("case", sort=False)
    worst = frame.loc[cases.propagation_ratio.idxmax()].assign(
        transition_ratio=cases.transition_ratio.max().to_numpy(),
        measurement_ratio=cases.measurement_ratio.max().to_numpy(),
    )
    return [Text(note("nonlinearity")), formatted_table("nonlinearity", worst)]


_SHARES = ("false alarm", "detected", ISOLATED, IN_PART, WRONG, "missed", "recovered")
_TIMES = ("detected", ISOLATED, "recovered")
_MOST = 4  # decisions shown for each case


@table_section("integrity")
def rates(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return detection, isolation and false-alarm rates of each case, and the times to detect, to isolate and to
    recover.
    """
    rows = []
    for (case, fault), group in frame.groupby(["case", "fault"], sort=False):
        outcomes = group.set_index("outcome")
        row = {
            "case": case,
            "fault": fault.replace("_", " "),
            "runs": int(group.run_count.iloc[0]),
        }
        for outcome in _SHARES:
            row[outcome.replace(" ", "_")] = _share(outcomes, outcome)
        for outcome in _TIMES:
            row[f"time,_{outcome.replace(' ', '_')}"] = _time(outcomes, outcome)
        rows.append(row)
    return [Text(note("integrity")), formatted_table("integrity", pd.DataFrame(rows))]


@table_section("decisions")
def _exclusions(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the most frequent exclusions of each case, with their times."""
    keys = ["case", "isolated_element", "satellites"]
    run_rows = frame.loc[frame.index.repeat(frame.run_count)]
    times = run_rows.groupby(keys, sort=False).t_s
    decisions = pd.DataFrame(
        {
            "times": times.size(),
            "first_s": times.min(),
            "median_s": times.median(),
            "last_s": times.max(),
        }
    )
    decisions["lincov"] = frame.groupby(keys, sort=False).lincov.sum().reindex(decisions.index)
    decisions = decisions.reset_index().sort_values("times", ascending=False, kind="stable")
    most_frequent = decisions.groupby("case", sort=False).head(_MOST)
    places = {case: place for place, case in enumerate(frame.case.unique())}
    most_frequent = most_frequent.sort_values("case", key=lambda cases: cases.map(places), kind="stable")
    return [formatted_table("decisions", most_frequent)]


def _share(rows: pd.DataFrame, outcome: str) -> str:
    """Return a share in percent with its confidence interval; a dash if the case lacks the outcome."""
    if outcome not in rows.index:
        return "–"
    result = rows.loc[outcome]
    return f"{100 * result.share_ratio:.3g} ({100 * result.low_ratio:.3g} to {100 * result.high_ratio:.3g})"


def _time(rows: pd.DataFrame, outcome: str) -> str:
    """Return the median time (s) over the runs, followed by that of linear covariance in brackets."""
    if outcome not in rows.index:
        return "–"
    result = rows.loc[outcome]
    return f"{number(result.median_s)} ({number(result.lincov_s)})"


@table_section("fault_test_errors")
def fault_test_benefit(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return errors at the last event with and without the fault tests, if the campaign has both."""
    return [formatted_table("tested_errors", frame)]


def integrity(tables: Tables) -> list[Block]:
    """Return the performance of the fault tests in tables, and figures of their decisions over time."""
    blocks = rates(tables)
    if not blocks:
        return []
    labels = set(METRICS["decisions"](tables).case)
    cases_with_tests = [case for case, label in tables.labels.items() if label in labels]
    cases, remark = first_cases(cases_with_tests)
    return [
        *blocks,
        *fault_test_benefit(tables),
        *_exclusions(tables),
        *figures(tables, "decisions", cases),
        *remark,
    ]


def _scaled_errors(total: float, source: dict[str, Any]) -> list[str]:
    """Return the error for each factor on the sigma of a source, followed by that of the re-tuned filter.

    With frozen gains the mean square is J + (f^2 - 1) J_i, where J_i is the contribution of source i and f the factor.

    total : mean square J of the error
    """
    retuned_errors = dict(source["retuned"])
    texts = []
    for factor in _SCALE_FACTORS:
        mean_square = total + (factor**2 - 1.0) * source["square"]
        text = number(np.sqrt(mean_square))
        if factor in retuned_errors:
            text += f" / {number(retuned_errors[factor])}"
        texts.append(text)
    return texts
