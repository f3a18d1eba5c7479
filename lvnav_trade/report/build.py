"""report.html (one file, nothing from the network), report.md with its figures, and the CSV tables."""

from __future__ import annotations

import base64
import difflib
import hashlib
import re
import shutil
from collections.abc import Callable, Sequence
from importlib import resources
from pathlib import Path

import jinja2

from lvnav_trade.errors import InputError
from lvnav_trade.metrics import CSV, METRICS
from lvnav_trade.report import evidence, explained, mission, reception, steered
from lvnav_trade.report.blocks import Block, Picture, Section, Text
from lvnav_trade.report.summary import summary
from lvnav_trade.store import Tables, load


def _agreement(tables: Tables) -> list[Block]:
    return evidence.agreement(tables) + explained.nonlinearity(tables)


SECTIONS: dict[str, tuple[str, Callable[[Tables], list[Block]]]] = {
    "summary": ("Answer", summary),
    "requirements": ("Requirements", evidence.requirements),
    "trajectory": ("Trajectory", evidence.trajectory),
    "envelopes": ("Errors", evidence.envelopes),
    "consistency": ("Consistency", evidence.consistency),
    "agreement": ("Monte Carlo against linear covariance", _agreement),
    "satellites": ("Satellites", reception.satellites),
    "tracking": ("Tracking", reception.tracking),
    "logic": ("The filter's logic", reception.logic),
    "delays": ("Delays and latency", reception.delays),
    "outages": ("Outages", evidence.outages),
    "references": ("Published numbers", evidence.references),
    "orbit": ("Orbit at injection", mission.orbit),
    "impact": ("Point of impact", mission.impact),
    "budget": ("Error budget", explained.budget),
    "grades": ("What a better sensor is worth", explained.grades),
    "motion": ("Rate and acceleration", steered.motion),
    "control": ("The vehicle under control", steered.control),
    "observability": ("Observability", explained.observability),
    "reproduce": ("How to reproduce", evidence.reproduce),
}
"""Every section by name, in the order in which they stand unless the campaign says otherwise; one that has nothing to
show stands on the page only where it was asked for by name.
"""
_WHERE_ANY = ("transitions", "logic", "motion", "nozzle", "turning")
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
    for name in CSV:
        _write_csv(tables, name)
    made = [Section(name, SECTIONS[name][0], SECTIONS[name][1](tables)) for name in names]
    if sections or stated:
        made = [section._replace(blocks=section.blocks or [Text("Nothing to show.")]) for section in made]
    made = [section for section in made if section.blocks]
    _write_figures(tables.folder / "figures", made)
    title = str(tables.manifest.get("campaign") or tables.campaign.get("name"))
    asked = str(tables.campaign.get("description") or "")
    page = tables.folder / "report.html"
    page.write_text(render("page.html.j2", title, asked, made), encoding="utf-8")
    text = re.sub(r"\n{3,}", "\n\n", render("page.md.j2", title, asked, made)).strip() + "\n"
    (tables.folder / "report.md").write_text(text, encoding="utf-8")
    return page


def _write_csv(tables: Tables, name: str) -> None:
    frame, path = METRICS[name](tables), tables.folder / f"{name}.csv"
    if frame.empty and name in _WHERE_ANY:
        path.unlink(missing_ok=True)
    else:
        frame.to_csv(path, index=False, float_format="%.6g")


def keep(results: Path | str, folder: Path | str) -> Path:
    """Copy what a repository keeps of a report into a folder, and return its Markdown page: page, figures, CSV tables.

    What an earlier report left there is replaced; the HTML page is remade from results, not kept.
    """
    source, target = load(results).folder, Path(folder)
    try:
        (target / "figures").mkdir(parents=True, exist_ok=True)
        for old in [*(target / "figures").glob("*.png"), *target.glob("*.csv")]:
            old.unlink()
        written = [
            source / f"{name}.csv" for name in CSV if name not in _WHERE_ANY or (source / f"{name}.csv").exists()
        ]
        for path in [*sorted((source / "figures").glob("*.png")), *written]:
            shutil.copyfile(path, target / path.relative_to(source))
        shutil.copyfile(source / "report.md", target / "report.md")
    except OSError as error:
        raise InputError(f"{target}: the report cannot be kept there: {error.strerror or error}") from error
    return target / "report.md"


def _check(names: Sequence[str]) -> None:
    for name in names:
        if name not in SECTIONS:
            near = difflib.get_close_matches(name, SECTIONS, 1)
            hint = f" (did you mean {near[0]}?)" if near else f"; there are {', '.join(SECTIONS)}"
            raise InputError(f"report.sections: no section {name!r}{hint}")


def _write_figures(folder: Path, sections: Sequence[Section]) -> None:
    """Write the pictures of the Markdown twin; those of an earlier report go."""
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()
    for section in sections:
        for block in section.blocks:
            if isinstance(block, Picture):
                (folder / f"{block.name}.png").write_bytes(block.png)


def render(template: str, title: str, asked: str, sections: Sequence[Section]) -> str:
    """Return a page: its template filled with a title, the question and the sections."""
    folder = resources.files("lvnav_trade.report") / "templates"

    def source(name: str) -> str:
        return (folder / name).read_text(encoding="utf-8")

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(source),
        autoescape=lambda name: bool(name and name.endswith(".html.j2")),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["cell"] = lambda text: str(text).replace("|", "\\|").replace("\n", " ")
    script = source("grades.js")
    allowed = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return environment.get_template(template).render(
        title=title, asked=asked, sections=sections, style=source("page.css"), script=script, allowed=allowed
    )
