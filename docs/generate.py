"""The manual: pages of this folder, generated reference and validation, kept reports, notebook, gallery.

``python docs/generate.py SITE [REPORT ...]`` gathers them as one folder of Markdown and has Sphinx make the site
(`conf.py`). A link that leads to no page becomes text.
"""

import base64
import html
import json
import os
import re
import shutil
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Container, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\((?!https?:|mailto:|#)([^)\s#]+)(#[^)\s]*)?\)")
_FENCE = re.compile(r"(^(?:```|~~~).*?^(?:```|~~~)\s*$)", re.MULTILINE | re.DOTALL)

NAVIGATION = {
    "Start": ("tutorial", "how_to", "gallery", "example"),
    "How-to": (
        "your_own_trajectory", "guarding_a_design", "searching", "trade_space", "clusters", "recorded_data", "python",
        "reference_vectors", "filter_in_c", "statements",
    ),
    "Theory": (
        "theory", "inertial", "several_units", "receiver", "receiver_observables", "sensors", "alignment", "filter",
        "gains", "modelling_the_vehicle", "faults", "integrity",
    ),
    "Validation": ("validation", "vehicles", "conae", "dlr", "published_elements", "numbers_across_machines"),
    "Reports": ("reports/README",),
    "Reference": (
        "reference/fields", "reference/metrics", "reference/tables", "reference/commands", "reference/python",
        "reference/cards", "glossary",
    ),
    "Project": (
        "CONTRIBUTING", "CHANGELOG", "map", "README", "performance", "hardening", "decisions/index", "design/index",
    ),
}  # fmt: skip
"""Pages of the manual by group, in their order."""

GALLERY = {
    "Comparing designs": ("demo/ranking", "demo/compare-velocity", "trade/space/effects-1", "trade/find_imu/pareto"),
    "Sources of errors": ("error_budget/budget-*-velocity", "error_budget/when-*-velocity", "trade/sobol/indices"),
    "Searches": ("trade/bias_by_latency/curves-1", "trade/heading_needed/solve"),
    "Signals": (
        "demo/satellites-1", "world/antennas_and_tracking/sky-1", "world/jamming/satellites-1",
        "world/troposphere/delays-1",
    ),
    "Faults and integrity": ("world/faults/compare-position", "world/protection_level/protection-*"),
    "Published systems": (
        "conae/receiver-4-errors", "dlr/start_locus-1-bound", "drdc/nozzle-4-sweep", "gains/polar-2-orbit",
    ),
    "Real flights and logs": ("falcon9_formosat5/trajectory-1", "recorded/drive/outages"),
    "Injection accuracy": ("injection/guidance/injection-1", "injection/guidance/injection-2"),
}  # fmt: skip
"""Figures of kept reports by subject: report and name of the figure."""


def main(site: Path, chosen: Sequence[str] = ()) -> int:
    """Make the site in a folder; return the exit code of Sphinx, which takes every warning for an error.

    chosen : kept reports that become pages, such as demo; all if empty
    """
    from sphinx.cmd.build import build_main

    with tempfile.TemporaryDirectory() as place:
        source = Path(place) / "source"
        gather(source, chosen)
        quiet = ["-q", "-W", "--keep-going", "-b", "html", "-c", str(DOCS)]
        code = build_main([*quiet, "-d", str(Path(place) / "doctrees"), str(source), str(site)])
    for left in (".buildinfo", "objects.inv"):
        (site / left).unlink(missing_ok=True)
    for subject in GALLERY.values():
        for name in subject:
            _copy_figure(name, site)
    return code


def _copy_figure(name: str, site: Path) -> None:
    """Copy a figure of the gallery into the site."""
    folder, _, pattern = name.rpartition("/")
    (path, *_) = sorted((ROOT / "reports" / folder / "figures").glob(f"{pattern}.png"))
    report, figure, _ = _shown(name)
    if not (site / f"{report}.html").is_file():
        return
    target = site / figure
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, target)


def gather(source: Path, chosen: Sequence[str] = ()) -> None:
    """Write every page of the manual as Markdown into a folder, with the pictures that they show."""
    pages = _pages(chosen)
    homes = {origin: target for target, (origin, _) in pages.items() if origin is not None}
    for target, (origin, text) in pages.items():
        path = source / f"{target}.md"
        path.parent.mkdir(parents=True, exist_ok=True)
        whole = _outside_code(text, partial(_led, target, origin, homes, source))
        path.write_text(whole, encoding="utf-8")


def _pages(chosen: Sequence[str] = ()) -> dict[str, tuple[Path | None, str]]:
    """Return the pages by their place in the manual: the file that each comes from, if any, and its text."""
    found: dict[str, tuple[Path | None, str]] = {}
    for path in [*DOCS.glob("*.md"), *DOCS.glob("decisions/*.md"), *DOCS.glob("design/*.md")]:
        found[str(path.relative_to(DOCS).with_suffix(""))] = path, path.read_text(encoding="utf-8")
    for path in (ROOT / "reports").rglob("*.md"):
        name = str(path.relative_to(ROOT / "reports").parent)
        if not chosen or name in (".", *chosen):
            found[f"reports/{path.relative_to(ROOT / 'reports').with_suffix('')}"] = (
                path,
                _headed(path.read_text(encoding="utf-8")),
            )
    found["searching"] = found.pop("search")  # Sphinx has a page of that name
    for name in ("CONTRIBUTING", "CHANGELOG"):
        path = ROOT / f"{name}.md"
        found[name] = path, path.read_text(encoding="utf-8")
    reports = sorted(name for name in found if name.startswith("reports/") and name != "reports/README")
    found["reports/README"] = ROOT / "reports/README.md", found["reports/README"][1] + _tree(reports)
    found["decisions/index"] = DOCS / "README.md", decisions()
    designs = sorted(name for name in found if name.startswith("design/"))
    found["design/index"] = None, "# Experiments\n\nThe experiments behind some decisions.\n" + _tree(designs)
    generated = {
        "validation": validation, "gallery": lambda: gallery(found), "example": notebook, "reference/fields": fields,
        "reference/metrics": metrics, "reference/tables": tables, "reference/commands": commands,
        "reference/python": python, "reference/cards": cards,
    }  # fmt: skip
    found |= {name: (None, text()) for name, text in generated.items()}
    front = (ROOT / "README.md").read_text(encoding="utf-8")
    trees = (_tree(names, caption, hidden=True) for caption, names in NAVIGATION.items())
    found["index"] = ROOT / "README.md", front + "".join(trees)
    return found


def _tree(names: Any, caption: str = "", hidden: bool = False) -> str:
    options = [f":caption: {caption}"] if caption else []
    options += [":hidden:"] if hidden else [":maxdepth: 1"]
    return "\n".join(["", "```{toctree}", *options, "", *(f"/{name}" for name in names), "```", ""])


def _headed(text: str) -> str:
    """Return a report's text whose first heading is of the first level."""
    return text if text.lstrip().startswith("# ") else f"# Report\n\n{text}"


def _outside_code(text: str, change: Any) -> str:
    """Return a text with its links changed, those in code apart."""
    return "".join(
        part if place % 2 else _LINK.sub(change, part) for place, part in enumerate(_FENCE.split(text))
    )  # fmt: skip


def _led(target: str, origin: Path | None, homes: dict[Path, str], source: Path, found: re.Match[str]) -> str:
    """Return a link of a page as it is in the manual, or its text where it leads to no page."""
    picture, label, link, anchor = found[1], found[2], found[3], found[4] or ""
    here = (source / target).parent
    if origin is None:  # generated pages name places of the manual
        return found[0]
    meant = Path(os.path.normpath(origin.parent / link))
    if meant.is_dir() and (meant / "README.md").is_file():
        meant = meant / "README.md"
    if meant in homes:
        return f"[{label}]({os.path.relpath(source / homes[meant], here)}.md{anchor})"
    if meant.name == "example.ipynb":
        return f"[{label}]({os.path.relpath(source / 'example', here)}.md)"
    if meant.suffix in (".png", ".svg") and meant.is_file():
        copy = source / meant.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(meant, copy)
        return f"{picture}[{label}]({os.path.relpath(copy, here)})" if picture else label
    return f"{label} (`{link}`)" if "/" in link and label != link else label


def decisions() -> str:
    """Return the page of decisions: the groups of the list of documents, and their tree."""
    text = (DOCS / "README.md").read_text(encoding="utf-8").partition("## Decisions\n")[2]
    names = sorted(path.stem for path in DOCS.glob("decisions/*.md"))
    tree = "\n".join(["", "```{toctree}", ":hidden:", "", *(f"/decisions/{name}" for name in names), "```", ""])
    return "# Decisions\n" + text.replace("\n### ", "\n## ") + tree


def notebook() -> str:
    """Return the example notebook as a page, with what it showed."""
    lines = []
    for cell in json.loads((DOCS / "example.ipynb").read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            lines += [text, ""]
            continue
        lines += ["```python", text, "```", ""]
        for shown in cell["outputs"]:
            data = shown.get("data", {})
            if "image/png" in data:
                picture = base64.b64encode(base64.b64decode("".join(data["image/png"]))).decode()
                lines += [f'<img alt="Figure of the cell above" src="data:image/png;base64,{picture}">', ""]
            elif "text/plain" in data:
                lines += ["```text", "".join(data["text/plain"]), "```", ""]
    return "\n".join(lines)


def gallery(pages: Container[str]) -> str:
    """Return a page with figures of the kept reports among the pages, each a link to its report."""
    lines = ["# Gallery", "", "Figures of kept reports. Each one leads to its report.", ""]
    for subject, names in GALLERY.items():
        shown = [_shown(name) for name in names if f"reports/{name.rpartition('/')[0]}/report" in pages]
        if shown:
            pictures = "".join(
                f'<a href="{report}.html"><img src="{figure}" alt="{alt}" loading="lazy"><span>{alt}</span></a>\n'
                for report, figure, alt in shown
            )
            lines += [f"## {subject}", "", "```{raw} html", f'<div class="gallery">\n{pictures}</div>', "```", ""]
    return "\n".join(lines)


def _shown(name: str) -> tuple[str, str, str]:
    """Return the report of a figure, the figure's place in the site and its caption."""
    folder, _, pattern = name.rpartition("/")
    (path, *_) = sorted((ROOT / "reports" / folder / "figures").glob(f"{pattern}.png")) or [None]
    if path is None:
        raise SystemExit(f"gallery: there is no reports/{folder}/figures/{pattern}.png")
    text = (ROOT / "reports" / folder / "report.md").read_text(encoding="utf-8")
    caption = re.search(rf"!\[((?:[^\[\]]|\[[^\]]*\])*)\]\(figures/{re.escape(path.name)}\)", text)
    return (
        f"reports/{folder}/report",
        f"_static/gallery/{folder.replace('/', '-')}-{path.name}",
        html.escape(caption[1] if caption else path.stem),
    )


def _table(heads: list[str], rows: list[list[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(_cell(cell) for cell in line) + " |" for line in lines)


def _cell(text: str) -> str:
    return " ".join(str(text).replace("|", "\\|").replace("<", "&lt;").split())


def validation() -> str:
    """Return the page on every model, what checks it and what it leaves out, from the list that reports quote."""
    from lvnav_trade.report.models import registry

    stored = registry()
    counts = Counter(check["by"] for one in stored["model"] for check in one["checks"])
    lines = [
        "# Validation",
        "",
        f"Every model that a campaign may use ({len(stored['model'])}), what it was compared with, and what it leaves",
        "out. The report of a campaign quotes this list for its models. Each line is a test; run one by its name with",
        "pytest.",
        "",
        _table(
            ["compared with", "which is", "tests"], [[s, is_, str(counts[s])] for s, is_ in stored["sorts"].items()]
        ),
        "",
        "Both engines share Jacobians and transition; these are checked by numerical differences, by dense filters",
        "written apart in another frame (2e-4 of a sigma at every epoch) and by closed forms (1e-4). Published",
        "navigation systems are reproduced as studies: [CONAE](conae.md), [DLR](dlr.md) and, in `reports/`, DRDC and",
        "ISRO. Each says what does not hold.",
    ]
    for one in stored["model"]:
        lines += ["", f"## {one['name']}", ""]
        if one["checks"]:
            rows = [
                [check["by"], check["shown"], f"`{check['test'].removeprefix('tests/')}`"] for check in one["checks"]
            ]
            lines += [_table(["compared with", "what the test shows", "test"], rows), ""]
        else:
            lines += ["No test compares it with anything.", ""]
        lines += [f"*Left out:* {one['omits']}"]
    return "\n".join(lines) + "\n"


def fields() -> str:
    """Return the fields of a campaign, path by path."""
    lines = [
        "# Fields of a campaign",
        "",
        'As `lvnav-trade fields PATH` prints them. Quantities are written with their units (`"2 deg/h"`). Paths leave',
        "out `base`: `imu.gyro.random_walk`.",
    ]
    for path, parts in _paths(""):
        lines += ["", f"## {path or 'campaign'}"]
        for part in parts:
            lines += ["", f"**kind: {part.kind}** {_cell(part.title)}" if part.kind else _cell(part.title), ""]
            rows = [[f"`{row.field}`", row.default, row.type, row.meaning] for row in part.rows]
            lines += [_table(["field", "default", "takes", "meaning"], rows) if rows else "No further fields."]
    return "\n".join(lines) + "\n"


def _paths(path: str, seen: set[str] | None = None) -> Iterator[tuple[str, list[Any]]]:
    """Yield every path that has fields of its own, each set of fields once."""
    from lvnav_trade.campaign.reading.field_reference import reference
    from lvnav_trade.quantities.errors import InputError

    seen = set() if seen is None else seen
    try:
        parts = reference(path)
    except InputError:  # a quantity, a word, a number
        return
    if repr(parts) in seen:
        return
    seen.add(repr(parts))
    yield path, parts
    for field in dict.fromkeys(row.field for part in parts for row in part.rows):
        below = field if path in ("", "base") else f"{path}.{field}"
        yield from _paths(below, seen)


def metrics() -> str:
    """Return what a requirement can name, and the tables made from it."""
    from lvnav_trade.campaign.definition.metric_names import known_metrics
    from lvnav_trade.results.evaluation import METRICS

    known = [[f"`{one[0]}`", *map(str, one[1:])] for one in known_metrics()]
    made = [[f"`{name}`", _noun((metric.__doc__ or "").partition("\n")[0])] for name, metric in METRICS.items()]
    return "\n".join([
        "# Metrics", "", "As `lvnav-trade metrics` prints them.", "",
        _table(["metric", "unit", "meaning", "named by"], known),
        "", "## Tables made from results", "", "`results.NAME` in Python, `NAME.csv` beside a report.", "",
        _table(["table", "content"], made), "",
    ])  # fmt: skip


def _noun(sentence: str) -> str:
    """Return what a docstring's first sentence says that a function returns."""
    said = sentence.removeprefix("Return ")
    return said[:1].upper() + said[1:]


def tables() -> str:
    """Return the data dictionary of stored tables."""
    stored = tomllib.loads((ROOT / "lvnav_trade/results/tables/tables.toml").read_text(encoding="utf-8"))
    lines = [
        "# Tables",
        "",
        "Parquet files of a results folder; `results.NAME` in Python. Every table begins with `case`.",
        "A table without rows is not written: Python reads it as a frame without rows.",
        "`contents.json` of a folder lists its tables and the feature that each belongs to.",
        "",
    ]
    features = [[f"[{name}](#{name})", feature] for name, feature in stored["features"].items()]
    lines += [_table(["table", "feature"], features), ""]
    reported = [[f"`{name}.csv`", feature] for name, feature in stored["reported"].items()]
    lines += [
        "CSV files next to a report; a table without rows is not written:",
        "",
        _table(["table", "feature"], reported),
        "",
    ]
    lines += [_table(["end of a name", "unit"], [[f"`_{end}`", unit] for end, unit in stored["units"].items()])]
    for name, columns in stored["tables"].items():
        rows = [[f"`{column}`", meaning or stored["shared"].get(column, "")] for column, meaning in columns.items()]
        feature = stored["features"][name]
        lines += ["", f"## {name}", "", f"Feature: {feature}.", "", _table(["column", "meaning"], rows)]
    return "\n".join(lines) + "\n"


def commands() -> str:
    """Return the help of every command."""
    from typer.testing import CliRunner

    from lvnav_trade.cli.console import GROUPS, app

    lines = [
        "# Commands",
        "",
        "All commands know `-h`. `lvnav-trade --install-completion` adds completion to your shell.",
        "",
    ]
    for group, names in GROUPS.items():
        lines += [f"## {group}", ""]
        for name in names:
            shown = CliRunner().invoke(app, [name, "--help"], terminal_width=100, prog_name="lvnav-trade").output
            lines += [f"### {name}", "", "```text", shown.strip(), "```", ""]
    return "\n".join(lines)


def python() -> str:
    """Return the public functions and records; Sphinx sets their docstrings (numpydoc)."""
    import inspect

    import lvnav_trade
    from lvnav_trade import api

    lines = ["# Python", "", "How they are used: [Python](../python.md).", "", "## Conventions", ""]
    lines += ["```{eval-rst}", inspect.cleandoc(lvnav_trade.__doc__ or ""), "```"]
    things = {name: getattr(api, name) for name in api.__all__}
    for title, chosen, kind in (("Functions", inspect.isfunction, "function"), ("Records", inspect.isclass, "class")):
        lines += ["", f"## {title}"]
        for name in (name for name, thing in things.items() if chosen(thing)):
            lines += ["", f"### {name}", "", "```{eval-rst}", f".. auto{kind}:: lvnav_trade.api.{name}", "```"]
    return "\n".join(lines) + "\n"


def cards() -> str:
    """Return the cards that come with the tool."""
    from lvnav_trade.campaign.syntax.card_lookup import catalogue

    rows = [[f"`{card.name}`", card.title, card.source] for card in catalogue(ROOT)]
    return "\n".join(
        ["# Cards", "", "`lvnav-trade cards NAME` shows one.", "", _table(["card", "description", "source"], rows), ""]
    )


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), sys.argv[2:]))
