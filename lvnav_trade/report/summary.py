"""The first screen: the question, the answer in plain words, the ranking."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd

from lvnav_trade import plots
from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.basics.select import mean_at, metric_name, split_metric
from lvnav_trade.metrics.errors.agreement import by_case
from lvnav_trade.metrics.errors.covariances import reach
from lvnav_trade.metrics.requirements.distributions import asked
from lvnav_trade.metrics.requirements.requirements import where
from lvnav_trade.report.blocks import Block, Text, number, percent, picture, table
from lvnav_trade.store import Tables

_FEW = 4
"""Cases that are all named beside their verdict."""


def summary(tables: Tables) -> list[Block]:
    """Return the answer: what each requirement says of the cases, how sure it is, and the ranking."""
    verdicts = METRICS["requirements"](tables)
    blocks: list[Block] = [Text(_scale(tables)), *_together(verdicts)]
    blocks += [Text(f"{line}.", "Warning:") for line in tables.manifest.get("warnings", [])]
    for requirement in tables.campaign.get("requirements") or ():
        blocks += _answer(tables, requirement, verdicts[verdicts.requirement == requirement["name"]])
    if not len(verdicts):
        blocks.append(Text("The campaign states no requirement; the cases are ranked below."))
    blocks.append(ranking_table(tables))
    at = str(METRICS["ranking"](tables).event.iloc[0]).replace("_", " ")
    blocks.append(picture("ranking", plots.PLOTS["rank"](tables), f"The cases by their error at {at}."))
    verdict = _agreement(tables)
    return [*blocks, Text(verdict)] if verdict else blocks


def _together(verdicts: pd.DataFrame) -> list[Block]:
    """Say which cases meet all requirements, where there are several, and what the others fail or leave open."""
    count = verdicts.requirement.nunique()
    if count < 2:
        return []
    found: dict[str, list[str]] = {"met": [], "undecided": [], "violated": []}
    for case, rows in verdicts.groupby("case", sort=False):
        worst = next(verdict for verdict in ("violated", "undecided", "met") if (rows.verdict == verdict).any())
        why = f" ({', '.join(rows.requirement[rows.verdict == worst])})" if worst != "met" else ""
        found[worst].append(f"{case}{why}")
    words = {"met": "Met by", "undecided": "Undecided for", "violated": "Violated by"}
    parts = [f"{words[verdict]} {'; '.join(names)}." for verdict, names in found.items() if names]
    parts = parts if found["met"] else ["Met by no case.", *parts]
    return [Text(" ".join(parts), f"All {count} requirements together.")]


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
    wanted = (
        f"{_metric(requirement)} below {_limit(requirement, rows.limit.iloc[0])} {_place(requirement)} in "
        f"{percent(requirement['probability'])} of flights, to be shown with "
        f"{percent(requirement.get('confidence', 0.9))} confidence."
    )
    blocks: list[Block] = [Text(wanted[0].upper() + wanted[1:], f"{str(requirement['name']).capitalize()}.")]
    for verdict, word in (("met", "Met by"), ("violated", "Violated by"), ("undecided", "Undecided for")):
        chosen = rows[rows.verdict == verdict]
        if len(chosen):
            every = f"all {len(rows)} cases: " if len(chosen) == len(rows) > 1 else ""
            names = _undecided(chosen) if verdict == "undecided" else [_case(row) for row in chosen.itertuples()]
            blocks.append(Text(f"{every}{'; '.join(names)}.", f"{word}:"))
    blocks += [
        Text(text, "Linear covariance alone:") for text in _by_covariance(tables, str(requirement["name"]), rows)
    ]
    better = _improvements(tables, str(requirement["name"]))
    if better:
        return [
            *blocks,
            Text(better, "What would make it met (by linear covariance, gains frozen; re-tuned may differ):"),
        ]
    return blocks + [Text(text) for text in _largest_sources(tables, requirement, rows[rows.verdict == "violated"])]


def _metric(requirement: dict[str, Any]) -> str:
    name = str(requirement["metric"]).replace("_", " ")
    return f"3D {name.removesuffix(' 3d')}" if name.endswith(" 3d") else name


def _limit(requirement: dict[str, Any], shown: str) -> str:
    """Write a limit; an angle in milliradians in degrees too."""
    size, _, unit = str(requirement["below"]).partition(" ")
    return f"{shown} ({math.degrees(float(size)):.3g} deg)" if unit == "rad" and "mrad" in shown else shown


def _place(requirement: dict[str, Any]) -> str:
    """Say where in the flight a requirement holds."""
    at = where(requirement).replace("_", " ")
    if not requirement.get("during"):
        return f"at {at}"
    return "at all times of the flight" if at == "flight" else f"at all times from {at}"


def _by_covariance(tables: Tables, name: str, verdicts: pd.DataFrame) -> list[str]:
    """Say what linear covariance by itself would conclude, in one sentence where it concludes the same."""
    frame = METRICS["expected"](tables)
    frame = frame[frame.requirement == name]
    runs = verdicts.set_index("case").verdict
    shown = frame[(frame.verdict != frame.case.map(runs)) | (len(frame) <= _FEW)]
    found = [
        f"{row.case}: {row.verdict}, {_chance(row.expected_probability)} of flights expected to keep it"
        for row in shown[shown.verdict != "not applicable"].itertuples()
    ]
    for reason, rows in shown[shown.verdict == "not applicable"].groupby("reason", sort=False):
        found.append(f"{rows.case.iloc[0] if len(rows) == 1 else f'{len(rows)} cases'}: not applicable, {reason}")
    if not len(frame):
        return []
    same = int(sum(row.verdict == runs[row.case] for row in frame.itertuples()))
    if not found:
        return ["the same verdict" + (f" in all {same} cases." if same > 1 else ".")]
    start = f"the same verdict in {same} of {len(frame)} cases; " if same and len(frame) > _FEW else ""
    return [start + "; ".join(found) + "."]


def _chance(probability: float) -> str:
    """Write a probability in percent; what would round to 100 is shown as more than 99.9."""
    return "more than 99.9 %" if probability > 0.999 else f"{100 * probability:.3g} %"


def _improvements(tables: Tables, name: str) -> str:
    """Say which source must get better by which factor, case by case."""
    frame = METRICS["improvements"](tables)
    found = []
    for row in frame[frame.requirement == name].itertuples():
        if not row.source:
            found.append(f"{row.case}: {row.remark}")
            continue
        together, _, beyond = row.remark.partition("; ") if row.remark.startswith("together") else ("", "", row.remark)
        together, beyond = f", {together}," if together else "", f", {beyond}" if beyond else ""
        part = f"{100 * row.share_ratio:.0f} % of the mean square"
        found.append(
            f"{row.case}: sigma of {_some(row.source)}{together} times {number(row.factor_ratio)} ({part}{beyond})"
        )
    return "; ".join(found) + "." if found else ""


def _some(sources: str) -> str:
    """Name the first of several sources, which are the largest, and count the others."""
    names = sources.split(", ")
    return sources if len(names) <= _FEW else f"{', '.join(names[: _FEW - 1])} and {len(names) - _FEW + 1} more"


def _case(row: Any) -> str:
    return f"{row.case} ({row.estimate}; {row.failures} of {row.runs} runs beyond)"


def _undecided(rows: pd.DataFrame) -> list[str]:
    """Name the cases that the same number of further runs would decide together."""
    return [
        f"{' and '.join(group.case)} ({more} further good runs {'each ' * (len(group) > 1)}would decide)"
        for more, group in rows.groupby("runs_to_decide", sort=True)
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
            at = at if isinstance(law, str) else law.moment.replace(" ", "_")
            there = f" at {at.replace('_', ' ')}"
        rows = budget[(budget.case == case) & (budget.event == at) & (budget.metric == metric_name(quantity))]
        if len(rows) and reach(tables, digests[case]).applies:
            top, mean = rows.iloc[0], mean_at(tables, digests[case], at, quantity)
            share = f"{top.source} ({100 * top.share_ratio:.0f} % of the variance{there})"
            biased = mean**2 > float((rows.sigma**2).sum())
            found.append(
                f"{case}: {f'the mean, {number(mean)} {top.unit} in every flight{there}' if biased else share}"
            )
    return [f"Largest source in the 3D error, by linear covariance: {'; '.join(found)}."] if found else []


def ranking_table(tables: Tables) -> Block:
    """Return the cases in order, with RMS and interval."""
    frame = METRICS["ranking"](tables)
    shown = pd.DataFrame({"case": frame.case, "runs": frame.run_count})
    failed = frame.case.map(tables.cases.set_index("label").failed_count)
    left_out = " Failed runs are left out of it." if failed.any() else ""
    if left_out:
        shown["failed"] = failed
    for quantity in ("velocity", "position", "attitude"):
        if quantity in frame:
            unit = frame[f"{quantity}_unit"].iloc[0]
            shown[f"{quantity} ({unit})"] = frame[quantity]
            low, high = frame[f"{quantity}_low"].map(number), frame[f"{quantity}_high"].map(number)
            shown["95 % interval" + " " * len(shown.columns)] = low + " to " + high
    at = str(frame.event.iloc[0]).replace("_", " ")
    found = table(shown, f"Ranking: 3D RMS error at {at}, best velocity first.{left_out}")
    return found._replace(head=tuple(name.rstrip() for name in found.head))


def _agreement(tables: Tables) -> str:
    found = by_case(tables)
    tested = found[found.verdict.isin(["agree", "disagree"])]
    outside = found[found.verdict == "not applicable"]
    why = [f"{'; '.join(rows.case)} ({reason})" for reason, rows in outside.groupby("reason", sort=False)]
    parts = [f"Not applicable: {'; '.join(why)}."] * bool(why)
    if not len(tested):
        return " ".join(parts)
    level = percent(float(tested.alpha_ratio.iloc[0]))
    bad = tested[tested.verdict == "disagree"]
    if bad.empty:
        where = "in the one case" if len(tested) == 1 else f"in all {len(tested)} cases"
        parts.insert(0, f"Monte Carlo and linear covariance agree {where} ({level} family-wise level per case).")
        return " ".join(parts)
    worst = "; ".join(
        f"{row.case} (worst: {row.state} at {row.event.replace('_', ' ')}, ratio {number(row.ratio)}, "
        f"bounds {number(row.low)} to {number(row.high)}, largest source there: {row.source or 'unknown'})"
        for row in bad.itertuples()
    )
    parts.insert(
        0,
        f"Monte Carlo and linear covariance disagree in {len(bad)} of {len(tested)} cases ({level} family-wise level "
        f"per case): {worst}. There the Monte-Carlo numbers count.",
    )
    return " ".join(parts)
