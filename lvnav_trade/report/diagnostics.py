"""Report sections on linear covariance: error budget, adjoint sensitivity, requirement margins, observability."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.basics.select import final_event, flight_events, mean_at, metric_name
from lvnav_trade.metrics.errors.covariances import gaussian
from lvnav_trade.plots import PLOTS
from lvnav_trade.report.blocks import Block, Grades, Table, Text, number, picture, table
from lvnav_trade.report.escape import data_json
from lvnav_trade.report.evidence import NAVIGATION, chosen_cases, left_out
from lvnav_trade.store import Tables

_LEAST_SHARE = 0.01
"""Part of the variance below which a source is summed with others in a table."""


def budget(tables: Tables) -> list[Block]:
    """Return linear covariance's errors by source: tables at every event, sandpiles, and when each source acted."""
    frame = METRICS["budget"](tables)
    if frame.empty:
        return [Text("The campaign asked for no error budget.")]
    blocks: list[Block] = [
        Text(
            "By linear covariance: one sigma of the true error from each source alone, in brackets its part of the "
            "variance; squares add. What is the same in every flight, such as a delay that nobody corrects, is no "
            "variance: where it counts, the mean error stands below the sources. In the pictures heights are "
            "variances, on an "
            "axis labelled as their root: the top of the pile is one sigma of the true error, the dashed line the "
            "filter's own sigma; what lies above the line is optimism. The map shows when a source made the error "
            "that is left at the event; constant errors are drawn once, at the start."
        ),
        *left_out(tables),
    ]
    for case in chosen_cases(tables):
        label = tables.labels[case]
        for quantity in NAVIGATION:
            rows = frame[(frame.case == label) & (frame.metric == metric_name(quantity))]
            if len(rows):
                blocks.append(_by_event(tables, case, quantity, rows))
        for quantity in ("position", "velocity"):
            blocks += _pictures(tables, case, quantity)
    return blocks


def _pictures(tables: Tables, case: str, quantity: str) -> list[Block]:
    label = tables.labels[case]
    caption = f"{label}: {quantity} error, variance by source; the dashed line is the filter's own sigma."
    found: list[Block] = [picture(f"budget-{case}-{quantity}", PLOTS["budget"](tables, case, quantity), caption)]
    if (tables.adjoint.case == case).any():
        caption = f"{label}: which source made the {quantity} error at the event, and when; at the right the sum."
        found.append(picture(f"when-{case}-{quantity}", PLOTS["heatmap"](tables, case, quantity), caption))
    return found


def _by_event(tables: Tables, case: str, quantity: str, rows: pd.DataFrame) -> Table:
    """Return source x event: sigma and part of the variance, largest at the final event first."""
    events = _events(tables, case)
    share = rows.pivot_table(index="source", columns="event", values="share_ratio", sort=False)[events]
    square = rows.pivot_table(index="source", columns="event", values="sigma", sort=False)[events] ** 2
    order = share.iloc[:, -1].sort_values(ascending=False, kind="stable").index
    kept = [source for source in order if share.loc[source].max() >= _LEAST_SHARE]
    rest = [source for source in order if source not in kept]
    lines = [(source, square.loc[source], share.loc[source]) for source in kept]
    if rest:
        lines.append((f"{len(rest)} others", square.loc[rest].sum(), share.loc[rest].sum()))
    lines.append(("all", square.sum(), share.sum()))
    shown = tuple(
        (name, *(_part(float(np.sqrt(s)), float(p)) for s, p in zip(squares, parts, strict=True)))
        for name, squares, parts in lines
    )
    shown += _with_mean(tables, case, quantity, square.sum())
    head = (f"{quantity} ({rows.unit.iloc[0]})", *(event.replace("_", " ") for event in events))
    caption = f"{tables.labels[case]}: {quantity} error, 3D, by source at every event; a dash is below half a percent."
    return Table(head, shown, (False, *(True for _ in events)), caption)


def _with_mean(tables: Tables, case: str, quantity: str, square: pd.Series[float]) -> tuple[tuple[str, ...], ...]:
    """Return the rows of the mean error at the events and of the root mean square with it, where it counts at any."""
    mean = [mean_at(tables, case, event, quantity) for event in square.index]
    if not any(m**2 >= _LEAST_SHARE * (m**2 + s) for m, s in zip(mean, square, strict=True)):
        return ()
    whole = [float(np.hypot(m, np.sqrt(s))) for m, s in zip(mean, square, strict=True)]
    shown = (number(m) if m >= _LEAST_SHARE * w else "–" for m, w in zip(mean, whole, strict=True))
    return ("mean, the same in every flight", *shown), ("root mean square", *map(number, whole))


def _part(sigma: float, share: float) -> str:
    """Write a sigma with two digits and its part; a dash for what would be 0 %, the sigma alone for all."""
    if share > 1.0 - 1e-9:
        return number(sigma)
    return f"{float(f'{sigma:.2g}'):g} ({100.0 * share:.0f} %)" if share >= 0.005 else "–"


def _events(tables: Tables, case: str) -> list[str]:
    """Return the events at different times up to the final one, which stands for those that coincide with it."""
    events = flight_events(tables, case)
    final = final_event(tables, case)
    events = events[events.t_s <= events.t_s[events.event == final].iloc[0]] if final else events
    events = events.assign(order=events.event == final).sort_values(["t_s", "order"], kind="stable")
    return list(events.drop_duplicates("t_s", keep="last").event)


def grades(tables: Tables) -> list[Block]:
    """Return what a source of another size would do to the errors at the explained event: a control, and tables."""
    tuned = METRICS["sensitivity"](tables)
    data, blocks = [], []
    for case in chosen_cases(tables):
        for quantity in NAVIGATION:
            found = _metric(tables, case, quantity, tuned)
            if found is not None:
                data.append(found)
                blocks.append(_grades_table(found))
    if not data:
        return [Text("The campaign asked for no covariance by source at the event (covariance: {adjoint: true}).")]
    honest = (
        "Re-tuned numbers come from a linear covariance of their own for each factor, with a filter whose model "
        "follows: they are what this filter makes of a better or worse "
        "unit. A filter that neglects some errors can do worse with a better sensor, because it trusts its model more."
        if len(tuned)
        else "Re-tuned numbers were not asked for (covariance: {sensitivity: true})."
    )
    note = (
        "The error at the event if one source had another sigma. Frozen: the filter keeps the gains that it has; "
        "exact, because with fixed gains the variance is a sum over sources. " + honest
    )
    return [Text(note), Grades(data_json(data)), *blocks]


def _metric(tables: Tables, case: str, quantity: str, tuned: pd.DataFrame) -> dict[str, Any] | None:
    """Return the squares of a norm and of its sources, in the units of people, with the re-tuned points of each."""
    rows = tables.adjoint[tables.adjoint.case == case]
    event = str(rows.event.iloc[0]) if len(rows) else final_event(tables, case)
    law = gaussian(tables, case, event, quantity, "3d")
    if law is None or not law.sources:
        return None
    unit, factor = tables.people[quantity, "3d"]
    label = tables.labels[case]
    tuned = tuned[(tuned.case == label) & (tuned.metric == metric_name(quantity))]
    sources: list[dict[str, Any]] = [
        {
            "name": name,
            "square": float(np.trace(part)) * factor**2,
            "retuned": [
                [row.factor_ratio, float(f"{row.retuned:.6g}")] for row in tuned[tuned.source == name].itertuples()
            ],
        }
        for name, part in law.sources.items()
    ]
    sources.sort(key=lambda source: -source["square"])
    total = float(np.trace(law.covariance) + law.mean @ law.mean) * factor**2
    metric = f"{quantity} error, 3D RMS at {event.replace('_', ' ')}"
    return {"case": label, "metric": metric, "unit": unit, "square": total, "sources": sources}


def _grades_table(found: dict[str, Any]) -> Table:
    """Return the numbers behind the control: frozen and re-tuned error per source and factor."""
    factors = (0.1, 0.3, 1.0, 3.0, 10.0)
    rows = []
    for source in found["sources"]:
        share = source["square"] / found["square"]
        if share < _LEAST_SHARE:
            continue
        tuned = dict(map(tuple, source["retuned"]))
        cells = []
        for factor in factors:
            frozen = np.sqrt(found["square"] + (factor**2 - 1.0) * source["square"])
            cells.append(number(float(frozen)) + (f" / {number(tuned[factor])}" if factor in tuned else ""))
        rows.append((source["name"], f"{100 * share:.0f} %", *cells))
    head = ("source", "part of the mean square", *(f"x {factor:g}" for factor in factors))
    what = "gains frozen / filter re-tuned" if any(source["retuned"] for source in found["sources"]) else "gains frozen"
    caption = f"{found['case']}: {found['metric']} ({found['unit']}), {what}; sigma of one source times a factor."
    return Table(head, tuple(rows), (False, *(True for _ in head[1:])), caption)


def observability(tables: Tables) -> list[Block]:
    """Return rank, smallest singular values and weakest direction of each phase of flight."""
    frame = METRICS["observability"](tables)
    if frame.empty:
        return [Text("The campaign asked for no observability.")]
    note = (
        "What the measurements of one phase alone tell of the filter's states, on the nominal flight: singular "
        "values of the stacked rows, in sigmas of their noise, states in initial sigmas. A value of 1 halves the "
        f"variance of that direction. The rank counts values above {frame.tolerance_ratio.iloc[0]:g}; the weakest "
        "direction is that of the smallest value, in initial sigmas of the states."
    )
    blocks: list[Block] = [Text(note), *left_out(tables)]
    for case in chosen_cases(tables):
        label = tables.labels[case]
        rows = frame[frame.case == label]
        shown = pd.DataFrame(
            {
                "phase": rows.phase.str.replace("_", " "),
                "time (s)": [f"{a:.1f} to {b:.1f}" for a, b in zip(rows.t_start_s, rows.t_end_s, strict=True)],
                "rows": rows.row_count,
                "rank / states": [f"{r} / {n}" for r, n in zip(rows.rank_count, rows.state_count, strict=True)],
                "smallest (-)": rows.smallest_ratio,
                "second (-)": rows.second_ratio,
                "third (-)": rows.third_ratio,
                "weakest direction": rows.weakest,
            }
        )
        blocks.append(table(shown, f"{label}: observability by phase of flight."))
    return [*blocks, *error_bound(tables)]


def error_bound(tables: Tables) -> list[Block]:
    """Return whether the noise that each filter models keeps its error bounded, where a campaign asked."""
    frame = tables.error_bound
    if frame.empty:
        return []
    rows = []
    for case, group in frame.groupby("case", sort=False):
        one, noise = group.iloc[0], group[group.matrix == "R"]
        holds = one.rank_count == one.state_count and (noise.low_si > 0.0).all()
        rows.append(
            (tables.labels[case], f"{one.rank_count} / {one.state_count}", one.low_si, one.high_si, one.weakest,
             "; ".join(f"{number(r.low_si)} to {number(r.high_si)} {r.unit}" for r in noise.itertuples()),
             "yes" if holds else "no")
        )  # fmt: skip
    head = [
        "case",
        "rank of Q / states",
        "lowest of Q (-)",
        "highest (-)",
        "weakest direction",
        "noise of rows",
        "holds",
    ]
    note = (
        "Error bound: the error of such a filter stays bounded in mean square if, among other conditions, the noise "
        "that it models does: q I <= Q <= q' I of what enters between two updates, r I <= R <= r' I of the rows "
        "(Canepa and Servidia, eq. 7.17, 7.18). Q is compared with the squares of the initial sigmas."
    )
    caption = "Bounds of the noise that the filter models, over the nominal flight."
    return [Text(note), table(pd.DataFrame(rows, columns=head), caption)]


def nonlinearity(tables: Tables) -> list[Block]:
    """Return the nonlinearity index of each case at its worst event."""
    frame = METRICS["nonlinearity"](tables)
    rows = []
    for case, group in frame.groupby("case", sort=False):
        worst = group.loc[group.motion_ratio.idxmax()]
        rows.append(
            (case, worst.motion_ratio, worst.state, worst.event.replace("_", " "), group.transition_ratio.max(),
             group.row_ratio.max())
        )  # fmt: skip
    if not rows:
        return []
    head = ["case", "motion (sigma)", "in state", "at", "transition (sigma)", "measurements (sigma)"]
    caption = "Nonlinearity at one-sigma true errors, the worst event of each case."
    note = (
        "Nonlinearity: the error after one update interval, flown by the strapdown itself from plus and minus "
        "one-sigma true errors. Motion is its second-order part and transition the difference of its first-order "
        "part to the filter's transition, both in the filter's own sigma; measurements is the second-order part of a "
        "predicted measurement in sigmas of its innovation. Where all are far below 1, a disagreement of the two "
        "engines is not the linearisation's doing."
    )
    return [Text(note), table(pd.DataFrame(rows, columns=head), caption)]
