"""Building of reports: report.html (one self-contained file), CSV tables, and report.md with figures."""

import base64
import difflib
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.report import assumptions, diagnostics, evidence, flight, models, satellites, space
from lvnav_trade.report.answers import answers
from lvnav_trade.report.blocks import (
    Block,
    Blocks,
    DesignExplorer,
    Details,
    Picture,
    Section,
    SourceScaling,
    Table,
    Text,
)
from lvnav_trade.report.document import Head, head, stated_requirements, title_of
from lvnav_trade.report.escape import csv_text, render, source
from lvnav_trade.report.figures.style import share_scales
from lvnav_trade.report.selection import chosen_cases
from lvnav_trade.report.summary import SIGNS, summary
from lvnav_trade.results.evaluation import CSV, METRICS
from lvnav_trade.results.statistics.display_units import with_case_names
from lvnav_trade.results.tables.contents import owned_folder
from lvnav_trade.results.tables.read import Tables, load


def _agreement(tables: Tables) -> list[Block]:
    return evidence.agreement(tables) + diagnostics.spot_check(tables) + diagnostics.nonlinearity(tables)


def _requirements(tables: Tables) -> list[Block]:
    return stated_requirements(tables) + answers(tables) + evidence.windows(tables) + evidence.requirements(tables)


SECTIONS: dict[str, tuple[str, Blocks]] = {
    "space": ("All designs", space.space),
    "summary": ("Answer", summary),
    "requirements": ("Requirements", _requirements),
    "pareto": ("Cost and performance", space.pareto),
    "curves": ("Curves", space.curves),
    "trajectory": ("Trajectory", evidence.trajectory),
    "envelopes": ("Errors", evidence.envelopes),
    "consistency": ("Consistency", evidence.consistency),
    "agreement": ("Monte Carlo against linear covariance", _agreement),
    "satellites": ("Satellites", satellites.satellites),
    "tracking": ("Tracking", satellites.tracking),
    "logic": ("Mode logic of the filter", evidence.logic),
    "integrity": ("Fault detection", diagnostics.integrity),
    "delays": ("Delays and latency", satellites.delays),
    "outages": ("Outages", evidence.outages),
    "references": ("Published numbers", evidence.references),
    "exclusions": ("Excluded IMUs", flight.exclusions),
    "protection": ("Protection levels", flight.protection),
    "injection": ("Injection accuracy", flight.injection),
    "orbit": ("Orbit at injection", flight.orbit),
    "impact": ("Point of impact", flight.impact),
    "budget": ("Error budget", diagnostics.budget),
    "grades": ("Benefit of better sensors", diagnostics.grades),
    "motion": ("Rate and acceleration", flight.motion),
    "control": ("Vehicle under attitude control", flight.control),
    "allan": ("Allan deviation of the IMUs", flight.allan),
    "observability": ("Observability", diagnostics.observability),
    "configuration": ("Configuration", assumptions.configuration),
    "assumptions": ("Assumptions", assumptions.assumptions),
    "models": ("Validation of the models", models.models),
    "reproduce": ("How to reproduce", evidence.reproduce),
}
"""All sections by name, in their default order. An empty section is shown only if the campaign names it."""
OPEN = ("space", "summary", "requirements", "envelopes", "budget")
"""Sections that are open in the report; the others are folded."""
BRIEF = (*OPEN, "consistency", "agreement", "configuration", "assumptions", "models", "reproduce")
"""Sections of a brief report."""
_BRIEF_ROWS = 15  # largest number of rows of a table in a brief report
_BRIEF_FIGURES = 9  # largest number of figures in a brief report
_SCRIPTS = ("uplot/uPlot.iife.min.js", "figures.js", "page.js", "grades.js", "space.js")
_MOST_FULL_CASES = 50
_DETAILED = ("orbit", "orbit_correction", "impact")
"""Sections and tables that take a second per case; above `_MOST_FULL_CASES` cases they cover the key cases only."""


class ReportContent(NamedTuple):
    """Content of a report, independent of its format."""

    title: str
    question: str  # question of the campaign
    sections: list[Section]
    csv: dict[str, str]  # CSV tables by file name
    head: Head = ()  # title block


def make(
    tables: Tables, sections: Sequence[str] | None = None, step: Callable[[], None] = lambda: None
) -> ReportContent:
    """Return the content of the report of results.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    sections : sequence of str, optional
        Names of the sections; by default those of the campaign, or else all.
    step : callable
        Called after each section.

    Returns
    -------
    ReportContent
        Title, question, sections, CSV tables.

    Raises
    ------
    InputError
        A section does not exist.
    """
    # sections read single cells, for which Python's strings take half the time of Arrow's
    with pd.option_context("mode.string_storage", "python"):
        return _content(tables, sections, step)


def _content(tables: Tables, sections: Sequence[str] | None, step: Callable[[], None]) -> ReportContent:
    """Return the content of the report, with strings converted for fast access to single cells."""
    selection = sections or (tables.campaign.get("report") or {}).get("sections")
    names = list(selection or SECTIONS)
    _check(names)
    title = title_of(tables)
    question = str(tables.campaign.get("description") or "")
    if tables.cases.empty:
        empty_section = Section(names[0], SECTIONS[names[0]][0], _without_cases(tables))
        return ReportContent(title, question, [empty_section], {})
    shown_tables = with_case_names(tables)
    reduced_tables = _reduced_tables(shown_tables)
    content = _sections(shown_tables, reduced_tables, names, step)
    if selection:  # a requested section is shown even if it is empty
        content = [section._replace(blocks=section.blocks or [Text("Nothing to show.")]) for section in content]
    else:
        content = [section for section in content if not all(map(_is_nothing, section.blocks))]
    for section in content:
        share_scales(block.figure for block in _all_blocks(section.blocks) if isinstance(block, Picture))
    return ReportContent(
        title=title,
        question=question,
        sections=[section for section in content if section.blocks],
        csv=_csv_tables(tables, shown_tables, reduced_tables),
        head=head(shown_tables),
    )


def _sections(tables: Tables, reduced_tables: Tables, names: Sequence[str], step: Callable[[], None]) -> list[Section]:
    """Return the sections of these names; `step` is called after each.

    reduced_tables : the results for the sections that take long to build
    """
    sections = []
    for name in names:
        title, blocks = SECTIONS[name]
        sections.append(Section(name, title, blocks(reduced_tables if name in _DETAILED else tables)))
        step()
    return sections


def _csv_tables(tables: Tables, shown_tables: Tables, reduced_tables: Tables) -> dict[str, str]:
    """Return the CSV tables that have rows, by file name, with the labels of the stored results.

    tables : results with their stored labels
    shown_tables : results with the labels of the report
    reduced_tables : results for the tables that take long to compute, with the labels of the report
    """
    frames = {}
    for name in CSV:
        source = reduced_tables if name in _DETAILED else shown_tables
        frames[name] = METRICS[name](source)
    if shown_tables is not tables:
        labels = {shown_tables.labels[case]: label for case, label in tables.labels.items()}
        for name, frame in frames.items():
            if "case" in frame and name != "designs":
                stored_labels = frame.case.map(labels)
                frames[name] = frame.assign(case=stored_labels)
    frames["designs"] = METRICS["designs"](tables)
    frames["models"] = models.evidence(tables)
    return {f"{name}.csv": csv_text(frame) for name, frame in frames.items() if len(frame)}


def _without_cases(tables: Tables) -> list[Block]:
    """Return the blocks of results in which every case failed, with the reasons."""
    text = "No case could be computed, so there are no results. Repeat lvnav-trade run to try again."
    blocks: list[Block] = [Text(text, "Cases.")]
    for line in tables.manifest.get("lost", []):
        blocks.append(Text(f"{line}.", "Lost:"))
    return blocks


def _all_blocks(blocks: Sequence[Block]) -> list[Block]:
    """Return blocks, followed by the blocks that they show on demand."""
    all_blocks = list(blocks)
    for block in blocks:
        if isinstance(block, Details):
            all_blocks += block.blocks
    return all_blocks


def _is_nothing(block: Block) -> bool:
    """Whether a block only says that there is nothing to show."""
    return isinstance(block, Text) and block.is_nothing


def _reduced_tables(tables: Tables) -> Tables:
    """Return the results, reduced to the key cases and the best if there are many cases."""
    if len(tables.labels) <= _MOST_FULL_CASES:
        return tables
    return tables.with_frames(cases=tables.cases[tables.cases.case.isin(chosen_cases(tables))])


def build(
    folder: Path | str,
    sections: Sequence[str] | None = None,
    figures: Sequence[str] = (),
    brief: bool = False,
    step: Callable[[], None] = lambda: None,
) -> Path:
    """Write the report of results: report.html, and the CSV tables that have rows.

    Parameters
    ----------
    folder : Path or str
        Folder of results, to which the report is written.
    sections : sequence of str, optional
        Names of the sections; by default those of the campaign, or else all.
    figures : sequence of str
        Formats (png, svg) of figures to be written to figures/.
    brief : bool
        Also write brief.html, a short report of about ten pages.
    step : callable
        Called after each section.

    Returns
    -------
    Path
        report.html, or brief.html if `brief`.

    Raises
    ------
    InputError
        A section does not exist.
    """
    tables = load(folder)
    content = make(tables, sections, step)
    files: dict[str, str | bytes] = {**content.csv, **pictures(content.sections, figures)}
    files["report.html"] = html_page(content.title, content.question, content.sections, head=content.head)
    if brief:
        brief_sections = _brief_sections(content.sections)
        files["brief.html"] = html_page(content.title, content.question, brief_sections, BRIEF, content.head)
    owned_folder(tables.folder, "results").publish("report", files)
    return tables.folder / ("brief.html" if brief else "report.html")


VERDICTS = ("requirements", "expected_verdicts", "windows", "filter_verdicts")
"""CSV tables that are also written without a report."""


def verdict_tables(folder: Path | str) -> None:
    """Write the CSV tables of verdicts to a folder of results, replacing files of an earlier report."""
    tables = load(folder)
    frames = {name: METRICS[name](tables) for name in VERDICTS}
    files = {f"{name}.csv": csv_text(frame) for name, frame in frames.items() if len(frame)}
    owned_folder(tables.folder, "results").publish("report", files)


def _brief_sections(sections: Sequence[Section]) -> list[Section]:
    """Return the sections of a brief report, without blocks shown on demand, and with long tables shortened."""
    n_figures = 0
    brief_sections = []
    for section in sections:
        if section.name not in BRIEF:
            continue
        blocks: list[Block] = []
        for block in section.blocks:
            if isinstance(block, Table) and len(block.rows) > _BRIEF_ROWS:
                remark = Text(f"{len(block.rows) - _BRIEF_ROWS} more rows are in the full report.")
                blocks += [block._replace(rows=block.rows[:_BRIEF_ROWS]), remark]
            elif isinstance(block, Picture):
                n_figures += 1
                if n_figures <= _BRIEF_FIGURES:
                    blocks.append(block)
            elif not isinstance(block, Details | SourceScaling | DesignExplorer):
                blocks.append(block)
        brief_sections.append(section._replace(blocks=blocks))
    return brief_sections


def html_page(
    title: str, question: str, sections: Sequence[Section], open_sections: Sequence[str] = OPEN, head: Head = ()
) -> str:
    """Return a report as one self-contained HTML file.

    Parameters
    ----------
    title, question : str
        Title, and question of the campaign.
    sections : sequence of Section
        Sections in order.
    open_sections : sequence of str
        Names of sections that are open; the others are folded.
    head : tuple of Line
        Title block below the title.
    """
    script = "\n".join(source(name) for name in _SCRIPTS)
    script_digest = hashlib.sha256(script.encode()).digest()
    return render(
        "page.html.j2",
        title=title,
        question=question,
        sections=sections,
        open={*open_sections, sections[0].name},
        head=head,
        signs={sign: verdict for verdict, sign in SIGNS.items() if sign != "–"},  # a dash is also a missing number
        verdicts={*SIGNS, "agree", "disagree"},
        style=source("page.css") + source("uplot/uPlot.min.css"),
        script=script,
        allowed=base64.b64encode(script_digest).decode(),
    )


def markdown_page(title: str, question: str, sections: Sequence[Section], head: Head = ()) -> str:
    """Return a report as Markdown; the arguments are those of `html_page`."""
    return render("page.md.j2", title=title, question=question, sections=sections, head=head)


def keep(results: Path | str, folder: Path | str, writes_tables: bool = True) -> Path:
    """Write a kept report, for a repository: Markdown, figures, and CSV tables unless these are not wanted.

    Parameters
    ----------
    results : Path or str
        Folder of results.
    folder : Path or str
        Folder of the kept report. Files of an earlier report are replaced, and no other file.
    writes_tables : bool
        Whether to write the CSV tables.

    Returns
    -------
    Path
        report.md.
    """
    target = owned_folder(folder, "report")
    content = make(load(results))
    page = markdown_page(content.title, content.question, content.sections, content.head)
    with writing(folder, "the report cannot be kept there"):
        files: dict[str, str | bytes] = {**pictures(content.sections), "report.md": page}
        if writes_tables:
            files |= content.csv
        target.publish("report", files)
    return target.folder / "report.md"


def _check(names: Sequence[str]) -> None:
    for name in names:
        if name not in SECTIONS:
            matches = difflib.get_close_matches(name, SECTIONS, 1)
            if matches:
                hint = f" (did you mean {matches[0]}?)"
            else:
                hint = f"; there are {', '.join(SECTIONS)}"
            raise InputError(f"report.sections: no section {name!r}{hint}")


def pictures(sections: Sequence[Section], formats: Sequence[str] = ("png",)) -> dict[str, bytes]:
    """Return the figures of sections as files in figures/: content by name. Worker processes draw them."""
    if not formats:
        return {}
    from lvnav_trade.report.figures.raster import files  # matplotlib, which a report as HTML does not need

    figures = {}
    for section in sections:
        for block in _all_blocks(section.blocks):
            if isinstance(block, Picture):
                figures[f"figures/{block.name}"] = block.figure
    return files(figures, formats)
