"""report.html (one file, nothing from the network), report.md with its figures, and the CSV tables."""

import base64
import difflib
import hashlib
from collections.abc import Sequence
from pathlib import Path

from lvnav_trade.errors import InputError, writing
from lvnav_trade.metrics import CSV, METRICS
from lvnav_trade.report import curves, evidence, flight
from lvnav_trade.report import diagnostics as explained
from lvnav_trade.report import models as registered
from lvnav_trade.report.blocks import Block, Blocks, Picture, Section, Text
from lvnav_trade.report.escape import csv_text, render, source
from lvnav_trade.report.summary import summary
from lvnav_trade.store.contents import owned
from lvnav_trade.store.read import Tables, load


def _agreement(tables: Tables) -> list[Block]:
    return evidence.agreement(tables) + explained.spot_check(tables) + explained.nonlinearity(tables)


SECTIONS: dict[str, tuple[str, Blocks]] = {
    "summary": ("Answer", summary),
    "requirements": ("Requirements", evidence.requirements),
    "curves": ("Curves", curves.curves),
    "trajectory": ("Trajectory", evidence.trajectory),
    "envelopes": ("Errors", evidence.envelopes),
    "consistency": ("Consistency", evidence.consistency),
    "agreement": ("Monte Carlo against linear covariance", _agreement),
    "satellites": ("Satellites", evidence.satellites),
    "tracking": ("Tracking", evidence.tracking),
    "logic": ("The filter's logic", evidence.logic),
    "delays": ("Delays and latency", evidence.delays),
    "outages": ("Outages", evidence.outages),
    "references": ("Published numbers", evidence.references),
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
_WHERE_ANY = (
    "spot_check",
    "transitions",
    "logic",
    "motion",
    "nozzle",
    "turning",
    "allan",
    "models",
    "curves",
    "crossings",
    "tornado",
)
"""CSV tables that are written only where they have rows."""


def build(folder: Path | str, sections: Sequence[str] | None = None) -> Path:
    """Write report.html, report.md, figures/ and the CSV tables into a results folder; return the page.

    `sections` or else the campaign's ``report: {sections: [...]}`` choose and order the sections; InputError names one
    that does not exist.
    """
    tables = load(folder)
    stated = (tables.campaign.get("report") or {}).get("sections")
    names = list(sections or stated or SECTIONS)
    _check(names)
    place = owned(tables.folder, "results")
    made = [Section(name, SECTIONS[name][0], SECTIONS[name][1](tables)) for name in names]
    if sections or stated:
        made = [section._replace(blocks=section.blocks or [Text("Nothing to show.")]) for section in made]
    made = [section for section in made if section.blocks]
    title = str(tables.manifest.get("campaign") or tables.campaign.get("name"))
    asked = str(tables.campaign.get("description") or "")
    frames = {name: METRICS[name](tables) for name in CSV} | {"models": registered.evidence(tables)}
    csv = {f"{name}.csv": csv_text(frame) for name, frame in frames.items() if len(frame) or name not in _WHERE_ANY}
    pages = {"report.html": _html_page(title, asked, made), "report.md": markdown_page(title, asked, made)}
    place.publish("report", {**csv, **pictures(made), **pages})
    return tables.folder / "report.html"


def _html_page(title: str, asked: str, sections: Sequence[Section]) -> str:
    style, script = source("page.css"), source("grades.js")
    allowed = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    page = {"title": title, "asked": asked, "sections": sections}
    return render("page.html.j2", **page, style=style, script=script, allowed=allowed)


def markdown_page(title: str, asked: str, sections: Sequence[Section]) -> str:
    """Return the Markdown page of a title, the question and sections."""
    return render("page.md.j2", title=title, asked=asked, sections=sections)


def keep(results: Path | str, folder: Path | str) -> Path:
    """Copy what a repository keeps of a report into a folder, and return its Markdown page: page, figures, CSV tables.

    What an earlier report left there is replaced, and no other file; the HTML page is remade from results, not kept.
    """
    built, target = owned(load(results).folder, "results"), owned(folder, "report")
    names = [name for name in built.listed("report") if name != "report.html"]
    if "report.md" not in names:
        raise InputError(f"{built.folder}: no report here; lvnav-trade report {built.folder} builds it")
    with writing(folder, "the report cannot be kept there"):
        target.publish("report", {name: built.place(name).read_bytes() for name in names})
    return target.folder / "report.md"


def _check(names: Sequence[str]) -> None:
    for name in names:
        if name not in SECTIONS:
            near = difflib.get_close_matches(name, SECTIONS, 1)
            hint = f" (did you mean {near[0]}?)" if near else f"; there are {', '.join(SECTIONS)}"
            raise InputError(f"report.sections: no section {name!r}{hint}")


def pictures(sections: Sequence[Section]) -> dict[str, bytes]:
    """Return the pictures of a Markdown page: file name and PNG."""
    blocks = [block for section in sections for block in section.blocks]
    return {f"figures/{block.name}.png": block.png for block in blocks if isinstance(block, Picture)}
