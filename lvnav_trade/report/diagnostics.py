"""Sections on the covariance diagnostics and on the tests for faults."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.report.blocks import (
    Block,
    Grades,
    More,
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

_LEAST_SHARE = 0.01  # part of the variance below which a source is summed with others in a table


@of("budget", "The campaign requests no error budget.")
def budget(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return linear covariance's errors by source: tables at every event, sandpiles, and when each source acted."""
    key, asked = deciding(tables)
    blocks: list[Block] = [Text(note("budget"))]
    rest: list[Block] = list(left_out(tables))
    for case in dict.fromkeys([*key, *chosen_cases(tables)]):
        for quantity in NAVIGATION:
            place = blocks if case in key and quantity in asked else rest
            rows = frame[(frame.case == tables.labels[case]) & (frame.metric == f"{quantity}_error")]
            if len(rows) and (place is blocks or quantity != "attitude"):
                place.append(figure(tables, "budget", case, quantity))
            if len(rows):
                rest.append(_by_event(tables, case, quantity, rows))
            if len(rows) and quantity != "attitude" and (tables.adjoint.case == case).any():
                rest.append(figure(tables, "heatmap", case, quantity, name="when"))
    return [*blocks, More("Budgets at every event, of other cases and quantities, and when errors were made", rest)]


def _by_event(tables: Tables, case: str, quantity: str, rows: pd.DataFrame) -> Table:
    """Return source x event: sigma and part of the variance, largest at the final event first."""
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
    """Return the rows of the mean error at the events and of the root mean square with it, where it counts at any."""
    mean = np.array([mean_at(tables, case, event, quantity) for event in square.index])
    if not (mean**2 >= _LEAST_SHARE * (mean**2 + square)).any():
        return ()
    whole = np.hypot(mean, np.sqrt(square))
    shown = np.where(mean >= _LEAST_SHARE * whole, mean, np.nan)
    return ("mean, the same in every flight", *map(number, shown)), ("root mean square", *map(number, whole))


def _part(sigma: float, share: float) -> str:
    """Write a sigma with two digits and its part; a dash for what would be 0 %, the sigma alone for all."""
    if share > 1.0 - 1e-9:
        return number(sigma)
    return f"{float(f'{sigma:.2g}'):g} ({100.0 * share:.0f} %)" if share >= 0.005 else "–"


def grades(tables: Tables) -> list[Block]:
    """Return what a source of another size would do to the errors at the explained event: a control, and tables."""
    tuned = METRICS["sensitivity"](tables)
    metrics = (_metric(tables, case, quantity, tuned) for case in chosen_cases(tables) for quantity in NAVIGATION)
    data = [found for found in metrics if found is not None]
    if not data:
        return [Text("The campaign requests no covariance by source at the event (covariance: {adjoint: true}).")]
    absent = "The campaign requests no re-tuned numbers (covariance: {sensitivity: true})."
    text = f"{note('grades')} {note('retuned') if len(tuned) else absent}"
    return [Text(text), Grades(data_json(data)), *map(_grades_table, data)]


def _metric(tables: Tables, case: str, quantity: str, tuned: pd.DataFrame) -> dict[str, Any] | None:
    """Return the squares of a norm and of its sources, in the units of people, with the re-tuned points of each."""
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
        {"name": name, "square": float(np.trace(part)) * factor**2, "retuned": points[name]}
        for name, part in law.sources.items()
    ]
    sources.sort(key=lambda source: -source["square"])
    total = float(np.trace(law.covariance) + law.mean @ law.mean) * factor**2
    metric = f"{quantity} error, 3D RMS at {words(event)}"
    return {"case": label, "metric": metric, "unit": unit, "square": total, "sources": sources}


def _grades_table(found: dict[str, Any]) -> Table:
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
    what = "gains frozen / filter re-tuned" if any(source["retuned"] for source in found["sources"]) else "gains frozen"
    caption = f"{found['case']}: {found['metric']} ({found['unit']}), {what}; sigma of one source times a factor."
    return Table(head, tuple(rows), (False, *(True for _ in head[1:])), caption)


@of("observability", "The campaign requests no observability.")
def observability(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return rank, smallest singular values and weakest direction of each phase of flight."""
    frame = frame.assign(rank=frame.rank_count.astype(str) + " / " + frame.state_count.astype(str))
    labels = chosen_cases(tables).values()
    shown = [stated("observability", frame[frame.case == label], label=label) for label in labels]
    text = Text(note("observability", tolerance=frame.tolerance_ratio.iloc[0]))
    return [text, *left_out(tables), *shown, *error_bound(tables)]


def error_bound(tables: Tables) -> list[Block]:
    """Return whether the noise that each filter models keeps its error bounded, where a campaign asked."""
    rows = []
    for case, group in tables.error_bound.groupby("case", sort=False):
        one, noise = group.iloc[0], group[group.matrix == "R"]
        holds = one.rank_count == one.state_count and (noise.low_si > 0.0).all()
        noises = [f"{number(r.low_si)} to {number(r.high_si)} {r.unit}" for r in noise.itertuples()]
        bounds = (one.low_si, one.high_si, one.weakest, "; ".join(noises), "yes" if holds else "no")
        rows.append((tables.labels[case], f"{one.rank_count} / {one.state_count}", *bounds))
    return [Text(note("error_bound")), stated("error_bound", pd.DataFrame(rows))] if rows else []


def spot_check(tables: Tables) -> list[Block]:
    """Return what a few runs of each case say of linear covariance: the least likely row of each case."""
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
    found: list[Block] = [Text(note("spot_check", runs=runs)), stated("spot_check", worst)]
    return [*found, figure(tables, "validity")] if is_a_grid(tables) else found


@of("nonlinearity")
def nonlinearity(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the nonlinearity index of each case at its worst event."""
    cases = frame.groupby("case", sort=False)
    worst = frame.loc[cases.motion_ratio.idxmax()].assign(
        transition_ratio=cases.transition_ratio.max().to_numpy(), row_ratio=cases.row_ratio.max().to_numpy()
    )
    return [Text(note("nonlinearity")), stated("nonlinearity", worst)]


_SHARES = ("false alarm", "detected", ISOLATED, IN_PART, WRONG, "missed", "recovered")
_TIMES = ("detected", ISOLATED, "recovered")
_MOST = 4  # decisions of a case that the page shows


@of("integrity")
def rates(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the rates of each case, and the times to detect, to isolate and to recover."""
    rows = []
    for (case, fault), one in frame.groupby(["case", "fault"], sort=False):
        of_outcome = one.set_index("outcome")
        row = {"case": case, "fault": fault.replace("_", " "), "runs": int(one.run_count.iloc[0])}
        row |= {name: _share(of_outcome, name) for name in _SHARES}
        row |= {f"time, {name}": _time(of_outcome, name) for name in _TIMES}
        rows.append(row)
    found = pd.DataFrame(rows).rename(columns=lambda name: name.replace(" ", "_"))
    return [Text(note("integrity")), stated("integrity", found)]


def _share(rows: pd.DataFrame, outcome: str) -> str:
    """Write a share in percent with its interval; a dash where the case has no such outcome."""
    if outcome not in rows.index:
        return "–"
    one = rows.loc[outcome]
    return f"{100 * one.share_ratio:.3g} ({100 * one.low_ratio:.3g} to {100 * one.high_ratio:.3g})"


def _time(rows: pd.DataFrame, outcome: str) -> str:
    """Write the median time, and in brackets that of linear covariance."""
    if outcome not in rows.index:
        return "–"
    one = rows.loc[outcome]
    return f"{number(one.median_s)} ({number(one.lincov_s)})"


@of("tested_errors")
def worth(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return errors at the last event with the tests and without them, where the campaign has both."""
    return [stated("tested_errors", frame)]


@of("decisions")
def _decided(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    keys = ["case", "isolated", "satellites"]
    times = frame.loc[frame.index.repeat(frame.run_count)].groupby(keys, sort=False).t_s
    found = pd.DataFrame(
        {"times": times.size(), "first_s": times.min(), "median_s": times.median(), "last_s": times.max()}
    )
    found["lincov"] = frame.groupby(keys, sort=False).lincov.sum().reindex(found.index)
    found = found.reset_index().sort_values("times", ascending=False, kind="stable")
    shown = found.groupby("case", sort=False).head(_MOST)
    order = {case: place for place, case in enumerate(frame.case.unique())}
    return [stated("decisions", shown.sort_values("case", key=lambda case: case.map(order), kind="stable"))]


def integrity(tables: Tables) -> list[Block]:
    """Return what filters that test for faults found, in tables, and their decisions over time."""
    blocks = rates(tables)
    if not blocks:
        return []
    decided = METRICS["decisions"](tables).case
    group, more = few([case for case, label in tables.labels.items() if label in set(decided)])
    return [*blocks, *worth(tables), *_decided(tables), *figures(tables, "decisions", group), *more]
