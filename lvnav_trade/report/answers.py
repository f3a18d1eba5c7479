"""The answer to each requirement: which designs meet it, on what evidence, and which change makes the others comply."""

import math
from typing import Any

import pandas as pd

from lvnav_trade.quantities.state_layout import split_metric
from lvnav_trade.report.advice import advice
from lvnav_trade.report.blocks import Block, Details, Text, all_cases, figure, formatted_table, join_texts, words
from lvnav_trade.report.sentences import say
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.covariances import why_not_applicable
from lvnav_trade.results.metric import event_or_phase
from lvnav_trade.results.requirements.improvements import evaluate_stored_requirement
from lvnav_trade.results.requirements.margins import worst_runs
from lvnav_trade.results.requirements.requirements import verdict_texts, with_unit
from lvnav_trade.results.statistics.select import mean_at
from lvnav_trade.results.tables.read import Tables

_FEW = 4  # up to this number of cases, each is named with its verdict
_WORDS = {  # of verdicts, from the best to the worst
    "met": "Met by",
    "undecided": "Undecided for",
    "not applicable": "No verdict for",
    "not confirmed": "Not confirmed for",
    "violated": "Violated by",
}


def answers(tables: Tables) -> list[Block]:
    """Return the verdict on each requirement with its evidence, the changes that lead to compliance, and the worst
    runs.
    """
    verdicts = verdict_texts(METRICS["requirements"](tables))
    blocks: list[Block] = []
    for requirement in tables.campaign.get("requirements") or ():
        blocks += _answer(tables, requirement, verdicts[verdicts.requirement == requirement["name"]])
    return blocks + _worst_runs(tables)


def _worst_runs(tables: Tables) -> list[Block]:
    """Return the run with the largest error of each requirement in the deciding cases, the command that repeats it, and
    figures of these runs.
    """
    worst = worst_runs(tables)
    if worst.empty:
        return []
    rows = worst.assign(
        case=worst.case.map(tables.labels),
        error=[with_unit(row.error, row.unit) for row in worst.itertuples()],
        command=[f"lvnav-trade replay . {row.case} {row.run_number}" for row in worst.itertuples()],
    )
    blocks: list[Block] = [formatted_table("worst_runs", rows)]
    keys = ["case", "run_number"]
    stored_runs = tables.traces[keys].drop_duplicates()
    shown_runs = worst[keys].merge(stored_runs).drop_duplicates()
    pictures = [figure(tables, "worst_run", row.case, str(row.run_number)) for row in shown_runs.itertuples()]
    if pictures:
        blocks.append(Details("Pictures of the worst runs", pictures))
    return blocks


def _answer(tables: Tables, requirement: dict[str, Any], rows: pd.DataFrame) -> list[Block]:
    """Return the paragraphs on one requirement: the requirement, the cases by verdict, and how to comply.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    requirement : dict
        Requirement, as written in the campaign.
    rows : pandas.DataFrame
        Verdicts of all cases on the requirement.
    """
    name = str(requirement["name"])
    sentence = say(
        "wanted",
        metric=_metric(requirement),
        limit=_limit(requirement, rows.limit.iloc[0]),
        place=_place(requirement),
        probability=requirement["probability"],
        confidence=requirement.get("confidence", 0.9),
    )
    blocks: list[Block] = [Text(sentence[0].upper() + sentence[1:], f"{name.capitalize()}.")]
    for verdict in ("met", "violated", "not confirmed", "undecided", "not applicable"):
        verdict_rows = rows[rows.verdict == verdict]
        if verdict_rows.empty:
            continue
        count = ""
        if len(verdict_rows) == len(rows) > 1:
            count = f"{all_cases(len(rows))}: "
        elif len(verdict_rows) > _FEW:
            count = f"{len(verdict_rows)} of {len(rows)} cases: "
        blocks.append(Text(f"{count}{_join_texts(_cases(verdict, verdict_rows))}.", f"{_WORDS[verdict]}:"))
    for text in _covariance_verdicts(tables, name, rows):
        blocks.append(Text(text, "Linear covariance alone:"))
    improvements = METRICS["improvements"](tables)
    improvements = improvements[improvements.requirement == name]
    if len(improvements):
        changes = [advice(tables, row) for row in improvements.itertuples()]
        blocks.append(Text(_join_texts(changes, " "), "To comply:"))
    else:
        violated_rows = rows[rows.verdict == "violated"]
        blocks += [Text(text) for text in _largest_sources(tables, requirement, violated_rows)]
    return blocks


def _join_texts(texts: list[str], separator: str = "; ") -> str:
    """Join texts; of many only the first, with the number of the others."""
    return join_texts(texts, 2 * _FEW, separator)


def _cases(verdict: str, rows: pd.DataFrame) -> list[str]:
    """Name the cases of a verdict, with the evidence for it."""
    if verdict == "undecided":
        return _undecided_sentences(rows)
    if verdict in ("not confirmed", "not applicable"):
        return list(rows.case)
    return [f"{row.case} ({row.estimate}; {_evidence(row)})" for row in rows.itertuples()]


def _evidence(row: Any) -> str:
    """Name the evidence for a verdict: runs, or linear covariance and the number of runs that do not contradict it."""
    return say("rests_on", failures=row.failures, runs=row.runs, by_runs=row.by == "runs")


def _metric(requirement: dict[str, Any]) -> str:
    name = words(requirement["metric"])
    if name.endswith(" 3d"):
        return f"3D {name.removesuffix(' 3d')}"
    return name


def _limit(requirement: dict[str, Any], limit_text: str) -> str:
    """Return a limit as text; an angle in milliradians is repeated in degrees."""
    size, _, unit = str(requirement["below"]).partition(" ")
    if unit == "rad" and "mrad" in limit_text:
        return f"{limit_text} ({math.degrees(float(size)):.3g} deg)"
    return limit_text


def _place(requirement: dict[str, Any]) -> str:
    """Return the place of a requirement: "at injection", "at all times from lift-off"."""
    place = words(event_or_phase(requirement))
    if not requirement.get("during"):
        return f"at {place}"
    return "at all times of the flight" if place == "flight" else f"at all times from {place}"


def _covariance_verdicts(tables: Tables, name: str, verdicts: pd.DataFrame) -> list[str]:
    """Return the verdicts by linear covariance alone.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    name : str
        Name of the requirement.
    verdicts : pandas.DataFrame
        Verdicts of all cases on the requirement, by runs where there are runs.

    Returns
    -------
    list of str
        One sentence with the number of equal verdicts and the cases that differ. With few cases, all are listed.
    """
    frame = METRICS["expected_verdicts"](tables)
    frame = frame[frame.requirement == name]
    if frame.empty:
        return []
    verdict_by_case = verdicts.set_index("case").verdict
    run_verdict = frame.case.map(verdict_by_case)
    is_same = frame.verdict == run_verdict
    are_few = len(frame) <= _FEW
    differing = frame[~is_same | are_few]
    applies = ~differing.verdict.isin(["not applicable", "not confirmed"])
    sentences = []
    for row in differing[applies].itertuples():
        chance = _chance(row.expected_probability)
        sentences.append(f"{row.case}: {row.verdict}, {chance} of flights expected to meet it")
    groups = differing[~applies].groupby(["verdict", "reason"], sort=False)
    for (verdict, reason), rows in groups:
        if len(rows) == 1:
            cases = rows.case.iloc[0]
        else:
            cases = f"{len(rows)} cases"
        sentences.append(f"{cases}: {verdict}, {reason}")
    return [say("covariance_alone", same=int(is_same.sum()), whole=len(frame), others=sentences)]


def _chance(probability: float) -> str:
    """Return a probability in percent; a value that would round to 100 is written as more than 99.9."""
    return "more than 99.9 %" if probability > 0.999 else f"{100 * probability:.3g} %"


def _undecided_sentences(rows: pd.DataFrame) -> list[str]:
    """Name the undecided cases with the number of runs that would decide them."""
    groups = rows.groupby("runs_to_decide", sort=True)
    return [say("undecided", cases=list(group.case), runs=runs) for runs, group in groups]


def _largest_sources(tables: Tables, requirement: dict[str, Any], violated_rows: pd.DataFrame) -> list[str]:
    """Return the largest error source by linear covariance for each case that violates a requirement.

    The mean error, which is the same in every run, counts as a source. For a phase, the budget is that of the event
    with the smallest margin.

    requirement : requirement, as written in the campaign
    violated_rows : verdicts of the cases that violate it
    """
    budget = METRICS["budget"](tables)
    quantity = split_metric(requirement["metric"])[0]
    digests = {label: case for case, label in tables.labels.items()}
    sentences = []
    for label in violated_rows.case:
        case = digests[label]
        event = event_or_phase(requirement)
        place = ""
        if requirement.get("during"):
            law = evaluate_stored_requirement(tables, requirement, case)
            if not isinstance(law, str):
                event = law.distribution.event_or_time.replace(" ", "_")
            place = f" at {words(event)}"
        is_of_case = (budget.case == label) & (budget.event == event)
        rows = budget[is_of_case & (budget.metric == f"{quantity}_error")]
        if rows.empty or why_not_applicable(tables, case):
            continue
        top = rows.iloc[0]
        mean = mean_at(tables, case, event, quantity)
        if mean**2 > float((rows.sigma**2).sum()):
            sentence = say(
                "largest_mean",
                case=label,
                mean=mean,
                unit=top.unit,
                there=place,
            )
        else:
            share = f"{100 * top.share_ratio:.0f}"
            sentence = say(
                "largest_source",
                case=label,
                source=top.source,
                share=share,
                there=place,
            )
        sentences.append(sentence)
    if not sentences:
        return []
    return [f"Largest source in the 3D error, by linear covariance: {_join_texts(sentences)}."]
