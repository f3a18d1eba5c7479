"""The answer to each requirement: which designs meet it, what it rests on, what would make others comply."""

import math
from typing import Any

import pandas as pd

from lvnav_trade.quantities.state_layout import split_metric
from lvnav_trade.report.advice import advice
from lvnav_trade.report.blocks import Block, More, Text, figure, listed, stated, words
from lvnav_trade.report.sentences import say
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.covariances import why_not_applicable
from lvnav_trade.results.metric import where
from lvnav_trade.results.requirements.improvements import asked
from lvnav_trade.results.requirements.margins import worst_runs
from lvnav_trade.results.requirements.requirements import in_words, with_unit
from lvnav_trade.results.statistics.select import mean_at
from lvnav_trade.results.tables.read import Tables

_FEW = 4  # cases that are all named beside their verdict
_WORDS = {  # of verdicts, from the best to the worst
    "met": "Met by",
    "undecided": "Undecided for",
    "not applicable": "No verdict for",
    "not confirmed": "Not confirmed for",
    "violated": "Violated by",
}


def answers(tables: Tables) -> list[Block]:
    """Return what each requirement says of the cases, how sure it is, what would make it met, and the worst runs."""
    verdicts = in_words(METRICS["requirements"](tables))
    blocks: list[Block] = []
    for requirement in tables.campaign.get("requirements") or ():
        blocks += _answer(tables, requirement, verdicts[verdicts.requirement == requirement["name"]])
    return blocks + _worst_runs(tables)


def _worst_runs(tables: Tables) -> list[Block]:
    """Return the run with the largest error of each requirement in the cases that decide, how to fly it again, and
    pictures of them.
    """
    found = worst_runs(tables)
    if found.empty:
        return []
    shown = found.assign(
        case=found.case.map(tables.labels),
        error=[with_unit(row.error, row.unit) for row in found.itertuples()],
        command=[f"lvnav-trade replay . {row.case} {row.run_number}" for row in found.itertuples()],
    )
    names = ["case", "run_number"]
    kept = found[names].merge(tables.traces[names].drop_duplicates()).drop_duplicates()
    drawn = [figure(tables, "worst_run", row.case, str(row.run_number)) for row in kept.itertuples()]
    pictures = [More("Pictures of the worst runs", drawn)] if drawn else []
    return [stated("worst_runs", shown), *pictures]


def _answer(tables: Tables, requirement: dict[str, Any], rows: pd.DataFrame) -> list[Block]:
    name = str(requirement["name"])
    wanted = say(
        "wanted",
        metric=_metric(requirement),
        limit=_limit(requirement, rows.limit.iloc[0]),
        place=_place(requirement),
        probability=requirement["probability"],
        confidence=requirement.get("confidence", 0.9),
    )
    blocks: list[Block] = [Text(wanted[0].upper() + wanted[1:], f"{name.capitalize()}.")]
    for verdict in ("met", "violated", "not confirmed", "undecided", "not applicable"):
        chosen = rows[rows.verdict == verdict]
        if len(chosen):
            part = f"{len(chosen)} of {len(rows)} cases: " if len(chosen) > _FEW else ""
            part = f"all {len(rows)} cases: " if len(chosen) == len(rows) > 1 else part
            blocks.append(Text(f"{part}{_listed(_cases(verdict, chosen))}.", f"{_WORDS[verdict]}:"))
    blocks += [Text(text, "Linear covariance alone:") for text in _by_covariance(tables, name, rows)]
    better = METRICS["improvements"](tables)
    better = better[better.requirement == name]
    if len(better):
        return [*blocks, Text(_listed([advice(tables, row) for row in better.itertuples()], " "), "To comply:")]
    return blocks + [Text(text) for text in _largest_sources(tables, requirement, rows[rows.verdict == "violated"])]


def _listed(texts: list[str], separator: str = "; ") -> str:
    """Join texts; of many the first ones, and how many more there are."""
    return listed(texts, 2 * _FEW, separator)


def _cases(verdict: str, rows: pd.DataFrame) -> list[str]:
    """Name the cases of a verdict, with what it rests on."""
    if verdict == "undecided":
        return _undecided(rows)
    if verdict in ("not confirmed", "not applicable"):
        return list(rows.case)
    return [f"{row.case} ({row.estimate}; {_rests_on(row)})" for row in rows.itertuples()]


def _rests_on(row: Any) -> str:
    """Say what a verdict rests on: runs, or linear covariance and how many runs do not contradict it."""
    return say("rests_on", failures=row.failures, runs=row.runs, by_runs=row.by == "runs")


def _metric(requirement: dict[str, Any]) -> str:
    name = words(requirement["metric"])
    return f"3D {name.removesuffix(' 3d')}" if name.endswith(" 3d") else name


def _limit(requirement: dict[str, Any], shown: str) -> str:
    """Write a limit; an angle in milliradians in degrees too."""
    size, _, unit = str(requirement["below"]).partition(" ")
    return f"{shown} ({math.degrees(float(size)):.3g} deg)" if unit == "rad" and "mrad" in shown else shown


def _place(requirement: dict[str, Any]) -> str:
    at = words(where(requirement))
    if not requirement.get("during"):
        return f"at {at}"
    return "at all times of the flight" if at == "flight" else f"at all times from {at}"


def _by_covariance(tables: Tables, name: str, verdicts: pd.DataFrame) -> list[str]:
    """Say what linear covariance by itself would conclude, in one sentence where it concludes the same."""
    frame = METRICS["expected"](tables)
    frame = frame[frame.requirement == name]
    runs = verdicts.set_index("case").verdict
    shown = frame[(frame.verdict != frame.case.map(runs)) | (len(frame) <= _FEW)]
    applies = ~shown.verdict.isin(["not applicable", "not confirmed"])
    found = [
        f"{row.case}: {row.verdict}, {_chance(row.expected_probability)} of flights expected to keep it"
        for row in shown[applies].itertuples()
    ]
    for (verdict, reason), rows in shown[~applies].groupby(["verdict", "reason"], sort=False):
        found.append(f"{rows.case.iloc[0] if len(rows) == 1 else f'{len(rows)} cases'}: {verdict}, {reason}")
    if not len(frame):
        return []
    same = int((frame.verdict == frame.case.map(runs)).sum())
    return [say("covariance_alone", same=same, whole=len(frame), others=found)]


def _chance(probability: float) -> str:
    """Write a probability in percent; what would round to 100 is shown as more than 99.9."""
    return "more than 99.9 %" if probability > 0.999 else f"{100 * probability:.3g} %"


def _undecided(rows: pd.DataFrame) -> list[str]:
    return [
        say("undecided", cases=list(group.case), runs=more) for more, group in rows.groupby("runs_to_decide", sort=True)
    ]


def _largest_sources(tables: Tables, requirement: dict[str, Any], violated: pd.DataFrame) -> list[str]:
    """Say which source makes most of the error, by linear covariance, where a requirement is violated; or that what is
    the same in every flight does. Of a phase, at the event that keeps the bound least.
    """
    budget, quantity = METRICS["budget"](tables), split_metric(requirement["metric"])[0]
    digests = {label: case for case, label in tables.labels.items()}
    found = []
    for case in violated.case:
        at, there = where(requirement), ""
        if requirement.get("during"):
            law = asked(tables, requirement, digests[case])
            at = at if isinstance(law, str) else law.distribution.moment.replace(" ", "_")
            there = f" at {words(at)}"
        rows = budget[(budget.case == case) & (budget.event == at) & (budget.metric == f"{quantity}_error")]
        if len(rows) and not why_not_applicable(tables, digests[case]):
            top, mean = rows.iloc[0], mean_at(tables, digests[case], at, quantity)
            if mean**2 > float((rows.sigma**2).sum()):
                found.append(say("largest_mean", case=case, mean=mean, unit=top.unit, there=there))
            else:
                share = f"{100 * top.share_ratio:.0f}"
                found.append(say("largest_source", case=case, source=top.source, share=share, there=there))
    return [f"Largest source in the 3D error, by linear covariance: {_listed(found)}."] if found else []
