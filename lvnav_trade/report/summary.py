"""The first screen: the answer in a few lines, margins of all cases, the ranking; the answer to each requirement."""

import math
from typing import Any

import pandas as pd

from lvnav_trade.layout import split_metric
from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.basics.select import mean_at
from lvnav_trade.metrics.errors.covariances import by_case, why_not_applicable
from lvnav_trade.metrics.requirements.improvements import asked
from lvnav_trade.metrics.requirements.margins import ORDER, key_cases, worst, worst_runs
from lvnav_trade.metrics.requirements.requirements import in_words, where, with_unit
from lvnav_trade.report.blocks import Block, More, Table, Text, figure, number, percent, stated, table, words
from lvnav_trade.store.read import Tables

_FEW = 4  # cases that are all named beside their verdict
SIGNS = {"met": "✓", "undecided": "?", "not applicable": "–", "not confirmed": "!", "violated": "✗"}
_WORDS = {  # of verdicts, from the best to the worst
    "met": "Met by", "undecided": "Undecided for", "not confirmed": "Not confirmed for", "violated": "Violated by",
}  # fmt: skip


def summary(tables: Tables) -> list[Block]:
    """Return the answer in a few lines, the margin of every requirement in every case, and the ranking."""
    frame = METRICS["margins"](tables)
    blocks: list[Block] = [*_beyond(tables), *_verdict(frame), *_cases_that_decide(tables, frame)]
    first = METRICS["improvements"](tables)
    if len(first):
        lead = "What would make it met (by linear covariance, gains frozen; re-tuned may differ):"
        row = first.iloc[:1]
        more = f" {len(first) - 1} more under Requirements." * (len(first) > 1)
        blocks.append(Text(f"{_improvements(row)[0]}.{more}", lead))
    blocks.append(Text(" ".join([_scale(tables), *_agreement(tables)])))
    for lead in ("Warning:", "Note:"):
        lines = [Text(f"{line}.", lead) for line in tables.manifest.get(f"{lead[:-1].lower()}s", [])]
        blocks += lines if len(lines) <= _FEW else [More(f"{len(lines)} {lead[:-1].lower()}s", lines)]
    if len(frame):
        blocks.append(_matrix(tables, frame))
    else:
        blocks.append(Text("The campaign states no requirement; the cases are ranked below."))
    at = words(METRICS["ranking"](tables).event.iloc[0])
    drawn = figure(tables, "rank", name="ranking", event=at)
    ranking = _ranking(tables)
    return [*blocks, drawn, More("Ranking with intervals", [ranking]) if len(frame) else ranking]


def _verdict(frame: pd.DataFrame) -> list[Block]:
    """Say how many cases meet all requirements, and of which the others violate."""
    if frame.empty:
        return []
    cases, count = frame.groupby("case", sort=False), frame.requirement.nunique()
    of_cases = cases.verdict.agg(worst)
    parts = []
    for verdict, rows in of_cases.groupby(of_cases, sort=False):
        these = frame[frame.case.isin(rows.index) & (frame.verdict == verdict)]
        counts = these.groupby("requirement", sort=False).size()
        which = f" ({', '.join(f'{name}: {number}' for name, number in counts.items())})" * (count > 1)
        parts.append((ORDER.index(str(verdict)), f"{verdict}: {len(rows)}{which * (verdict != 'met')}"))
    name = f"All {count} requirements together" if count > 1 else f"{str(frame.requirement.iloc[0]).capitalize()}"
    shown = "; ".join(text for _, text in sorted(parts))
    by = " by linear covariance" if (frame.by == "LinCov").all() else ""
    return [Text(f"{len(of_cases)} case{'s' * (len(of_cases) > 1)}{by}: {shown}.", f"{name}.")]


def _cases_that_decide(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Name the worst case, the one that keeps its limits with the smallest margin, and the best."""
    found = []
    for case, role in key_cases(tables).items():
        rows = frame[frame.case == case]
        row = rows.loc[rows.margin_ratio.idxmin()]
        size, limit = (with_unit(value, row.unit) for value in (row.estimate, row.limit))
        found.append(f"{role}: {case} ({_signed(row)}, {size} of {limit})")
    return [Text(f"{'; '.join(found)}.", "Margins.")] if found else []


def _signed(row: Any) -> str:
    """Write a margin with the sign of its verdict."""
    size = row.margin_ratio
    if pd.isna(size):
        return SIGNS[row.verdict]
    text = f" {100.0 * size:+.0f} %" if size > -1.0 else f" {number(1.0 - size)} times the limit"
    return f"{SIGNS[row.verdict]}{text}"


def _matrix(tables: Tables, frame: pd.DataFrame) -> Block:
    """Return the matrix of cases and requirements, smallest margin first, with the errors that rank the cases."""
    names = list(dict.fromkeys(frame.requirement))
    ranking = METRICS["ranking"](tables).set_index("case")
    shown = [name for name in ("velocity", "position", "attitude") if name in ranking]
    cells = {(row.case, row.requirement): _signed(row) for row in frame.itertuples()}
    rows = tuple(
        (case, *(cells.get((case, name), "") for name in names), *(number(ranking.at[case, name]) for name in shown))
        for case in dict.fromkeys(frame.case)
    )
    units = [f"{name} ({ranking[f'{name}_unit'].iloc[0]})" for name in shown]
    by = " Verdicts and margins are linear covariance's." if (frame.by == "LinCov").all() else ""
    signs = ", ".join(f"{sign} {verdict}" for verdict, sign in SIGNS.items() if (frame.verdict == verdict).any())
    caption = (
        f"Margin to the limit, smallest first: {signs}.{by} Beside it the 3D RMS error at "
        f"{words(METRICS['ranking'](tables).event.iloc[0])}."
    )
    return Table(("case", *names, *units), rows, (False, *(True for _ in (*names, *shown))), caption)


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
    return [stated("worst_runs", shown), *[More("Pictures of the worst runs", drawn)] * bool(drawn)]


def _beyond(tables: Tables) -> list[Block]:
    """Say what of the flights is beyond usual limits, because their cards allow it: nobody should overlook it."""
    lines = tables.manifest.get("beyond_limits", [])
    return [Text(f"{'; '.join(lines)}. All results below rest on that.", "Beyond usual limits:")] if lines else []


def _scale(tables: Tables) -> str:
    cases = tables.cases
    runs, failed = int(cases.run_count.sum()), int(cases.failed_count.sum())
    least, most = cases.run_count.min(), cases.run_count.max()
    each = f"{least} to {most}" if least < most else str(most)
    flown = f"and {each} Monte-Carlo runs{' each' * (len(cases) > 1)}." if runs else "only."
    lost = ""
    if failed:
        first = tables.runs.t_failed_s.min()
        lost = (
            f" {failed} of {runs} runs failed and count against every requirement, the first at {first:.0f} s: from "
            "its failure on a run is in no root mean square, and infinite in every quantile."
        )
    return f"{len(cases)} case{'s' * (len(cases) > 1)}, linear covariance {flown}{lost}"


def _answer(tables: Tables, requirement: dict[str, Any], rows: pd.DataFrame) -> list[Block]:
    name = str(requirement["name"])
    wanted = (
        f"{_metric(requirement)} below {_limit(requirement, rows.limit.iloc[0])} {_place(requirement)} in "
        f"{percent(requirement['probability'])} of flights, to be shown with "
        f"{percent(requirement.get('confidence', 0.9))} confidence."
    )
    blocks: list[Block] = [Text(wanted[0].upper() + wanted[1:], f"{name.capitalize()}.")]
    for verdict in ("met", "violated", "not confirmed", "undecided"):
        chosen = rows[rows.verdict == verdict]
        if len(chosen):
            part = f"{len(chosen)} of {len(rows)} cases: " if len(chosen) > _FEW else ""
            part = f"all {len(rows)} cases: " if len(chosen) == len(rows) > 1 else part
            blocks.append(Text(f"{part}{_listed(_cases(verdict, chosen))}.", f"{_WORDS[verdict]}:"))
    blocks += [Text(text, "Linear covariance alone:") for text in _by_covariance(tables, name, rows)]
    better = METRICS["improvements"](tables)
    better = better[better.requirement == name]
    if len(better):
        return [*blocks, Text(f"{_listed(_improvements(better))}.", "What would make it met:")]
    return blocks + [Text(text) for text in _largest_sources(tables, requirement, rows[rows.verdict == "violated"])]


def _listed(texts: list[str]) -> str:
    """Join texts; of many the first ones, and how many more there are."""
    more = len(texts) - 2 * _FEW
    return "; ".join(texts[: 2 * _FEW]) + f"; and {more} more, see the table" * (more > 0)


def _cases(verdict: str, rows: pd.DataFrame) -> list[str]:
    """Name the cases of a verdict, with what it rests on."""
    if verdict == "undecided":
        return _undecided(rows)
    if verdict == "not confirmed":
        return list(rows.case)
    return [f"{row.case} ({row.estimate}; {row.failures} of {row.runs} runs beyond)" for row in rows.itertuples()]


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
    if not found:
        return ["the same verdict" + (f" in all {same} cases." if same > 1 else ".")]
    start = f"the same verdict in {same} of {len(frame)} cases; " if same and len(frame) > _FEW else ""
    return [start + _listed(found) + "."]


def _chance(probability: float) -> str:
    """Write a probability in percent; what would round to 100 is shown as more than 99.9."""
    return "more than 99.9 %" if probability > 0.999 else f"{100 * probability:.3g} %"


def _improvements(frame: pd.DataFrame) -> list[str]:
    found = []
    for row in frame.itertuples():
        together, _, beyond = row.remark.partition("; ") if row.remark.startswith("together") else ("", "", row.remark)
        together, beyond = f", {together}," if together else "", f", {beyond}" if beyond else ""
        part = f"{100 * row.share_ratio:.0f} % of the mean square"
        better = f"sigma of {_some(row.source)}{together} times {number(row.factor_ratio)} ({part}{beyond})"
        found.append(f"{row.case}: {better if row.source else row.remark}")
    return found


def _some(sources: str) -> str:
    """Name the first of several sources, which are the largest, and count the others."""
    names = sources.split(", ")
    return sources if len(names) <= _FEW else f"{', '.join(names[: _FEW - 1])} and {len(names) - _FEW + 1} more"


def _undecided(rows: pd.DataFrame) -> list[str]:
    return [
        f"{_together(list(group.case))} ({more} further good runs {'each ' * (len(group) > 1)}would decide)"
        for more, group in rows.groupby("runs_to_decide", sort=True)
    ]


def _together(cases: list[str]) -> str:
    """Name cases, or of many the first ones and how many more there are."""
    more = len(cases) - _FEW
    return " and ".join([*cases[:_FEW], f"{more} more"] if more > 1 else cases)


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
            there = f" at {words(at)}"
        rows = budget[(budget.case == case) & (budget.event == at) & (budget.metric == f"{quantity}_error")]
        if len(rows) and not why_not_applicable(tables, digests[case]):
            top, mean = rows.iloc[0], mean_at(tables, digests[case], at, quantity)
            biased = mean**2 > float((rows.sigma**2).sum())
            share = f"{top.source} ({100 * top.share_ratio:.0f} % of the variance{there})"
            same = f"the mean, {number(mean)} {top.unit} in every flight{there}"
            found.append(f"{case}: {same if biased else share}")
    return [f"Largest source in the 3D error, by linear covariance: {_listed(found)}."] if found else []


def _ranking(tables: Tables) -> Block:
    frame = METRICS["ranking"](tables)
    frame = frame.assign(failed=frame.case.map(tables.cases.set_index("label").failed_count))
    left_out = " Runs that failed before are left out of it." if frame.failed.any() else ""
    columns = ["case | runs = run_count"] + ["failed"] * bool(left_out)
    for quantity in (name for name in ("velocity", "position", "attitude") if name in frame):
        unit, again = frame[f"{quantity}_unit"].iloc[0], " " * len(columns)  # a heading stands once in a frame
        columns.append(f"{quantity} ({unit}) = {quantity}")
        columns.append(f"95 % interval{again} = {quantity}_low to {quantity}_high: number")
    caption = f"Ranking: 3D RMS error at {words(frame.event.iloc[0])}, best velocity first.{left_out}"
    found = table(frame, caption, " | ".join(columns))
    return found._replace(head=tuple(name.rstrip() for name in found.head))


def _agreement(tables: Tables) -> list[str]:
    found = by_case(tables)
    tested = found[found.verdict.isin(["agree", "disagree"])]
    outside = found[found.verdict == "not applicable"].groupby("reason", sort=False)
    why = [f"{_listed(list(rows.case))} ({reason})" for reason, rows in outside]
    parts = [f"Not applicable: {'; '.join(why)}."] * bool(why)
    if not len(tested):
        return parts
    level = f"({percent(float(tested.alpha_ratio.iloc[0]))} family-wise level per case)"
    bad = tested[tested.verdict == "disagree"]
    if bad.empty:
        everywhere = "in the one case" if len(tested) == 1 else f"in all {len(tested)} cases"
        return [f"Monte Carlo and linear covariance agree {everywhere} {level}.", *parts]
    named = [
        f"{row.case} (worst: {row.state} at {words(row.event)}, ratio {number(row.ratio)}, "
        f"bounds {number(row.low)} to {number(row.high)}, largest source there: {row.source or 'unknown'})"
        for row in bad.itertuples()
    ]
    disagree = (
        f"Monte Carlo and linear covariance disagree in {len(bad)} of {len(tested)} cases {level}: {_listed(named)}. "
        "There the Monte-Carlo numbers count."
    )
    return [disagree, *parts]
