"""Limits of a verdict: a filter covariance that does not match the errors, an error that grows after the event."""

from collections.abc import Sequence
from typing import Any

import pandas as pd

from lvnav_trade.report.advice import unmodelled
from lvnav_trade.report.blocks import Block, Text, listed, percent, words
from lvnav_trade.report.sentences import say
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.filter_consistency import CONSERVATIVE, CONSISTENT, OVERCONFIDENT
from lvnav_trade.results.requirements.requirements import with_unit
from lvnav_trade.results.requirements.windows import COVARIANCE, EXTRAPOLATED, RUNS
from lvnav_trade.results.tables.read import Tables

_FEW = 4  # up to this number of cases, each is named
_MOST_WINDOWS = 2  # columns of windows in the matrix; more get a separate table
RESTS_ON = {RUNS: "by the runs", COVARIANCE: "by linear covariance", EXTRAPOLATED: "extrapolated from few runs"}
MARKS = {COVARIANCE: "†", EXTRAPOLATED: "‡"}
_SIGNS = {CONSISTENT: "✓", OVERCONFIDENT: "✗", CONSERVATIVE: "!"}


def filter_cells(tables: Tables) -> dict[str, str]:
    """Return the consistency of the filter by label: over the run, or else at an event ("✗ overconfident x20 at
    injection").
    """
    cells = {}
    for row in METRICS["filter_verdicts"](tables).itertuples():
        moment = f" at {words(row.moment)}" if row.moment != "run" and row.verdict in _SIGNS else ""
        cells[row.case] = filter_verdict(row.verdict, row.sigma_ratio) + moment
    return cells


def filter_verdict(verdict: str, sigma_ratio: float) -> str:
    """Return the verdict on a filter with its sign, and the factor by which its sigma is too small or too large."""
    if verdict not in _SIGNS:
        return "–"
    factor = {OVERCONFIDENT: sigma_ratio, CONSERVATIVE: 1.0 / sigma_ratio if sigma_ratio else float("inf")}.get(verdict)
    return f"{_SIGNS[verdict]} {verdict}" + ("" if factor is None else f" x{factor:.2g}")


def overconfidence(tables: Tables) -> list[Block]:
    """Return a warning on filters whose sigma is too small, and a note on those whose sigma is too large."""
    frame = METRICS["filter_verdicts"](tables)
    blocks: list[Block] = []
    small, large = (frame[frame.verdict == verdict] for verdict in (OVERCONFIDENT, CONSERVATIVE))
    if len(small):
        facts = {"designs": len(small), "whole": len(frame), "ratio": _span(small.sigma_ratio)}
        blocks.append(Text(say("overconfident", cure=_cure(tables, small), **facts), "Warning:"))
    if len(large):
        ratios = 1.0 / large.sigma_ratio.where(large.sigma_ratio > 0.0)
        text = say("conservative", designs=len(large), whole=len(frame), ratio=_span(ratios))
        blocks.append(Text(text, "Note:"))
    return blocks


def _span(ratios: pd.Series) -> str:
    """Return the smallest and the largest ratio with two digits; one number if they are equal."""
    low, high = f"{ratios.min():.2g}", f"{ratios.max():.2g}"
    return low if low == high else f"{low} to {high}"


def _cure(tables: Tables, rows: pd.DataFrame) -> str:
    """Return the largest error source that these filters do not model, and the cards that model it."""
    digests = {label: case for case, label in tables.labels.items()}
    error, missing = unmodelled(tables, [digests[case] for case in rows.case])
    if not missing:
        return ""
    low, high = (
        f"{100.0 * value:.0f}"
        for value in (min(source.share for source in missing), max(source.share for source in missing))
    )
    return say(
        "lacking",
        filters=len(rows),
        without=len(missing),
        source=missing[0].source,
        error=error,
        share=high if low == high else f"{low} to {high}",
        cards=list(dict.fromkeys(source.card for source in missing if source.card)),
    )


def short_lived(tables: Tables) -> list[Block]:
    """Return a warning on designs that meet a requirement at its event but exceed its limit within the window around
    it.

    A note follows if a window could not be evaluated.
    """
    frame, margins = METRICS["windows"](tables), METRICS["margins"](tables)
    blocks: list[Block] = []
    for name, rows in frame.groupby("requirement", sort=False):
        compliant = set(margins[(margins.requirement == name) & (margins.verdict == "met")].case)
        bad = rows[rows.verdict_changes & rows.case.isin(compliant)]
        if bad.empty:
            continue
        each = [f"{row.case}: {with_unit(row.worst, row.unit)} {when(row)}" for row in bad.itertuples()]
        texts, by = with_evidence(each, bad.by)
        quantile = f"{percent(bad.probability.iloc[0])} quantile{by}"
        worst = rows.iloc[0]
        text = say(
            "holds",
            name=str(worst.requirement).capitalize(),
            event=words(worst.event),
            limit=with_unit(worst.limit, worst.unit),
            before=f"{worst.t_s - worst.first_s:.3g}",
            after=f"{worst.last_s - worst.t_s:.3g}",
            met=len(compliant),
            bad=len(bad),
            stay=int((rows.case.isin(compliant) & (rows.worst < rows.limit)).sum()),
            quantile=quantile,
            cases=listed(texts, 2 * _FEW),
        )
        blocks.append(Text(text, "Warning:"))
    return blocks + _not_evaluated(tables)


def empty_stages(tables: Tables) -> list[Block]:
    """Return a note on runs whose last stage is empty before its cut-off."""
    ends = METRICS["cutoff"](tables)
    empty = ends[ends.depleted_count > 0]
    if empty.empty:
        return []
    worst = empty.loc[empty.depleted_count.idxmax()]
    text = say(
        "empty_stages",
        cases=len(empty),
        of=len(ends),
        most=int(worst.depleted_count),
        runs=int(worst.runs),
        case=worst.case,
        least=int(empty.depleted_count.min()),
    )
    return [Text(text, "Empty stages.")]


def with_evidence(texts: Sequence[str], by: pd.Series) -> tuple[list[str], str]:
    """Return texts on windows with the evidence of each; if all have the same evidence, the texts and the evidence
    apart.

    by : evidence of each text, as in `windows`
    """
    if by.nunique() == 1:
        return list(texts), f" {RESTS_ON[by.iloc[0]]}"
    return [f"{text}, {RESTS_ON[source]}" for text, source in zip(texts, by, strict=True)], ""


def _not_evaluated(tables: Tables) -> list[Block]:
    """Return the requirements for which the duration of the verdict is unknown, with the reason."""
    frame = METRICS["unevaluated"](tables)
    alike: dict[tuple[str, str, tuple[str, ...]], list[str]] = {}
    for (name, event, reason), rows in frame.groupby(["requirement", "event", "reason"], sort=False):
        alike.setdefault((event, reason, tuple(rows.case)), []).append(name)
    parts = []
    for (event, reason, cases), names in alike.items():
        scope = "" if len(cases) == len(tables.labels) else f" of {listed(cases, _FEW)}"
        parts.append(f"{listed(names, 2 * _FEW, ', ')}{scope}, around {words(event)}: {reason}")
    if not parts:
        return []
    return [Text(f"The duration of the verdict is unknown for {listed(parts, 2 * _FEW)}.", "Note:")]


def when(row: Any, event: str = "the event") -> str:
    """Return the time of the worst error in a window, relative to its event."""
    return say("when", offset=row.worst_s - row.t_s, event=event)


def window_cells(tables: Tables) -> dict[str, dict[str, str]]:
    """Return the worst error in the window of each requirement, by heading and by label of the case.

    The result is empty for more requirements with a window than `_MOST_WINDOWS`. Errors by linear covariance are marked
    if some verdicts rest on runs; extrapolated errors are always marked (`MARKS`).
    """
    frame = METRICS["windows"](tables)
    alone = bool((METRICS["margins"](tables).by == COVARIANCE).all())
    names = list(dict.fromkeys(frame.requirement))
    cells = {}
    for name in names if len(names) <= _MOST_WINDOWS else ():
        rows = frame[frame.requirement == name]
        worst = rows.iloc[0]
        prefix = f"{name}, " if len(names) > 1 else ""
        head = (
            f"{prefix}worst from {worst.first_s - worst.t_s:+.3g} to {worst.last_s - worst.t_s:+.3g} s ({worst.unit})"
        )
        cells[head] = {row.case: f"{_worst_cell(row)}{mark(row.by, alone)}" for row in rows.itertuples()}
    return cells


def _worst_cell(row: Any) -> str:
    sign = "✗" if row.worst >= row.limit else "✓"
    return f"{sign} {row.worst:.3g} at {row.worst_s - row.t_s:+.1f} s"


def mark(by: str, alone: bool) -> str:
    """Return the mark of a number without runs as evidence; no mark by linear covariance if all verdicts rest on it."""
    return "" if by not in MARKS or (alone and by == COVARIANCE) else f" {MARKS[by]}"
