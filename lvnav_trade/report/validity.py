"""Limits of a verdict: a filter whose covariance does not match its errors, an error that grows after the event."""

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

_FEW = 4  # cases that are all named
_MOST_WINDOWS = 2  # columns of windows in the matrix; those of more requirements are in a table of their own
RESTS_ON = {RUNS: "by the runs", COVARIANCE: "by linear covariance", EXTRAPOLATED: "extrapolated from few runs"}
MARKS = {COVARIANCE: "†", EXTRAPOLATED: "‡"}
_SIGNS = {CONSISTENT: "✓", OVERCONFIDENT: "✗", CONSERVATIVE: "!"}


def filter_cells(tables: Tables) -> dict[str, str]:
    """Return by label of a case whether its filter is consistent, over the run or else at which event: "✗ overconfident
    x20 at injection".
    """
    found = {}
    for row in METRICS["filter_verdicts"](tables).itertuples():
        moment = f" at {words(row.moment)}" if row.moment != "run" and row.verdict in _SIGNS else ""
        found[row.case] = filter_verdict(row.verdict, row.sigma_ratio) + moment
    return found


def filter_verdict(verdict: str, sigma_ratio: float) -> str:
    """Return the verdict on a filter with its sign, and by what factor its sigma is too small or too large."""
    if verdict not in _SIGNS:
        return "–"
    factor = {OVERCONFIDENT: sigma_ratio, CONSERVATIVE: 1.0 / sigma_ratio if sigma_ratio else float("inf")}.get(verdict)
    return f"{_SIGNS[verdict]} {verdict}" + ("" if factor is None else f" x{factor:.2g}")


def overconfidence(tables: Tables) -> list[Block]:
    """Warn of filters whose sigma is too small, and note those whose sigma is too large."""
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
    """Write the smallest and the largest ratio with two digits, once where they are the same."""
    low, high = f"{ratios.min():.2g}", f"{ratios.max():.2g}"
    return low if low == high else f"{low} to {high}"


def _cure(tables: Tables, rows: pd.DataFrame) -> str:
    """Say which error source, the largest one, these filters do not model, and which cards do."""
    digests = {label: case for case, label in tables.labels.items()}
    error, found = unmodelled(tables, [digests[case] for case in rows.case])
    if not found:
        return ""
    low, high = (f"{100.0 * value:.0f}" for value in (min(one.share for one in found), max(one.share for one in found)))
    return say(
        "lacking",
        filters=len(rows),
        without=len(found),
        source=found[0].source,
        error=error,
        share=high if low == high else f"{low} to {high}",
        cards=list(dict.fromkeys(one.card for one in found if one.card)),
    )


def short_lived(tables: Tables) -> list[Block]:
    """Warn where designs meet a requirement at its event and exceed its limit within the window around the event, and
    note where no window could be evaluated.
    """
    frame, margins = METRICS["windows"](tables), METRICS["margins"](tables)
    blocks: list[Block] = []
    for name, rows in frame.groupby("requirement", sort=False):
        met = set(margins[(margins.requirement == name) & (margins.verdict == "met")].case)
        bad = rows[rows.changes & rows.case.isin(met)]
        if bad.empty:
            continue
        each = [f"{row.case}: {with_unit(row.worst, row.unit)} {when(row)}" for row in bad.itertuples()]
        named, by = with_evidence(each, bad.by)
        quantile = f"{percent(bad.probability.iloc[0])} quantile{by}"
        one = rows.iloc[0]
        text = say(
            "holds",
            name=str(one.requirement).capitalize(),
            event=words(one.event),
            limit=with_unit(one.limit, one.unit),
            before=f"{one.t_s - one.first_s:.3g}",
            after=f"{one.last_s - one.t_s:.3g}",
            met=len(met),
            bad=len(bad),
            stay=int((rows.case.isin(met) & (rows.worst < rows.limit)).sum()),
            quantile=quantile,
            cases=listed(named, 2 * _FEW),
        )
        blocks.append(Text(text, "Warning:"))
    return blocks + _not_evaluated(tables)


def with_evidence(texts: Sequence[str], by: pd.Series) -> tuple[list[str], str]:
    """Return texts on windows with what each rests on; where all rest on the same, the texts as they are, and this.

    by: of each text, as in `windows`.
    """
    if by.nunique() == 1:
        return list(texts), f" {RESTS_ON[by.iloc[0]]}"
    return [f"{text}, {RESTS_ON[one]}" for text, one in zip(texts, by, strict=True)], ""


def _not_evaluated(tables: Tables) -> list[Block]:
    """Say of which requirements it is not known how long their verdict holds, and why."""
    frame = METRICS["unevaluated"](tables)
    alike: dict[tuple[str, str, tuple[str, ...]], list[str]] = {}
    for (name, event, reason), rows in frame.groupby(["requirement", "event", "reason"], sort=False):
        alike.setdefault((event, reason, tuple(rows.case)), []).append(name)
    parts = []
    for (event, reason, cases), names in alike.items():
        which = "" if len(cases) == len(tables.labels) else f" of {listed(cases, _FEW)}"
        parts.append(f"{listed(names, 2 * _FEW, ', ')}{which}, around {words(event)}: {reason}")
    if not parts:
        return []
    return [Text(f"How long the verdict holds is not known for {listed(parts, 2 * _FEW)}.", "Note:")]


def when(row: Any, event: str = "it") -> str:
    """Return when the worst error of a window occurs, relative to its event."""
    return say("when", offset=row.worst_s - row.t_s, event=event)


def window_cells(tables: Tables) -> dict[str, dict[str, str]]:
    """Return by heading the worst error in the window of a requirement, by label of the case; nothing for campaigns
    with more such requirements than `_MOST_WINDOWS`.

    Errors by linear covariance are marked where some verdict rests on runs, extrapolated ones always (`MARKS`).
    """
    frame = METRICS["windows"](tables)
    alone = bool((METRICS["margins"](tables).by == COVARIANCE).all())
    names = list(dict.fromkeys(frame.requirement))
    found = {}
    for name in names if len(names) <= _MOST_WINDOWS else ():
        rows = frame[frame.requirement == name]
        one = rows.iloc[0]
        which = f"{name}, " if len(names) > 1 else ""
        head = f"{which}worst from {one.first_s - one.t_s:+.3g} to {one.last_s - one.t_s:+.3g} s ({one.unit})"
        found[head] = {row.case: f"{_worst_cell(row)}{mark(row.by, alone)}" for row in rows.itertuples()}
    return found


def _worst_cell(row: Any) -> str:
    sign = "✗" if row.worst >= row.limit else "✓"
    return f"{sign} {row.worst:.3g} at {row.worst_s - row.t_s:+.1f} s"


def mark(by: str, alone: bool) -> str:
    """Return the mark of a number that does not rest on runs: none by linear covariance where all verdicts do."""
    return "" if by not in MARKS or (alone and by == COVARIANCE) else f" {MARKS[by]}"
