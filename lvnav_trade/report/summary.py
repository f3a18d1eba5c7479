"""Summary of a report: the answer in a few lines, its limits, margins of all cases, the ranking."""

import math
from collections.abc import Sequence
from typing import Any

import pandas as pd

from lvnav_trade.report.advice import advice, ways_to_comply
from lvnav_trade.report.assumptions import orbit_warning, ranking_warning
from lvnav_trade.report.blocks import Block, Details, Table, Text, figure, join_texts, number, table, words
from lvnav_trade.report.document import margin_policy, place_text
from lvnav_trade.report.sentences import say
from lvnav_trade.report.validity import (
    MARKS,
    RESTS_ON,
    empty_stages,
    filter_cells,
    mark,
    sigma_warnings,
    window_cells,
    window_warning,
)
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.covariances import by_case
from lvnav_trade.results.requirements.margins import ORDER, key_cases, severest_verdict
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
    blocks: list[Block] = [
        *_limit_warning(tables),
        *_verdict(frame),
        *window_warning(tables),
        *sigma_warnings(tables),
        *empty_stages(tables),
        *margin_policy(tables, frame),
        *_deciding_cases(tables, frame),
    ]
    improvements = ways_to_comply(METRICS["improvements"](tables))
    if len(improvements):
        first = next(improvements.itertuples())
        text = say("comply_first", advice=advice(tables, first), others=len(improvements) - 1)
        blocks.append(Text(text, "To comply:"))
    blocks.append(Text(" ".join([_extent(tables), *_agreement(tables)])))
    blocks += _remarks("warning", tables.manifest.get("warnings", []))
    blocks += _remarks("note", tables.manifest.get("notes", []))
    blocks += orbit_warning(tables)
    blocks += ranking_warning(tables)
    if len(frame):
        blocks.append(_matrix(tables, frame))
    else:
        blocks.append(Text("The campaign states no requirement; the cases are ranked below."))
    event = words(METRICS["ranking"](tables).event.iloc[0])
    blocks.append(figure(tables, "rank", name="ranking", event=event))
    ranking = _ranking(tables)
    blocks.append(Details("Ranking with intervals", [ranking]) if len(frame) else ranking)
    return blocks


def _remarks(name: str, lines: Sequence[str]) -> list[Block]:
    """Return the warnings or notes (name) of a campaign as paragraphs; of many, all on demand."""
    paragraphs = [Text(f"{line}.", f"{name.capitalize()}:") for line in lines]
    if len(paragraphs) <= _FEW:
        return list(paragraphs)
    return [Details(f"{len(lines)} {name}s", paragraphs)]


def _verdict(frame: pd.DataFrame) -> list[Block]:
    """Return the number of designs that meet the requirements, the violated requirements, and the evidence for both."""
    if frame.empty:
        return []
    names = list(dict.fromkeys(frame.requirement))
    is_several = len(names) > 1
    worst_verdicts = frame.groupby("case", sort=False).verdict.agg(severest_verdict)
    counts = worst_verdicts.value_counts()
    other_verdicts = []
    for verdict in reversed(ORDER):
        if verdict in counts and verdict != "met":
            other_verdicts.append(_not_met(frame, worst_verdicts, verdict, is_several))
    text = say(
        "verdict",
        met=int(counts.get("met", 0)),
        whole=len(worst_verdicts),
        requirements=len(names),
        evidence=_evidence(frame, worst_verdicts, "met"),
        others=other_verdicts,
        by_covariance=bool((frame.by == COVARIANCE).all()),
    )
    if is_several:
        lead = say("name_of_all", requirements=len(names))
    else:
        lead = f"{str(names[0]).capitalize()}."
    return [Text(text, lead)]


def _not_met(frame: pd.DataFrame, worst_verdicts: pd.Series, verdict: str, is_several: bool) -> str:
    """Return the number of designs with a verdict as their worst, and the requirements if there are several.

    Parameters
    ----------
    frame : pandas.DataFrame
        Verdicts by case and requirement.
    worst_verdicts : pandas.Series
        Worst verdict by case.
    verdict : str
        The verdict, such as "violated".
    is_several : bool
        Whether the campaign has several requirements.
    """
    cases = worst_verdicts.index[worst_verdicts == verdict]
    rows = frame[frame.case.isin(cases) & (frame.verdict == verdict)]
    counts = rows.groupby("requirement", sort=False).size()
    return say(
        "not_met",
        designs=len(cases),
        verdict=verdict,
        which=dict(counts.items()) if is_several else {},
        evidence=_evidence(frame, worst_verdicts, verdict),
    )


def _evidence(frame: pd.DataFrame, worst_verdicts: pd.Series, verdict: str) -> str:
    """Return the number of designs whose verdict is confirmed by runs, if other designs rest on linear covariance.

    Compliance of a design is confirmed if all its requirements are. A violation is confirmed if that of one requirement
    is.

    Parameters
    ----------
    frame : pandas.DataFrame
        Verdicts by case and requirement, with their evidence (`by`).
    worst_verdicts : pandas.Series
        Worst verdict by case.
    verdict : str
        "met" or "violated"; the result is empty for any other verdict.
    """
    is_by_runs = frame.by != COVARIANCE
    if is_by_runs.all() or not is_by_runs.any() or verdict not in ("met", "violated"):
        return ""
    rows = frame.assign(of_runs=is_by_runs)
    worst_verdict = rows.case.map(worst_verdicts)
    rows = rows[(worst_verdict == verdict) & (rows.verdict == verdict)]
    if rows.empty:
        return ""
    case_evidence = rows.groupby("case", sort=False).of_runs
    is_confirmed = case_evidence.all() if verdict == "met" else case_evidence.any()
    is_partly_confirmed = case_evidence.any()[~is_confirmed]
    return say(
        "evidence",
        by_runs=int(is_confirmed.sum()),
        others=len(is_partly_confirmed),
        in_part=bool(is_partly_confirmed.any()),
    )


def _deciding_cases(tables: Tables, frame: pd.DataFrame) -> list[Block]:
    """Return the worst case, the compliant case with the smallest margin, and the best case."""
    sentences = []
    for case, role in key_cases(tables).items():
        rows = frame[frame.case == case]
        row = rows.loc[rows.margin_ratio.idxmin()]
        estimate = with_unit(row.estimate, row.unit)
        limit = with_unit(row.limit, row.unit)
        margin = _signed_margin(row)
        sentences.append(f"{_ROLES[role]}: {case} ({margin}, {estimate} of {limit})")
    if not sentences:
        return []
    return [Text(f"{'; '.join(sentences)}.", "Margins.")]


def _signed_margin(row: Any, as_multiple: bool | None = None) -> str:
    """Return a margin with the sign of its verdict.

    as_multiple : Whether to write the error as a multiple of the limit; by default from `_MULTIPLE` on.
    """
    sign = SIGNS[row.verdict]
    if pd.isna(row.margin_ratio):
        return sign
    error_ratio = 1.0 - row.margin_ratio
    if as_multiple is None:
        as_multiple = error_ratio >= _MULTIPLE
    if as_multiple:
        return f"{sign} {number(error_ratio)} times the limit"
    return f"{sign} {100.0 * row.margin_ratio:+.0f} %"


def _matrix(tables: Tables, frame: pd.DataFrame) -> Block:
    """Return the matrix of cases by requirements, smallest margin first.

    Columns: margins, consistency of the filter, worst error around events, and the errors that rank the cases.
    """
    names = list(dict.fromkeys(frame.requirement))
    is_by_covariance = bool((frame.by == COVARIANCE).all())
    has_multiple = {}
    for name, rows in frame.groupby("requirement"):
        error_ratio = 1.0 - rows.margin_ratio
        has_multiple[name] = bool((error_ratio >= _MULTIPLE).any())
    margins = {}
    for row in frame.itertuples():
        margin = _signed_margin(row, has_multiple[row.requirement])
        margins[row.case, row.requirement] = margin + mark(row.by, is_by_covariance)

    ranking = METRICS["ranking"](tables).set_index("case")
    quantities = [name for name in ("velocity", "position", "attitude") if name in ranking]
    filters = filter_cells(tables)
    windows = window_cells(tables)
    lines = []
    for case in dict.fromkeys(frame.case):
        line = [case]
        line += [margins.get((case, name), "") for name in names]
        line.append(filters[case])
        line += [cells.get(case, "–") for cells in windows.values()]
        line += [number(ranking.at[case, name]) for name in quantities]
        lines.append(tuple(line))

    units = [f"{name} ({ranking[f'{name}_unit'].iloc[0]})" for name in quantities]
    requirements = tables.campaign.get("requirements") or ()
    events = [words(requirement["at"]) for requirement in requirements if requirement.get("at")]
    matrix_text = str(lines)
    caption = say(
        "matrix",
        required=_requirements_sentence(tables, frame),
        has_multiples=any(has_multiple.values()),
        signs=[f"{sign} {verdict}" for verdict, sign in SIGNS.items() if (frame.verdict == verdict).any()],
        by_covariance=is_by_covariance,
        marks=[f"{sign} {RESTS_ON[evidence]}" for evidence, sign in MARKS.items() if sign in matrix_text],
        moments=list(dict.fromkeys(events)),
        has_windows=bool(windows),
        event=words(METRICS["ranking"](tables).event.iloc[0]),
    )
    return Table(
        head=("design", *names, "filter consistent over the run?", *windows, *units),
        rows=tuple(lines),
        numeric=(False,) + (True,) * len(names) + (False,) + (True,) * (len(windows) + len(quantities)),
        caption=caption,
    )


def _requirements_sentence(tables: Tables, frame: pd.DataFrame) -> str:
    """Return the requirements as a sentence: limit, place and share of flights; empty if there are too many."""
    requirements = tables.campaign.get("requirements") or ()
    if not requirements or len(requirements) > _FEW:
        return ""
    limits = {}
    for row in frame.dropna(subset="limit").itertuples():
        limits[row.requirement] = with_unit(row.limit, row.unit)
    facts = []
    for requirement in requirements:
        name = requirement["name"]
        facts.append(
            {
                "name": name,
                "limit": limits.get(name, requirement["below"]),
                "place": place_text(requirement),
                "probability": float(requirement["probability"]),
            }
        )
    return say("required", requirements=facts)


def _limit_warning(tables: Tables) -> list[Block]:
    """Return a warning if cards permit trajectories outside validated limits, which a reader should not overlook."""
    lines = tables.manifest.get("beyond_limits", [])
    if not lines:
        return []
    return [Text(f"{'; '.join(lines)}. All results below depend on it.", "Outside validated limits:")]


def _extent(tables: Tables) -> str:
    """Return the number of cases and runs, and of failed runs, as a sentence."""
    cases = tables.cases
    failed_count = int(cases.failed_count.sum())
    return say(
        "extent",
        cases=len(cases),
        runs=int(cases.run_count.sum()),
        least=int(cases.run_count.min()),
        most=int(cases.run_count.max()),
        failed=failed_count,
        first=tables.runs.t_failed_s.min() if failed_count else math.nan,
    )


def _ranking(tables: Tables) -> Block:
    """Return the table of the cases in the order of their errors, with intervals."""
    frame = METRICS["ranking"](tables)
    frame = frame.assign(failed=frame.case.map(tables.cases.set_index("label").failed_count))
    columns = ["case | runs = run_count"]
    remark = ""
    if frame.failed.any():
        columns.append("failed")
        remark = " Runs that failed before this event are excluded."
    for quantity in ("velocity", "position", "attitude"):
        if quantity not in frame:
            continue
        unit = frame[f"{quantity}_unit"].iloc[0]
        blanks = " " * len(columns)  # headings of a frame are unique: blanks of different length
        columns.append(f"{quantity} ({unit}) = {quantity}")
        columns.append(f"95 % interval{blanks} = {quantity}_low to {quantity}_high: number")
    caption = f"Ranking: 3D RMS error at {words(frame.event.iloc[0])}, best velocity first.{remark}"
    ranking = table(frame, caption, " | ".join(columns))
    return ranking._replace(head=tuple(name.rstrip() for name in ranking.head))


def _agreement(tables: Tables) -> list[str]:
    """Return sentences on the agreement of runs and linear covariance."""
    cases = by_case(tables)
    tested_cases = cases[cases.verdict.isin(["agree", "disagree"])]
    sentences = []
    if len(tested_cases):
        differing = tested_cases[tested_cases.verdict == "disagree"]
        disagreements = []
        for row in differing.itertuples():
            disagreements.append(say("disagreement", case=row.case, row=row._asdict()))
        level = float(tested_cases.alpha_ratio.iloc[0])
        sentences.append(say("agreement", tested=len(tested_cases), level=level, bad=disagreements))
    reasons = []
    inapplicable = cases[cases.verdict == "not applicable"]
    for reason, rows in inapplicable.groupby("reason", sort=False):
        labels = join_texts(list(rows.case), 2 * _FEW)
        reasons.append(f"{labels} ({reason})")
    if reasons:
        sentences.append(f"Not applicable: {'; '.join(reasons)}.")
    return sentences
