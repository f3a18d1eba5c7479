"""report.html (one file, nothing from the network) and CSV tables; report.md with its figures, for a repository."""

import base64
import difflib
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from lvnav_trade.errors import InputError, writing
from lvnav_trade.metrics import CSV, METRICS
from lvnav_trade.report import curves, evidence, flight, integrity
from lvnav_trade.report import diagnostics as explained
from lvnav_trade.report import models as registered
from lvnav_trade.report.blocks import Block, Blocks, Grades, More, Picture, Section, Table, Text, chosen_cases
from lvnav_trade.report.escape import csv_text, render, source
from lvnav_trade.report.summary import SIGNS, answers, summary
from lvnav_trade.store.contents import owned
from lvnav_trade.store.read import Tables, load


def _agreement(tables: Tables) -> list[Block]:
    return evidence.agreement(tables) + explained.spot_check(tables) + explained.nonlinearity(tables)


def _requirements(tables: Tables) -> list[Block]:
    return answers(tables) + evidence.requirements(tables)


SECTIONS: dict[str, tuple[str, Blocks]] = {
    "summary": ("Answer", summary),
    "requirements": ("Requirements", _requirements),
    "pareto": ("Cost and performance", curves.pareto),
    "curves": ("Curves", curves.curves),
    "trajectory": ("Trajectory", evidence.trajectory),
    "envelopes": ("Errors", evidence.envelopes),
    "consistency": ("Consistency", evidence.consistency),
    "agreement": ("Monte Carlo against linear covariance", _agreement),
    "satellites": ("Satellites", evidence.satellites),
    "tracking": ("Tracking", evidence.tracking),
    "logic": ("The filter's logic", evidence.logic),
    "integrity": ("Faults found", integrity.integrity),
    "delays": ("Delays and latency", evidence.delays),
    "outages": ("Outages", evidence.outages),
    "references": ("Published numbers", evidence.references),
    "exclusions": ("Inertial units excluded", flight.exclusions),
    "protection": ("Protection levels", flight.protection),
    "orbit": ("Orbit at injection", flight.orbit),
    "impact": ("Point of impact", flight.impact),
    "budget": ("Error budget", explained.budget),
    "grades": ("What a better sensor is worth", explained.grades),
    "motion": ("Rate and acceleration", flight.motion),
    "control": ("The vehicle under control", flight.control),
    "allan": ("Inertial units", flight.allan),
    "observability": ("Observability", explained.observability),
    "models": ("What checks these models", registered.models),
    "reproduce": ("How to reproduce", evidence.reproduce),
}
"""Every section by name, in the order in which they stand unless the campaign says otherwise; one that has nothing to
show stands on the page only where it was asked for by name.
"""
OPEN = ("summary", "requirements", "envelopes", "budget")
"""Sections that the page shows at once; the others are one click away, and a brief report leaves them out."""
_BRIEF_ROWS, _BRIEF_FIGURES = 15, 9  # of a table, and in all, of a brief report
_SCRIPTS = ("uplot/uPlot.iife.min.js", "figures.js", "page.js", "grades.js")
_MANY = 50
_DETAILED = ("orbit", "correction", "impact")
"""Sections and tables whose numbers take a second a case; of more than `_MANY` cases they hold the first few."""
_WHERE_ANY = (
    "spot_check",
    "transitions",
    "logic",
    "integrity",
    "tested_errors",
    "motion",
    "nozzle",
    "turning",
    "allan",
    "protection",
    "exclusions",
    "models",
    "curves",
    "crossings",
    "tornado",
    "totals",
    "pareto",
)
"""CSV tables that are written only where they have rows."""


class Made(NamedTuple):
    """What a report says, before it is written in a form: title, question, sections, CSV tables by file name."""

    title: str
    asked: str
    sections: list[Section]
    csv: dict[str, str]


def make(tables: Tables, sections: Sequence[str] | None = None, step: Callable[[], None] = lambda: None) -> Made:
    """Return the report of results: `sections`, or else those of the campaign's ``report: {sections: [...]}``.

    `step` is called after each. InputError names a section that does not exist.
    """
    # sections look at cells one by one: texts as Python's own strings are read in half the time of Arrow's
    with pd.option_context("mode.string_storage", "python"):
        return _made(tables, sections, step)


def _made(tables: Tables, sections: Sequence[str] | None, step: Callable[[], None]) -> Made:
    stated = (tables.campaign.get("report") or {}).get("sections")
    names = list(sections or stated or SECTIONS)
    _check(names)
    made = []
    detailed = _detailed(tables)
    for name in names:
        made.append(Section(name, SECTIONS[name][0], SECTIONS[name][1](detailed if name in _DETAILED else tables)))
        step()
    if sections or stated:
        made = [section._replace(blocks=section.blocks or [Text("Nothing to show.")]) for section in made]
    title = str(tables.manifest.get("campaign") or tables.campaign.get("name"))
    frames = {name: METRICS[name](detailed if name in _DETAILED else tables) for name in CSV}
    frames |= {"models": registered.evidence(tables)}
    csv = {f"{name}.csv": csv_text(frame) for name, frame in frames.items() if len(frame) or name not in _WHERE_ANY}
    asked = str(tables.campaign.get("description") or "")
    return Made(title, asked, [section for section in made if section.blocks], csv)


def _detailed(tables: Tables) -> Tables:
    """Return the results, of many cases only those that decide and the best ones."""
    if len(tables.labels) <= _MANY:
        return tables
    return tables.with_frames(cases=tables.cases[tables.cases.case.isin(chosen_cases(tables))])


def build(
    folder: Path | str,
    sections: Sequence[str] | None = None,
    figures: Sequence[str] = (),
    brief: bool = False,
    step: Callable[[], None] = lambda: None,
) -> Path:
    """Write report.html and the CSV tables into a results folder; return the page.

    figures: formats (png, svg) of the figures that are written into figures/ too; brief: a page for ten sheets of
    paper, without what report.html shows on demand, is written as brief.html too, and returned.
    InputError as of `make`.
    """
    tables = load(folder)
    made = make(tables, sections, step)
    pages = {"report.html": html_page(made.title, made.asked, made.sections)}
    if brief:
        pages["brief.html"] = html_page(made.title, made.asked, _shortened(made.sections))
    owned(tables.folder, "results").publish("report", {**made.csv, **pictures(made.sections, figures), **pages})
    return tables.folder / ("brief.html" if brief else "report.html")


def _shortened(sections: Sequence[Section]) -> list[Section]:
    """Return the open sections without what is shown on demand, and the first rows and figures of what is long."""
    left = _BRIEF_FIGURES

    def short(block: Block) -> list[Block]:
        nonlocal left
        if isinstance(block, Table) and len(block.rows) > _BRIEF_ROWS:
            note = Text(f"{len(block.rows) - _BRIEF_ROWS} more rows stand in the full report.")
            return [block._replace(rows=block.rows[:_BRIEF_ROWS]), note]
        left -= isinstance(block, Picture)
        return [] if isinstance(block, More | Grades) or (isinstance(block, Picture) and left < 0) else [block]

    return [
        section._replace(blocks=[found for block in section.blocks for found in short(block)])
        for section in sections
        if section.name in OPEN
    ]


def html_page(title: str, asked: str, sections: Sequence[Section]) -> str:
    """Return the HTML page of a title, the question and sections, in one file."""
    style = source("page.css") + source("uplot/uPlot.min.css")
    script = "\n".join(source(name) for name in _SCRIPTS)
    allowed = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    signs = {sign: verdict for verdict, sign in SIGNS.items() if sign != "–"}  # a dash stands for a missing number too
    page = {"title": title, "asked": asked, "sections": sections, "open": {*OPEN, sections[0].name}}
    page |= {"signs": signs, "verdicts": {*SIGNS, "agree", "disagree"}}
    return render("page.html.j2", **page, style=style, script=script, allowed=allowed)


def markdown_page(title: str, asked: str, sections: Sequence[Section]) -> str:
    """Return the Markdown page of a title, the question and sections."""
    return render("page.md.j2", title=title, asked=asked, sections=sections)


def keep(results: Path | str, folder: Path | str, tables: bool = True) -> Path:
    """Write what a repository keeps of a report into a folder, and return its Markdown page: page, figures, CSV tables
    unless these are not wanted.

    What an earlier report left there is replaced, and no other file; the HTML page is remade from results, not kept.
    """
    target, made = owned(folder, "report"), make(load(results))
    page = markdown_page(made.title, made.asked, made.sections)
    with writing(folder, "the report cannot be kept there"):
        target.publish("report", {**(made.csv if tables else {}), **pictures(made.sections), "report.md": page})
    return target.folder / "report.md"


def _check(names: Sequence[str]) -> None:
    for name in names:
        if name not in SECTIONS:
            near = difflib.get_close_matches(name, SECTIONS, 1)
            hint = f" (did you mean {near[0]}?)" if near else f"; there are {', '.join(SECTIONS)}"
            raise InputError(f"report.sections: no section {name!r}{hint}")


def pictures(sections: Sequence[Section], formats: Sequence[str] = ("png",)) -> dict[str, bytes]:
    """Return the figures of sections as files, drawn by worker processes: names within figures/, and contents."""
    if not formats:
        return {}
    from lvnav_trade.plots.raster import files  # matplotlib, which a report as HTML does not need

    blocks = [block for section in sections for block in section.blocks]
    blocks += [inner for block in blocks if isinstance(block, More) for inner in block.blocks]
    figures = {f"figures/{block.name}": block.figure for block in blocks if isinstance(block, Picture)}
    return files(figures, formats)
