"""Limits of a verdict: a filter covariance that does not match the errors, an error that grows after the event."""

from collections.abc import Sequence
from typing import Any

import pandas as pd

from lvnav_trade.report.advice import missing_states
from lvnav_trade.report.blocks import Block, Text, join_texts, percent, words
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
        cells[row.case] = filter_verdict(row.verdict, row.sigma_ratio)
        if row.moment != "run" and row.verdict in _SIGNS:
            cells[row.case] += f" at {words(row.moment)}"
    return cells


def filter_verdict(verdict: str, sigma_ratio: float) -> str:
    """Return the verdict on a filter with its sign, and the factor by which its sigma is too small or too large."""
    if verdict not in _SIGNS:
        return "–"
    text = f"{_SIGNS[verdict]} {verdict}"
    if verdict == OVERCONFIDENT:
        return f"{text} x{sigma_ratio:.2g}"
    if verdict == CONSERVATIVE:
        factor = 1.0 / sigma_ratio if sigma_ratio else float("inf")
        return f"{text} x{factor:.2g}"
    return text


def sigma_warnings(tables: Tables) -> list[Block]:
    """Return a warning on filters whose sigma is too small, and a note on those whose sigma is too large."""
    frame = METRICS["filter_verdicts"](tables)
    overconfident_rows = frame[frame.verdict == OVERCONFIDENT]
    conservative_rows = frame[frame.verdict == CONSERVATIVE]
    blocks: list[Block] = []
    if len(overconfident_rows):
        text = say(
            "overconfident",
            designs=len(overconfident_rows),
            whole=len(frame),
            ratio=_span(overconfident_rows.sigma_ratio),
            cure=_remedy(tables, overconfident_rows),
        )
        blocks.append(Text(text, "Warning:"))
    if len(conservative_rows):
        ratios = 1.0 / conservative_rows.sigma_ratio.where(conservative_rows.sigma_ratio > 0.0)
        text = say("conservative", designs=len(conservative_rows), whole=len(frame), ratio=_span(ratios))
        blocks.append(Text(text, "Note:"))
    return blocks


def _span(ratios: pd.Series) -> str:
    """Return the smallest and the largest ratio with two digits; one number if they are equal."""
    low = f"{ratios.min():.2g}"
    high = f"{ratios.max():.2g}"
    return low if low == high else f"{low} to {high}"


def _remedy(tables: Tables, rows: pd.DataFrame) -> str:
    """Return the largest error source that these filters do not model, and the cards that model it."""
    digests = {label: case for case, label in tables.labels.items()}
    error, missing = missing_states(tables, [digests[case] for case in rows.case])
    if not missing:
        return ""
    shares = [state.share for state in missing]
    low = f"{100.0 * min(shares):.0f}"
    high = f"{100.0 * max(shares):.0f}"
    return say(
        "lacking",
        filters=len(rows),
        without=len(missing),
        source=missing[0].source,
        error=error,
        share=high if low == high else f"{low} to {high}",
        cards=list(dict.fromkeys(state.card for state in missing if state.card)),
    )


def window_warning(tables: Tables) -> list[Block]:
    """Return a warning on designs that meet a requirement at its event but exceed its limit within the window around
    it.

    A note follows if a window could not be evaluated.
    """
    margins = METRICS["margins"](tables)
    blocks: list[Block] = []
    windows = METRICS["windows"](tables)
    for name, rows in windows.groupby("requirement", sort=False):
        is_met = (margins.requirement == name) & (margins.verdict == "met")
        compliant = set(margins[is_met].case)
        rows = rows.assign(is_compliant=rows.case.isin(compliant))
        violating_rows = rows[rows.verdict_changes & rows.is_compliant]
        if len(violating_rows):
            sentence = _window_sentence(rows, violating_rows, len(compliant))
            blocks.append(Text(sentence, "Warning:"))
    return blocks + _not_evaluated(tables)


def _window_sentence(rows: pd.DataFrame, violating_rows: pd.DataFrame, n_compliant: int) -> str:
    """Return a sentence on designs that exceed a limit around its event.

    rows : windows of all cases around the event of one requirement
    violating_rows : rows of designs that comply at the event and exceed the limit around it
    n_compliant : number of designs that comply at the event
    """
    cases = []
    for row in violating_rows.itertuples():
        error_text = with_unit(row.worst, row.unit)
        cases.append(f"{row.case}: {error_text} {worst_time_text(row)}")
    texts, source = with_evidence(cases, violating_rows.by)
    window = rows.iloc[0]
    return say(
        "holds",
        name=str(window.requirement).capitalize(),
        event=words(window.event),
        limit=with_unit(window.limit, window.unit),
        before=f"{window.t_s - window.first_s:.3g}",
        after=f"{window.last_s - window.t_s:.3g}",
        met=n_compliant,
        bad=len(violating_rows),
        stay=int((rows.is_compliant & (rows.worst < rows.limit)).sum()),
        quantile=f"{percent(violating_rows.probability.iloc[0])} quantile{source}",
        cases=join_texts(texts, 2 * _FEW),
    )


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


def with_evidence(texts: Sequence[str], evidence: pd.Series) -> tuple[list[str], str]:
    """Return texts on windows with their evidence.

    Parameters
    ----------
    texts : sequence of str
        The texts.
    evidence : pandas.Series
        Evidence of each text, as in `windows`.

    Returns
    -------
    texts : list of str
        The texts, each with its evidence unless all have the same.
    evidence : str
        The common evidence; empty if the evidence differs.
    """
    if evidence.nunique() == 1:
        return list(texts), f" {RESTS_ON[evidence.iloc[0]]}"
    return [f"{text}, {RESTS_ON[source]}" for text, source in zip(texts, evidence, strict=True)], ""


def _not_evaluated(tables: Tables) -> list[Block]:
    """Return the requirements for which the duration of the verdict is unknown, with the reason."""
    # Requirements of the same event, reason and cases share a text
    names_of: dict[tuple[str, str, tuple[str, ...]], list[str]] = {}
    keys = ["requirement", "event", "reason"]
    unevaluated_rows = METRICS["unevaluated"](tables)
    for (name, event, reason), rows in unevaluated_rows.groupby(keys, sort=False):
        key = (event, reason, tuple(rows.case))
        names_of.setdefault(key, []).append(name)
    texts = []
    for (event, reason, cases), names in names_of.items():
        text = join_texts(names, 2 * _FEW, ", ")
        if len(cases) != len(tables.labels):
            text += f" of {join_texts(cases, _FEW)}"
        texts.append(f"{text}, around {words(event)}: {reason}")
    if not texts:
        return []
    return [Text(f"The duration of the verdict is unknown for {join_texts(texts, 2 * _FEW)}.", "Note:")]


def worst_time_text(row: Any, event: str = "the event") -> str:
    """Return the time of the worst error in a window, relative to its event."""
    return say("when", offset=row.worst_s - row.t_s, event=event)


def window_cells(tables: Tables) -> dict[str, dict[str, str]]:
    """Return the worst error in the window of each requirement, by heading and by label of the case.

    The result is empty for more requirements with a window than `_MOST_WINDOWS`. Errors by linear covariance are marked
    if some verdicts rest on runs; extrapolated errors are always marked (`MARKS`).
    """
    frame = METRICS["windows"](tables)
    is_by_covariance = bool((METRICS["margins"](tables).by == COVARIANCE).all())
    names = list(dict.fromkeys(frame.requirement))
    if len(names) > _MOST_WINDOWS:
        return {}
    cells: dict[str, dict[str, str]] = {}
    for name in names:
        rows = frame[frame.requirement == name]
        window = rows.iloc[0]
        start = window.first_s - window.t_s
        end = window.last_s - window.t_s
        prefix = f"{name}, " if len(names) > 1 else ""
        heading = f"{prefix}worst from {start:+.3g} to {end:+.3g} s ({window.unit})"
        cells[heading] = {}
        for row in rows.itertuples():
            sign = mark(row.by, is_by_covariance)
            cells[heading][row.case] = _worst_cell(row) + sign
    return cells


def _worst_cell(row: Any) -> str:
    sign = "✗" if row.worst >= row.limit else "✓"
    return f"{sign} {row.worst:.3g} at {row.worst_s - row.t_s:+.1f} s"


def mark(evidence: str, is_by_covariance: bool) -> str:
    """Return the mark of a number without runs as evidence; no mark by linear covariance if all verdicts rest on it."""
    if evidence not in MARKS or (is_by_covariance and evidence == COVARIANCE):
        return ""
    return f" {MARKS[evidence]}"
