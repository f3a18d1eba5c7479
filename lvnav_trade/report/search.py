"""Pages of searches: inverse questions, sensitivity indices, tuning; Markdown, HTML, figures and CSV in one folder."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from lvnav_trade.quantities.errors import writing
from lvnav_trade.report.blocks import Block, Picture, Section, Text, table
from lvnav_trade.report.build import html_page, markdown_page, pictures
from lvnav_trade.report.escape import csv_text, note
from lvnav_trade.report.figures import space as plots
from lvnav_trade.report.sentences import say
from lvnav_trade.results.evaluation.covariances import NOT_APPLICABLE
from lvnav_trade.results.tables.contents import owned

_FEW = 6  # answers that are said in a line each


def write(
    folder: Path | str,
    title: str,
    asked: str,
    blocks: Sequence[Block],
    frames: Mapping[str, pd.DataFrame],
    files: Mapping[str, str] | None = None,
) -> Path:
    """Write a page, its tables and other files into a folder of the tool's own; return the page. InputError for another
    folder.
    """
    sections = [Section("search", "Result", list(blocks))]
    pages = {"report.md": markdown_page(title, asked, sections), "report.html": html_page(title, asked, sections)}
    csv = {f"{name}.csv": csv_text(frame) for name, frame in frames.items() if len(frame)}
    with writing(folder, "the report cannot be written there"):
        owned(folder, "report").publish("report", {**csv, **pictures(sections), **pages, **(files or {})})
    return Path(folder) / "report.md"


def solved(
    answers: pd.DataFrame, intervals: pd.DataFrame, scanned: pd.DataFrame, confirmed: pd.DataFrame, names: Sequence[str]
) -> list[Block]:
    """Return what an inverse question found; names: of the fields that were varied."""
    shown = answers.drop(columns=["evaluations"])
    two = bool(answers.along.notna().any())
    if not two:
        shown = shown.drop(columns=["along", "along_unit"])
    found: list[Block] = [Text(_answer(one, names), "") for one in answers.itertuples()] if len(answers) <= _FEW else []
    found += [Text(note("solve")), table(_words(shown), f"Largest {names[0]} that meets the requirements.")]
    if not answers.monotone.all():
        found.append(table(_words(intervals), "Not monotone: the intervals in which the requirements are met."))
    if two:
        found.append(Picture("boundary", plots.boundary(answers, names), note("boundary", "figures")))
    else:
        found.append(Picture("solve", plots.ratios(scanned, answers, names[0]), note("solve", "figures")))
    if len(confirmed):
        found += [Text(note("solve_confirmed")), table(_words(confirmed), "Runs on both sides of each answer.")]
    return found


def _words(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.rename(columns=lambda name: name.replace("_", " "))


def _answer(row: Any, names: Sequence[str]) -> str:
    """Say one answer: the value, what it is the largest of, and what binds."""
    _, is_outside, why = row.remark.partition(NOT_APPLICABLE)
    return say(
        "largest",
        case=", ".join(part for part in (row.case, row.tuning) if part != "base"),
        at=f"{names[1]} = {row.along:.4g} {row.along_unit}" if row.along == row.along else "",
        field=names[0],
        value=f"{row.answer:.4g} {row.unit}" if row.answer == row.answer else "",
        remark=row.remark,
        binding=row.binding,
        is_monotone=row.monotone,
        outside=f"{NOT_APPLICABLE.capitalize()}{why}" if is_outside else "",
    )


def chosen(answers: pd.DataFrame, confirmed: pd.DataFrame, least: str) -> list[Block]:
    """Return which case meets the requirements with the least of a total (its column)."""
    best, name = answers[answers.chosen], least.split("_")[0]
    if len(best):
        one = best.iloc[0]
        said = f"{one.case}: {name} {one[least]:g}, error over limit {one.error_ratio:.3g} (largest: {one.binding})."
        lead = f"Least {name} that meets the requirements:"
    else:
        said, lead = "", "No case meets the requirements."
    found: list[Block] = [Text(said, lead), table(_words(answers), f"All cases, smallest {name} first.")]
    if len(confirmed):
        caption = "Runs of the chosen case, and of the next cheaper one, which does not meet the requirements."
        found += [Text(note("solve_confirmed")), table(_words(confirmed), caption)]
    return found


def indexed(
    frame: pd.DataFrame, case: str, error: str, covered: float, predicted: float, samples: int, remark: str = ""
) -> list[Block]:
    """Return sensitivity indices, how much of the mean square they are of and how well the surrogate predicts."""
    order = frame.sort_values("retuned_total", ascending=False).iloc[:3]
    said = "; ".join(
        f"{one.source} {one.retuned_total:.2f} +- {one.retuned_total_half_width:.2f} (frozen {one.frozen_total:.2f})"
        for one in order.itertuples()
    )
    about = (
        f"{error.replace('_', ' ')}, case {case}: the sources contribute {100 * covered:.3g} % of the mean square. "
        f"A fit to {samples} re-tuned designs does not predict {100 * (1 - predicted):.2g} % of the variance of other "
        "designs."
    )
    drawn = Picture("indices", plots.indices(frame), note("indices", "figures"))
    lead = "Largest total indices, filter re-tuned:"
    warning = [Text(f"{remark}.", "Linear covariance:")] if remark else []
    return [Text(f"{said}.", lead), *warning, Text(about), Text(note("indices")), table(_words(frame)), drawn]


def tuned(values: pd.DataFrame, cases: pd.DataFrame, source: str) -> list[Block]:
    """Return the numbers of a tuned filter, what they do in every case, those held out too, and its card's source."""
    found: list[Block] = [Text(_tuning(cases), "Error over its limit:")]
    numbers = table(_words(values), "The filter's numbers.")
    return [
        *found,
        Text(note("tune")),
        numbers,
        table(_words(cases), "Every case, before and after."),
        Text(source, "The card filter.yaml states its source:"),
    ]


def _tuning(cases: pd.DataFrame) -> str:
    """Say what tuning did to the worst of the cases that had a part in it, and to those held out."""
    said = []
    for role, rows in cases.groupby("role", sort=False):
        before, after = rows.ratio_before.max(), rows.ratio_after.max()
        said.append(f"{role}, worst of {len(rows)}: {before:.3g} before, {after:.3g} after")
    return "; ".join(said) + "."
