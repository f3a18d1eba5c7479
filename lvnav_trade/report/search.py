"""Reports on searches: inverse problems, sensitivity indices, tuning; Markdown, HTML, figures and CSV in one folder."""

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
from lvnav_trade.results.tables.contents import owned_folder

_FEW = 6  # up to this number of solutions, each gets a sentence


def write(
    folder: Path | str,
    title: str,
    question: str,
    blocks: Sequence[Block],
    frames: Mapping[str, pd.DataFrame],
    files: Mapping[str, str] | None = None,
) -> Path:
    """Write the report of a search into a separate folder.

    Parameters
    ----------
    folder : Path or str
        Folder of the report. Files of an earlier search report are replaced.
    title : str
        Title of the report.
    question : str
        Question of the search.
    blocks : sequence of Block
        Content.
    frames : mapping
        Frames by name; those with rows become CSV tables.
    files : mapping, optional
        Further text files by name.

    Returns
    -------
    Path
        The Markdown report.

    Raises
    ------
    InputError
        The folder has other content.
    """
    sections = [Section("search", "Result", list(blocks))]
    pages = {"report.md": markdown_page(title, question, sections), "report.html": html_page(title, question, sections)}
    csv = {f"{name}.csv": csv_text(frame) for name, frame in frames.items() if len(frame)}
    with writing(folder, "the report cannot be written there"):
        owned_folder(folder, "report").publish("report", {**csv, **pictures(sections), **pages, **(files or {})})
    return Path(folder) / "report.md"


def solution_blocks(
    answers: pd.DataFrame,
    intervals: pd.DataFrame,
    evaluations: pd.DataFrame,
    confirmation: pd.DataFrame,
    names: Sequence[str],
) -> list[Block]:
    """Return the blocks on the solutions of an inverse problem.

    The tables are those of `campaign.search.solve.InverseSolution`.

    Parameters
    ----------
    answers : pandas.DataFrame
        Largest value of the first field that meets the requirements, by case, tuning and value of the second field.
    intervals : pandas.DataFrame
        Intervals in which the requirements are met, shown if a solution is not monotone.
    evaluations : pandas.DataFrame
        All evaluations, for the figure.
    confirmation : pandas.DataFrame
        Confirmation by runs; may be empty.
    names : sequence of str
        Paths of the varied fields, one or two.
    """
    has_curve = bool(answers.along.notna().any())
    columns = ["evaluations"] if has_curve else ["evaluations", "along", "along_unit"]
    rows = answers.drop(columns=columns)
    blocks: list[Block] = []
    if len(answers) <= _FEW:
        blocks += [Text(_answer(solution, names), "") for solution in answers.itertuples()]
    blocks.append(Text(note("solve")))
    blocks.append(table(_words(rows), f"Largest {names[0]} that meets the requirements."))
    if not answers.monotone.all():
        blocks.append(table(_words(intervals), "Not monotone: the intervals in which the requirements are met."))
    if has_curve:
        boundary = plots.boundary(answers, names)
        blocks.append(Picture("boundary", boundary, note("boundary", "figures")))
    else:
        ratios = plots.ratios(evaluations, answers, names[0])
        blocks.append(Picture("solve", ratios, note("solve", "figures")))
    if len(confirmation):
        blocks.append(Text(note("solve_confirmed")))
        blocks.append(table(_words(confirmation), "Runs on both sides of each answer."))
    return blocks


def _words(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.rename(columns=lambda name: name.replace("_", " "))


def _answer(row: Any, names: Sequence[str]) -> str:
    """Return a solution as a sentence: the largest value that meets the requirements, and the limiting requirement."""
    _, is_outside, reason = row.remark.partition(NOT_APPLICABLE)
    has_second_field = not pd.isna(row.along)
    has_value = not pd.isna(row.answer)
    return say(
        "largest",
        case=", ".join(label for label in (row.case, row.tuning) if label != "base"),
        at=f"{names[1]} = {row.along:.4g} {row.along_unit}" if has_second_field else "",
        field=names[0],
        value=f"{row.answer:.4g} {row.unit}" if has_value else "",
        remark=row.remark,
        limiting_requirement=row.limiting_requirement,
        is_monotone=row.monotone,
        outside=f"{NOT_APPLICABLE.capitalize()}{reason}" if is_outside else "",
    )


def least_case_blocks(answers: pd.DataFrame, confirmation: pd.DataFrame, total_column: str) -> list[Block]:
    """Return the blocks on the case that meets the requirements with the smallest total.

    Parameters
    ----------
    answers : pandas.DataFrame
        All cases, smallest total first. Column `chosen` marks the case.
    confirmation : pandas.DataFrame
        Runs of the case and of the next cheaper case; may be empty.
    total_column : str
        Column of the minimised total. Its first word, such as cost or mass, is used in the text.
    """
    name = total_column.split("_")[0]
    best_rows = answers[answers.chosen]
    if len(best_rows):
        row = best_rows.iloc[0]
        ratio = f"error over limit {row.error_ratio:.3g} (largest: {row.limiting_requirement})"
        lead = f"Least {name} that meets the requirements:"
        first = Text(f"{row.case}: {name} {row[total_column]:g}, {ratio}.", lead)
    else:
        first = Text("", "No case meets the requirements.")
    blocks: list[Block] = [first, table(_words(answers), f"All cases, smallest {name} first.")]
    if len(confirmation):
        caption = "Runs of the chosen case, and of the next cheaper one, which does not meet the requirements."
        blocks += [Text(note("solve_confirmed")), table(_words(confirmation), caption)]
    return blocks


def sensitivity_blocks(
    frame: pd.DataFrame,
    case: str,
    error: str,
    covered_share: float,
    predicted_share: float,
    samples: int,
    remark: str = "",
) -> list[Block]:
    """Return sensitivity indices, the share of the mean square that they cover, and the accuracy of the surrogate.

    Parameters
    ----------
    frame : pandas.DataFrame
        Indices of each error source.
    case, error : str
        Label of the case, and name of the error.
    covered_share : float
        Share of the mean square that the sources cover.
    predicted_share : float
        Share of the variance that the surrogate predicts.
    samples : int
        Number of samples.
    remark : str
        Further text.
    """
    largest = []
    for row in frame.sort_values("retuned_total", ascending=False).iloc[:3].itertuples():
        interval = f"{row.retuned_total:.2f} +- {row.retuned_total_half_width:.2f}"
        largest.append(f"{row.source} {interval} (frozen {row.frozen_total:.2f})")
    coverage = (
        f"{error.replace('_', ' ')}, case {case}: these sources contribute {100 * covered_share:.3g} % of the mean "
        "square. The indices divide their effect; all other sources keep their sigmas. "
        f"A fit to {samples} re-tuned designs does not predict {100 * (1 - predicted_share):.2g} % of the variance of "
        "other designs."
    )
    blocks: list[Block] = [Text(f"{'; '.join(largest)}.", "Largest total indices, filter re-tuned:")]
    if remark:
        blocks.append(Text(f"{remark}.", "Linear covariance:"))
    return [
        *blocks,
        Text(coverage),
        Text(note("indices")),
        table(_words(frame)),
        Picture("indices", plots.indices(frame), note("indices", "figures")),
    ]


def tuning_blocks(values: pd.DataFrame, cases: pd.DataFrame, source: str) -> list[Block]:
    """Return the blocks on the tuned parameters of a filter.

    Parameters
    ----------
    values : pandas.DataFrame
        The tuned parameters.
    cases : pandas.DataFrame
        Error over its limit before and after tuning, for every case; `role` separates tuned and validation cases.
    source : str
        Source of the numbers, as written in the filter card.
    """
    return [
        Text(_tuning(cases), "Error over its limit:"),
        Text(note("tune")),
        table(_words(values), "The filter's numbers."),
        table(_words(cases), "Every case, before and after."),
        Text(source, "The card filter.yaml states its source:"),
    ]


def _tuning(cases: pd.DataFrame) -> str:
    """Return the effect of tuning on the worst tuned case and on the worst validation case."""
    sentences = []
    for role, rows in cases.groupby("role", sort=False):
        largest_before = rows.ratio_before.max()
        largest_after = rows.ratio_after.max()
        sentences.append(f"{role}, worst of {len(rows)}: {largest_before:.3g} before, {largest_after:.3g} after")
    return "; ".join(sentences) + "."
