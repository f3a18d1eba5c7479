"""The first screen: the question, the answer in plain words, the ranking."""

from __future__ import annotations

from typing import Any

import pandas as pd

from lvnav_trade import plots
from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.agreement import by_case
from lvnav_trade.metrics.select import split_metric
from lvnav_trade.report.blocks import Block, Text, number, percent, picture, table
from lvnav_trade.store import Tables


def summary(tables: Tables) -> list[Block]:
    """Return the answer: what each requirement says of the cases, how sure it is, and the ranking."""
    judged = METRICS["requirements"](tables)
    blocks: list[Block] = [Text(_scale(tables))]
    for requirement in tables.campaign.get("requirements") or ():
        blocks += _answer(tables, requirement, judged[judged.requirement == requirement["name"]])
    if not len(judged):
        blocks.append(Text("The campaign states no requirement; the cases are ranked below."))
    blocks.append(ranking_table(tables))
    blocks.append(picture("ranking", plots.PLOTS["rank"](tables), "The cases by their error at injection."))
    verdict = _agreement(tables)
    return [*blocks, Text(verdict)] if verdict else blocks


def _scale(tables: Tables) -> str:
    cases = tables.cases
    runs, failed = int(cases.run_count.sum()), int(cases.failed_count.sum())
    each = sorted(set(cases.run_count))
    flown = (
        f"{each[0]} Monte-Carlo runs{' each' * (len(cases) > 1)}"
        if len(each) == 1
        else f"{each[0]} to {each[-1]} Monte-Carlo runs each"
    )
    text = f"{len(cases)} case{'s' * (len(cases) > 1)}, linear covariance" + (f" and {flown}." if runs else " only.")
    return text + (f" {failed} of {runs} runs failed and count against every requirement." if failed else "")


def _answer(tables: Tables, requirement: dict[str, Any], rows: pd.DataFrame) -> list[Block]:
    """Say in words which cases meet a requirement."""
    asked = (
        f"{str(requirement['metric']).replace('_', ' ')} below {rows.limit.iloc[0]} at "
        f"{str(requirement.get('at', 'injection')).replace('_', ' ')} in {percent(requirement['probability'])} of "
        f"flights, to be shown with {percent(requirement.get('confidence', 0.9))} confidence."
    )
    blocks: list[Block] = [Text(asked[0].upper() + asked[1:], f"{str(requirement['name']).capitalize()}.")]
    for verdict, word in (("met", "Met by"), ("violated", "Violated by"), ("undecided", "Undecided for")):
        chosen = rows[rows.verdict == verdict]
        if len(chosen):
            every = f"all {len(rows)} cases: " if len(chosen) == len(rows) > 1 else ""
            names = _undecided(chosen) if verdict == "undecided" else [_case(row) for row in chosen.itertuples()]
            blocks.append(Text(f"{every}{'; '.join(names)}.", f"{word}:"))
    return blocks + [Text(text) for text in _largest_sources(tables, requirement, rows[rows.verdict == "violated"])]


def _case(row: Any) -> str:
    return f"{row.case} ({row.estimate}; {row.failures} of {row.runs} runs beyond)"


def _undecided(rows: pd.DataFrame) -> list[str]:
    """Name the cases that the same number of further runs would decide together."""
    return [
        f"{' and '.join(group.case)} ({more} further good runs {'each ' * (len(group) > 1)}would decide)"
        for more, group in rows.groupby("runs_to_decide", sort=True)
    ]


def _largest_sources(tables: Tables, requirement: dict[str, Any], violated: pd.DataFrame) -> list[str]:
    """Say which source makes most of the error, by linear covariance, where a requirement is violated."""
    budget = METRICS["budget"](tables)
    metric = split_metric(requirement["metric"])[0] + "_error"
    at = requirement.get("at", "injection")
    found = []
    for case in violated.case:
        rows = budget[(budget.case == case) & (budget.event == at) & (budget.metric == metric)]
        if len(rows):
            top = rows.iloc[0]
            found.append(f"{case}: {top.source} ({100 * top.share_ratio:.0f} % of the variance)")
    return [f"Largest source in the 3D error, by linear covariance: {'; '.join(found)}."] if found else []


def ranking_table(tables: Tables) -> Block:
    """Return the cases in order, with RMS and interval."""
    frame = METRICS["ranking"](tables)
    shown = pd.DataFrame({"case": frame.case, "runs": frame.run_count})
    for quantity in ("velocity", "position", "attitude"):
        if quantity in frame:
            unit = frame[f"{quantity}_unit"].iloc[0]
            shown[f"{quantity} ({unit})"] = frame[quantity]
            low, high = frame[f"{quantity}_low"].map(number), frame[f"{quantity}_high"].map(number)
            shown["95 % interval" + " " * len(shown.columns)] = low + " to " + high
    found = table(shown, f"Ranking: 3D RMS error at {frame.event.iloc[0].replace('_', ' ')}, best velocity first.")
    return found._replace(head=tuple(name.rstrip() for name in found.head))


def _agreement(tables: Tables) -> str:
    found = by_case(METRICS["agreement"](tables))
    tested = found[found.verdict != "no runs"]
    if not len(tested):
        return ""
    bad = tested[tested.verdict == "disagree"]
    if bad.empty:
        where = "in the one case" if len(tested) == 1 else f"in all {len(tested)} cases"
        return f"Monte Carlo and linear covariance agree {where} (1 % family-wise level per case)."
    return (
        f"Monte Carlo and linear covariance disagree in {len(bad)} of {len(tested)} cases: "
        + "; ".join(
            f"{row.case} (worst: {row.state} at {row.event}, ratio {number(row.ratio)}, "
            f"bounds {number(row.low)} to {number(row.high)})"
            for row in bad.itertuples()
        )
        + ". There the Monte-Carlo numbers count."
    )
