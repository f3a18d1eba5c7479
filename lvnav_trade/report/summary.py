"""Summary of a report: the answer in a few lines, its limits, margins of all cases, the ranking."""

import math
from typing import Any

import pandas as pd

from lvnav_trade.report.advice import advice, ways_to_comply
from lvnav_trade.report.assumptions import placed_by_assumptions, ranked_by_assumptions
from lvnav_trade.report.blocks import Block, Details, Table, Text, figure, listed, number, table, words
from lvnav_trade.report.document import margin_policy, place_of
from lvnav_trade.report.sentences import say
from lvnav_trade.report.validity import (
    MARKS,
    RESTS_ON,
    empty_stages,
    filter_cells,
    mark,
    overconfidence,
    short_lived,
    window_cells,
)
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.covariances import by_case
from lvnav_trade.results.requirements.margins import ORDER, key_cases, worst
from lvnav_trade.results.requirements.requirements import with_unit
from lvnav_trade.results.requirements.windows import COVARIANCE
from lvnav_trade.results.tables.read import Tables

_FEW = 4  # up to this number of cases, each is named with its verdict
_MULTIPLE = 2.0  # error over limit from which it is written as a multiple, not as a margin
SIGNS = {"met": "✓", "undecided": "?", "not applicable": "–", "not confirmed": "!", "violated": "✗"}
_ROLES = {"worst": "worst design", "binding": "smallest positive margin", "best": "best design"}


def summary(tables: Tables) -> list[Block]:
    """Return the verdict in a few lines, the margin of every requirement in every case, and the ranking."""
    frame = METRICS["margins"](tables)
    blocks: list[Block] = [*_beyond(tables), *_verdict(frame), *short_lived(tables), *overconfidence(tables)]
    blocks += empty_stages(tables)
    blocks += [*margin_policy(tables, frame), *_cases_that_decide(tables, frame)]
    ways = ways_to_comply(METRICS["improvements"](tables))
    if len(ways):
        text = say("comply_first", advice=advice(tables, next(ways.itertuples())), others=len(ways) - 1)
        blocks.append(Text(text, "To comply:"))
    blocks.append(Text(" ".join([_scale(tables), *_agreement(tables)])))
    for lead in ("Warning:", "Note:"):
        lines = [Text(f"{line}.", lead) for line in tables.manifest.get(f"{lead[:-1].lower()}s", [])]
        blocks += lines if len(lines) <= _FEW else [Details(f"{len(lines)} {lead[:-1].lower()}s", lines)]
    blocks += [*placed_by_assumptions(tables), *ranked_by_assumptions(tables)]
    if len(frame):
        blocks.append(_matrix(tables, frame))
    else:
        blocks.append(Text("The campaign states no requirement; the cases are ranked below."))
    at = words(METRICS["ranking"](tables).event.iloc[0])
    drawn = figure(tables, "rank", name="ranking", event=at)
    ranking = _ranking(tables)
    return [*blocks, drawn, Details("Ranking with intervals", [ranking]) if len(frame) else ranking]


def _verdict(frame: pd.DataFrame) -> list[Block]:
    """Return the number of designs that meet the requirements, the violated requirements, and the evidence for both."""
    if frame.empty:
        return []
    names = list(dict.fromkeys(frame.requirement))
    of_cases = frame.groupby("case", sort=False).verdict.agg(worst)
    counts = of_cases.value_counts()
    text = say(
        "verdict",
        met=int(counts.get("met", 0)),
        whole=len(of_cases),
        requirements=len(names),
        evidence=_evidence(frame, of_cases, "met"),
        others=[
            _not_met(frame, of_cases, verdict, len(names) > 1)
            for verdict in ORDER[::-1]
            if verdict in counts and verdict != "met"
        ],
        by_covariance=bool((frame.by == COVARIANCE).all()),
    )
    name = say("name_of_all", requirements=len(names)) if len(names) > 1 else f"{str(names[0]).capitalize()}."
    return [Text(text, name)]


def _not_met(frame: pd.DataFrame, of_cases: pd.Series, verdict: str, is_several: bool) -> str:
    """Return the number of designs with a verdict as their worst, and the requirements if there are several."""
    these = frame[frame.case.isin(of_cases.index[of_cases == verdict]) & (frame.verdict == verdict)]
    counts = these.groupby("requirement", sort=False).size()
    return say(
        "not_met",
        designs=int((of_cases == verdict).sum()),
        verdict=verdict,
        which=dict(counts.items()) if is_several else {},
        evidence=_evidence(frame, of_cases, verdict),
    )


def _evidence(frame: pd.DataFrame, of_cases: pd.Series, verdict: str) -> str:
    """Return the number of designs whose verdict is confirmed by runs, if other designs rest on linear covariance.

    Compliance of a design is confirmed if all its requirements are; a violation, if that requirement is.
    """
    of_runs = frame.by != COVARIANCE
    if of_runs.all() or not of_runs.any() or verdict not in ("met", "violated"):
        return ""
    rows = frame.assign(of_runs=of_runs)[frame.case.map(of_cases) == verdict]
    if rows.empty:
        return ""
    by_case = rows[rows.verdict == verdict].groupby("case", sort=False).of_runs
    confirmed = by_case.all() if verdict == "met" else by_case.any()
    by_covariance = by_case.any()[~confirmed]
    return say("evidence", by_runs=int(confirmed.sum()), others=len(by_covariance), in_part=bool(by_covariance.any()))


def _cases_that_decide(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the worst case, the compliant case with the smallest margin, and the best case."""
    sentences = []
    for case, role in key_cases(tables).items():
        rows = frame[frame.case == case]
        row = rows.loc[rows.margin_ratio.idxmin()]
        size, limit = (with_unit(value, row.unit) for value in (row.estimate, row.limit))
        sentences.append(f"{_ROLES[role]}: {case} ({_signed(row)}, {size} of {limit})")
    return [Text(f"{'; '.join(sentences)}.", "Margins.")] if sentences else []


def _signed(row: Any, as_multiple: bool | None = None) -> str:
    """Return a margin with the sign of its verdict.

    as_multiple : Whether to write the error as a multiple of the limit; by default from `_MULTIPLE` on.
    """
    size = row.margin_ratio
    if pd.isna(size):
        return SIGNS[row.verdict]
    multiple = 1.0 - size >= _MULTIPLE if as_multiple is None else as_multiple
    text = f" {number(1.0 - size)} times the limit" if multiple else f" {100.0 * size:+.0f} %"
    return f"{SIGNS[row.verdict]}{text}"


def _matrix(tables: Tables, frame: pd.DataFrame) -> Block:
    """Return the matrix of cases by requirements, smallest margin first.

    Columns: margins, consistency of the filter, worst error around events, and the errors that rank the cases.
    """
    names = list(dict.fromkeys(frame.requirement))
    ranking = METRICS["ranking"](tables).set_index("case")
    quantities = [name for name in ("velocity", "position", "attitude") if name in ranking]
    multiple = {name: bool((1.0 - rows.margin_ratio >= _MULTIPLE).any()) for name, rows in frame.groupby("requirement")}
    alone = bool((frame.by == COVARIANCE).all())
    cells = {
        (row.case, row.requirement): _signed(row, multiple[row.requirement]) + mark(row.by, alone)
        for row in frame.itertuples()
    }
    filters, around = filter_cells(tables), window_cells(tables)
    rows = tuple(
        (
            case,
            *(cells.get((case, name), "") for name in names),
            filters[case],
            *(of.get(case, "–") for of in around.values()),
            *(number(ranking.at[case, name]) for name in quantities),
        )
        for case in dict.fromkeys(frame.case)
    )
    units = [f"{name} ({ranking[f'{name}_unit'].iloc[0]})" for name in quantities]
    at = [
        words(requirement["at"]) for requirement in tables.campaign.get("requirements") or () if requirement.get("at")
    ]
    caption = say(
        "matrix",
        required=_required(tables, frame),
        has_multiples=any(multiple.values()),
        signs=[f"{sign} {verdict}" for verdict, sign in SIGNS.items() if (frame.verdict == verdict).any()],
        by_covariance=alone,
        marks=[f"{sign} {RESTS_ON[by]}" for by, sign in MARKS.items() if any(sign in str(row) for row in rows)],
        moments=list(dict.fromkeys(at)),
        has_windows=bool(around),
        event=words(METRICS["ranking"](tables).event.iloc[0]),
    )
    head = ("design", *names, "filter consistent over the run?", *around, *units)
    return Table(head, rows, (False, *(True for _ in names), False, *(True for _ in (*around, *quantities))), caption)


def _required(tables: Tables, frame: pd.DataFrame) -> str:
    """Return the requirements as a sentence: limit, place and share of flights; empty if there are too many."""
    stated = tables.campaign.get("requirements") or ()
    if len(stated) > _FEW:
        return ""
    limits = {row.requirement: with_unit(row.limit, row.unit) for row in frame.dropna(subset="limit").itertuples()}
    parts = [
        {
            "name": requirement["name"],
            "limit": limits.get(requirement["name"], requirement["below"]),
            "place": place_of(requirement),
            "probability": float(requirement["probability"]),
        }
        for requirement in stated
    ]
    return say("required", requirements=parts) if parts else ""


def _beyond(tables: Tables) -> list[Block]:
    """Return a warning if cards allow flights outside validated limits, which a reader should not overlook."""
    lines = tables.manifest.get("beyond_limits", [])
    return [Text(f"{'; '.join(lines)}. All results below depend on it.", "Outside validated limits:")] if lines else []


def _scale(tables: Tables) -> str:
    cases = tables.cases
    failed = int(cases.failed_count.sum())
    return say(
        "extent",
        cases=len(cases),
        runs=int(cases.run_count.sum()),
        least=int(cases.run_count.min()),
        most=int(cases.run_count.max()),
        failed=failed,
        first=tables.runs.t_failed_s.min() if failed else math.nan,
    )


def _ranking(tables: Tables) -> Block:
    frame = METRICS["ranking"](tables)
    frame = frame.assign(failed=frame.case.map(tables.cases.set_index("label").failed_count))
    left_out = " Runs that failed before this event are excluded." if frame.failed.any() else ""
    columns = ["case | runs = run_count", *(["failed"] if left_out else [])]
    for quantity in (name for name in ("velocity", "position", "attitude") if name in frame):
        # Headings of a frame are unique: blanks of different length
        unit, blank_heading = frame[f"{quantity}_unit"].iloc[0], "".ljust(len(columns))
        columns.append(f"{quantity} ({unit}) = {quantity}")
        columns.append(f"95 % interval{blank_heading} = {quantity}_low to {quantity}_high: number")
    caption = f"Ranking: 3D RMS error at {words(frame.event.iloc[0])}, best velocity first.{left_out}"
    ranking = table(frame, caption, " | ".join(columns))
    return ranking._replace(head=tuple(name.rstrip() for name in ranking.head))


def _agreement(tables: Tables) -> list[str]:
    """Return sentences on the agreement of runs and linear covariance."""
    cases = by_case(tables)
    tested = cases[cases.verdict.isin(["agree", "disagree"])]
    outside = cases[cases.verdict == "not applicable"].groupby("reason", sort=False)
    why = [f"{listed(list(rows.case), 2 * _FEW)} ({reason})" for reason, rows in outside]
    parts = [f"Not applicable: {'; '.join(why)}."] if why else []
    if not len(tested):
        return parts
    bad = tested[tested.verdict == "disagree"]
    disagreements = [say("disagreement", case=row.case, row=row._asdict()) for row in bad.itertuples()]
    return [say("agreement", tested=len(tested), level=float(tested.alpha_ratio.iloc[0]), bad=disagreements), *parts]
