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
    chosen_cases,
    deciding,
    few,
    figure,
    figures,
    left_out,
    number,
    of,
    stated,
    words,
)
from lvnav_trade.report.escape import data_json, note
from lvnav_trade.report.evidence import NAVIGATION, separate_events
from lvnav_trade.report.figures.integrity import is_a_grid
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.integrity import IN_PART, ISOLATED, WRONG
from lvnav_trade.results.statistics.gaussian import gaussian
from lvnav_trade.results.statistics.select import final_event, mean_at
from lvnav_trade.results.tables.read import Tables

_LEAST_SHARE = 0.01  # share of the variance below which a table combines a source with others


@of("budget", "The campaign requests no error budget.")
def budget(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the error budget by linear covariance: tables by source and event, stacked plots, and when each source
    acted.
    """
    key, required = deciding(tables)
    blocks: list[Block] = [Text(note("budget"))]
    further: list[Block] = list(left_out(tables))
    for case in dict.fromkeys([*key, *chosen_cases(tables)]):
        for quantity in NAVIGATION:
            place = blocks if case in key and quantity in required else further
            rows = frame[(frame.case == tables.labels[case]) & (frame.metric == f"{quantity}_error")]
            if len(rows) and (place is blocks or quantity != "attitude"):
                place.append(figure(tables, "budget", case, quantity))
            if len(rows):
                further.append(_by_event(tables, case, quantity, rows))
            if len(rows) and quantity != "attitude" and (tables.adjoint.case == case).any():
                further.append(figure(tables, "heatmap", case, quantity, name="when"))
    title = "Budgets at every event, other cases and quantities, and the times at which errors enter"
    return [*blocks, Details(title, further)]


def _by_event(tables: Tables, case: str, quantity: str, rows: pd.DataFrame) -> Table:
    """Return the table of sources by events: sigma and share of the variance, largest at the final event first."""
    events = separate_events(tables, case)
    names = list(events.event[events.t_s <= events.t_s[events.event == final_event(tables, case)].max()])
    share, sigma = (
        rows.pivot_table(index="source", columns="event", values=column, sort=False)[names]
        for column in ("share_ratio", "sigma")
    )
    share = share.sort_values(names[-1], ascending=False, kind="stable")
    square, large = sigma.loc[share.index] ** 2, share.max(axis=1) >= _LEAST_SHARE
    lines = [(source, square.loc[source], share.loc[source]) for source in share.index[large]]
    if not large.all():
        lines.append((f"{(~large).sum()} others", square[~large].sum(), share[~large].sum()))
    lines.append(("all", square.sum(), share.sum()))
    cells = [(name, *map(_part, np.sqrt(squares), parts)) for name, squares, parts in lines]
    head = (f"{quantity} ({rows.unit.iloc[0]})", *map(words, names))
    caption = f"{tables.labels[case]}: {quantity} error, 3D, by source at every event; a dash is below half a percent."
    cells += _with_mean(tables, case, quantity, square.sum())
    return Table(head, tuple(cells), (False, *(True for _ in names)), caption)


def _with_mean(tables: Tables, case: str, quantity: str, square: pd.Series[float]) -> tuple[tuple[str, ...], ...]:
    """Return the table rows of the mean error and of the RMS error at the events.

    The result is empty if the mean error is insignificant at every event.

    square : variance by event, in the square of the table's unit
    """
    mean = np.array([mean_at(tables, case, event, quantity) for event in square.index])
    if not (mean**2 >= _LEAST_SHARE * (mean**2 + square)).any():
        return ()
    rms = np.hypot(mean, np.sqrt(square))
    significant_mean = np.where(mean >= _LEAST_SHARE * rms, mean, np.nan)
    return ("mean, the same in every run", *map(number, significant_mean)), ("root mean square", *map(number, rms))


def _part(sigma: float, share: float) -> str:
    """Return a sigma with two digits and its share of the variance.

    A share that rounds to 0 % becomes a dash; for a share of 100 % only the sigma is written.
    """
    if share > 1.0 - 1e-9:
        return number(sigma)
    return f"{float(f'{sigma:.2g}'):g} ({100.0 * share:.0f} %)" if share >= 0.005 else "–"


def grades(tables: Tables) -> list[Block]:
    """Return the effect of a larger or smaller error source on the errors at the diagnosed event: a control, and
    tables.
    """
    tuned = METRICS["sensitivity"](tables)
    metrics = (_metric(tables, case, quantity, tuned) for case in chosen_cases(tables) for quantity in NAVIGATION)
    data = [metric for metric in metrics if metric is not None]
    if not data:
        return [Text("The campaign requests no covariance by source at the event (covariance: {adjoint: true}).")]
    absent = "The campaign requests no re-tuned numbers (covariance: {sensitivity: true})."
    text = f"{note('grades')} {note('retuned') if len(tuned) else absent}"
    return [Text(text), SourceScaling(data_json(data)), *map(_grades_table, data)]


def _metric(tables: Tables, case: str, quantity: str, tuned: pd.DataFrame) -> dict[str, Any] | None:
    """Return the mean square of an error and of its sources, with the re-tuned points of each source.

    Squares are in the square of the display unit. None if linear covariance has no budget of the error.
    """
    rows = tables.adjoint[tables.adjoint.case == case]
    event = str(rows.event.iloc[0]) if len(rows) else final_event(tables, case)
    law = gaussian(tables, case, event, quantity, "3d")
    if law is None or not law.sources:
        return None
    unit, factor = tables.people[quantity, "3d"]
    label = tables.labels[case]
    tuned = tuned[(tuned.case == label) & (tuned.metric == f"{quantity}_error")]
    points: dict[str, list[list[float]]] = {name: [] for name in law.sources}
    for name, ratio, retuned in zip(tuned.source, tuned.factor_ratio, tuned.retuned, strict=True):
        points.setdefault(name, []).append([ratio, float(f"{retuned:.6g}")])
    sources: list[dict[str, Any]] = [
        {"name": name, "square": float(np.trace(covariance)) * factor**2, "retuned": points[name]}
        for name, covariance in law.sources.items()
    ]
    sources.sort(key=lambda source: -source["square"])
    total = float(np.trace(law.covariance) + law.mean @ law.mean) * factor**2
    metric = f"{quantity} error, 3D RMS at {words(event)}"
    return {"case": label, "metric": metric, "unit": unit, "square": total, "sources": sources}


def _grades_table(found: dict[str, Any]) -> Table:
    """Return the table of the error for factors on the sigma of each source.

    With frozen gains the mean square is J + (f^2 - 1) J_i, where J_i is the contribution of source i and f the factor.
    """
    factors = (0.1, 0.3, 1.0, 3.0, 10.0)
    rows = []
    for source in found["sources"]:
        share, tuned = source["square"] / found["square"], dict(source["retuned"])
        if share >= _LEAST_SHARE:
            frozen = [np.sqrt(found["square"] + (factor**2 - 1.0) * source["square"]) for factor in factors]
            cells = [
                number(size) + (f" / {number(tuned[factor])}" if factor in tuned else "")
                for size, factor in zip(frozen, factors, strict=True)
            ]
            rows.append((source["name"], f"{100 * share:.0f} %", *cells))
    head = ("source", "part of the mean square", *(f"x {factor:g}" for factor in factors))
    compared = (
        "gains frozen / filter re-tuned" if any(source["retuned"] for source in found["sources"]) else "gains frozen"
    )
    caption = f"{found['case']}: {found['metric']} ({found['unit']}), {compared}; sigma of one source times a factor."
    return Table(head, tuple(rows), (False, *(True for _ in head[1:])), caption)


@of("observability", "The campaign requests no observability.")
def observability(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return rank, smallest singular values and weakest direction of each phase of flight."""
    frame = frame.assign(rank=frame.rank_count.astype(str) + " / " + frame.state_count.astype(str))
    labels = chosen_cases(tables).values()
    case_tables = [stated("observability", frame[frame.case == label], label=label) for label in labels]
    text = Text(note("observability", tolerance=frame.tolerance_ratio.iloc[0]))
    return [text, *left_out(tables), *case_tables, *error_bound(tables)]


def error_bound(tables: Tables) -> list[Block]:
    """Return whether the noise that each filter models bounds its error, if the campaign requests this analysis.

    The error is bounded if the system is observable (full rank) and every measurement noise is positive.
    """
    rows = []
    for case, group in tables.error_bound.groupby("case", sort=False):
        first_row, noise = group.iloc[0], group[group.matrix == "R"]
        holds = first_row.rank_count == first_row.state_count and (noise.lower_bound_si > 0.0).all()
        noises = [f"{number(r.lower_bound_si)} to {number(r.upper_bound_si)} {r.unit}" for r in noise.itertuples()]
        bounds = (
            first_row.lower_bound_si,
            first_row.upper_bound_si,
            first_row.weakest_direction,
            "; ".join(noises),
            "yes" if holds else "no",
        )
        rows.append((tables.labels[case], f"{first_row.rank_count} / {first_row.state_count}", *bounds))
    return [Text(note("error_bound")), stated("error_bound", pd.DataFrame(rows))] if rows else []


def spot_check(tables: Tables) -> list[Block]:
    """Return how a few runs of each case agree with linear covariance: the least likely result of each case."""
    frame = METRICS["spot_check"](tables)
    if frame.empty:
        return [Text("No spot check: only the runs of the campaign, if any, test linear covariance.")]
    tested = frame[frame.verdict != "not applicable"]
    cases = tested.sort_values("chance_ratio", kind="stable").groupby("case", sort=False)
    outside = tested.verdict.eq("disagree").groupby(tested.case).sum()
    worst = cases.head(1)
    worst = worst.assign(rows=worst.case.map(cases.size()), outside=worst.case.map(outside))
    runs = " to ".join(dict.fromkeys(f"{count}" for count in (frame.runs.min(), frame.runs.max())))
    if worst.empty:
        return []
    blocks: list[Block] = [Text(note("spot_check", runs=runs)), stated("spot_check", worst)]
    return [*blocks, figure(tables, "validity")] if is_a_grid(tables) else blocks


@of("nonlinearity")
def nonlinearity(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the nonlinearity index of each case at its worst event."""
    cases = frame.groupby("case", sort=False)
    worst = frame.loc[cases.propagation_ratio.idxmax()].assign(
        transition_ratio=cases.transition_ratio.max().to_numpy(),
        measurement_ratio=cases.measurement_ratio.max().to_numpy(),
    )
    return [Text(note("nonlinearity")), stated("nonlinearity", worst)]


_SHARES = ("false alarm", "detected", ISOLATED, IN_PART, WRONG, "missed", "recovered")
_TIMES = ("detected", ISOLATED, "recovered")
_MOST = 4  # decisions shown for each case


@of("integrity")
def rates(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return detection, isolation and false-alarm rates of each case, and the times to detect, to isolate and to
    recover.
    """
    rows = []
    for (case, fault), outcomes in frame.groupby(["case", "fault"], sort=False):
        of_outcome = outcomes.set_index("outcome")
        row = {"case": case, "fault": fault.replace("_", " "), "runs": int(outcomes.run_count.iloc[0])}
        row |= {name: _share(of_outcome, name) for name in _SHARES}
        row |= {f"time, {name}": _time(of_outcome, name) for name in _TIMES}
        rows.append(row)
    all_rates = pd.DataFrame(rows).rename(columns=lambda name: name.replace(" ", "_"))
    return [Text(note("integrity")), stated("integrity", all_rates)]


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


@of("fault_test_errors")
def worth(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return errors at the last event with and without the fault tests, if the campaign has both."""
    return [stated("tested_errors", frame)]


@of("decisions")
def _decided(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the most frequent exclusions of each case, with their times."""
    keys = ["case", "isolated_element", "satellites"]
    times = frame.loc[frame.index.repeat(frame.run_count)].groupby(keys, sort=False).t_s
    decisions = pd.DataFrame(
        {"times": times.size(), "first_s": times.min(), "median_s": times.median(), "last_s": times.max()}
    )
    decisions["lincov"] = frame.groupby(keys, sort=False).lincov.sum().reindex(decisions.index)
    decisions = decisions.reset_index().sort_values("times", ascending=False, kind="stable")
    first_rows = decisions.groupby("case", sort=False).head(_MOST)
    order = {case: place for place, case in enumerate(frame.case.unique())}
    return [stated("decisions", first_rows.sort_values("case", key=lambda case: case.map(order), kind="stable"))]


def integrity(tables: Tables) -> list[Block]:
    """Return the performance of the fault tests in tables, and figures of their decisions over time."""
    blocks = rates(tables)
    if not blocks:
        return []
    decided = METRICS["decisions"](tables).case
    group, more = few([case for case, label in tables.labels.items() if label in set(decided)])
    return [*blocks, *worth(tables), *_decided(tables), *figures(tables, "decisions", group), *more]
