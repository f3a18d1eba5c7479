"""Pages of searches: inverse questions, sensitivity indices, tuning; Markdown, HTML, figures and CSV in one folder."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from lvnav_trade.errors import writing
from lvnav_trade.plots import search as plots
from lvnav_trade.report.blocks import Block, Picture, Section, Text, table
from lvnav_trade.report.build import html_page, markdown_page, pictures
from lvnav_trade.report.escape import csv_text, note
from lvnav_trade.store.contents import owned


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


def solved(answers: pd.DataFrame, scanned: pd.DataFrame, confirmed: pd.DataFrame, names: Sequence[str]) -> list[Block]:
    """Return what an inverse question found; names: of the fields that were varied."""
    shown = answers.drop(columns=["evaluations"]).rename(columns=lambda name: name.replace("_", " "))
    if not answers.along.notna().any():
        shown = shown.drop(columns=["along", "along unit"])
    found: list[Block] = [Text(note("solve")), table(shown, f"Largest {names[0]} that meets the requirements.")]
    if answers.along.notna().any():
        found.append(Picture("boundary", plots.boundary(answers, names), note("boundary", "figures")))
    else:
        found.append(Picture("solve", plots.ratios(scanned, answers, names[0]), note("solve", "figures")))
    if len(confirmed):
        found += [Text(note("solve_confirmed")), table(confirmed, "Runs on both sides of each answer.")]
    return found


def indexed(frame: pd.DataFrame, case: str, error: str, covered: float, predicted: float, samples: int) -> list[Block]:
    """Return sensitivity indices, how much of the mean square they are of and how well the polynomials predict."""
    said = (
        f"{error.replace('_', ' ')}, case {case}: they make {100 * covered:.3g} % of the mean square. Polynomials "
        f"of {samples} re-tuned designs leave {100 * (1 - predicted):.2g} % of the variance of those left out."
    )
    drawn = Picture("indices", plots.indices(frame), note("indices", "figures"))
    return [Text(said), Text(note("indices")), table(frame.rename(columns=lambda name: name.replace("_", " "))), drawn]


def tuned(values: pd.DataFrame, cases: pd.DataFrame) -> list[Block]:
    """Return the numbers of a tuned filter and what they do in every case, those held out too."""
    shown = cases.rename(columns=lambda name: name.replace("_", " "))
    return [Text(note("tune")), table(values, "The filter's numbers."), table(shown, "Every case, before and after.")]
