"""What `make docs` adds to the pages of this folder: overview (from the README), reference, validation.

A hook of mkdocs. Formulas become MathML, which browsers draw without a script; links that leave the folder become text.
"""

import html
import re
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent.parent
_LEAVES = re.compile(r"\[([^\]]+)\]\((?:\.\./)+([^)#]+)(?:#[^)]*)?\)")
_NUMBER = re.compile(r"\\tag\{(\d+)\}")
_MATH = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are generated."""
    pages = {
        "index.md": overview(),
        "validation.md": validation(),
        "reference/fields.md": fields(),
        "reference/metrics.md": metrics(),
        "reference/tables.md": tables(),
        "reference/commands.md": commands(),
        "reference/python.md": python(),
        "reference/cards.md": cards(),
    }
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Turn links to files of the repository that are no page into their text."""
    return _LEAVES.sub(lambda found: f"{found[1]} (`{found[2]}`)" if "/" in found[2] else found[1], markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Turn formulas into MathML."""
    return _MATH.sub(_formula, content)


def _formula(found: re.Match[str]) -> str:
    display = "block" if found[1] == "div" else "inline"
    text = html.unescape(found[2]).strip()
    number = _NUMBER.search(text)
    if number is None:
        return convert(text, display=display)
    formula = convert(_NUMBER.sub("", text).strip(), display=display)
    return f'<div class="equation" id="eq-{number[1]}">{formula}<span>({number[1]})</span></div>'


def overview() -> str:
    """Return the README as the first page."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    text = re.sub(r"\]\(docs/", "](", text)
    return re.sub(r"\]\((?!https?:|#)([^)]*/[^)]*|[A-Z]+\.(?:md|cff)|LICENSE)\)", _inside, text)


def _inside(found: re.Match[str]) -> str:
    target = found[1].partition("#")[0]
    return found[0] if (ROOT / "docs" / target).is_file() else f"](../{found[1]})"


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
    from lvnav_trade.campaign.reading.reference import reference
    from lvnav_trade.errors import InputError

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
    from lvnav_trade.metrics import METRICS

    known = [[f"`{one[0]}`", *map(str, one[1:])] for one in known_metrics()]
    made = [[f"`{name}`", (metric.__doc__ or "").partition("\n")[0]] for name, metric in METRICS.items()]
    return "\n".join([
        "# Metrics", "", "As `lvnav-trade metrics` prints them.", "",
        _table(["metric", "unit", "meaning", "named by"], known),
        "", "## Tables made from results", "", "`results.NAME` in Python, `NAME.csv` beside a report.", "",
        _table(["table", "what it holds"], made), "",
    ])  # fmt: skip


def tables() -> str:
    """Return the data dictionary of stored tables."""
    stored = tomllib.loads((ROOT / "lvnav_trade/store/tables.toml").read_text(encoding="utf-8"))
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
    lines += ["Beside a report, where they have rows:", "", _table(["table", "feature"], reported), ""]
    lines += [_table(["end of a name", "unit"], [[f"`_{end}`", unit] for end, unit in stored["units"].items()])]
    for name, columns in stored["tables"].items():
        rows = [[f"`{column}`", meaning or stored["shared"].get(column, "")] for column, meaning in columns.items()]
        feature = stored["features"][name]
        lines += ["", f"## {name}", "", f"Feature: {feature}.", "", _table(["column", "meaning"], rows)]
    return "\n".join(lines) + "\n"


def commands() -> str:
    """Return the help of every command."""
    from typer.main import get_command
    from typer.testing import CliRunner

    from lvnav_trade.cli.console import app

    names = get_command(app).commands  # type: ignore[attr-defined]
    lines = ["# Commands", ""]
    for name in sorted(names):
        shown = CliRunner().invoke(app, [name, "--help"], terminal_width=100, prog_name="lvnav-trade").output
        lines += [f"## {name}", "", "```text", shown.strip(), "```", ""]
    return "\n".join(lines)


def python() -> str:
    """Return the public functions and records with their docstrings."""
    import inspect

    import lvnav_trade
    from lvnav_trade import api

    lines = ["# Python", "", "How they are used: [Python](../python.md).", "", "## Conventions", ""]
    lines += ["```text", inspect.cleandoc(lvnav_trade.__doc__ or ""), "```"]
    things = {name: getattr(api, name) for name in api.__all__}
    for title, chosen in (("Functions", inspect.isfunction), ("Records", inspect.isclass)):
        lines += ["", f"## {title}"]
        for name, thing in things.items():
            if chosen(thing):
                lines += ["", f"### {name}", "", *_signature(name, thing), *_sections(inspect.getdoc(thing) or "")]
                lines += _methods(thing) if inspect.isclass(thing) else []
    return "\n".join(lines) + "\n"


def _signature(name: str, thing: Any) -> list[str]:
    """Return the call of a function, a parameter per line."""
    import inspect

    if inspect.isclass(thing):
        return []
    found = inspect.signature(thing)
    taken = "".join(f"    {_parameter(one)},\n" for one in found.parameters.values())
    returned = f" -> {found.return_annotation}" if found.return_annotation is not found.empty else ""
    return ["```python", f"{name}(\n{taken}){returned}" if taken else f"{name}(){returned}", "```", ""]


def _parameter(one: Any) -> str:
    """Return a parameter with its type and default."""
    default = "" if one.default is one.empty else f" = {one.default!r}"
    return f"{one.name}: {one.annotation}{default if '<' not in default else ''}"


def _methods(kind: type) -> list[str]:
    """Return the public methods of a record, each with the first line of its docstring."""
    import inspect

    methods = {n: m for n, m in vars(kind).items() if inspect.isfunction(m) and not n.startswith("_")}
    rows = [[f"`{name}()`", (method.__doc__ or "").partition("\n")[0]] for name, method in methods.items()]
    return ["", _table(["method", ""], rows)] if rows else []


_HEADING = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)


def _sections(docstring: str) -> list[str]:
    """Return a numpydoc docstring as Markdown: its text, and a table for each section."""
    text, *parts = _HEADING.split(docstring)
    lines = [text.strip().replace("``", "`")]
    for heading, body in zip(parts[::2], parts[1::2], strict=True):
        rows: list[list[str]] = []
        for line in body.strip("\n").splitlines():
            if line and not line.startswith(" "):
                name, _, kind = line.partition(" : ")
                rows.append([f"`{name}`", kind, ""])
            elif rows:
                rows[-1][2] = f"{rows[-1][2]} {line.strip()}".strip().replace("``", "`")
        lines += ["", f"**{heading}**", "", _table(["", "", ""], rows)]
    return lines


def cards() -> str:
    """Return the cards that come with the tool."""
    from lvnav_trade.campaign.syntax.cards import catalogue

    rows = [[f"`{card.name}`", card.title, card.source] for card in catalogue(ROOT)]
    return "\n".join(
        ["# Cards", "", "`lvnav-trade cards NAME` shows one.", "", _table(["card", "what", "source"], rows), ""]
    )
