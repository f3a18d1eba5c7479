"""A comparison as Markdown, as data for ``--json``, and as JUnit XML; what a repository keeps of a base."""

from __future__ import annotations

import io
import json
import math
import os
import re
from collections import Counter
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import jinja2

from lvnav_trade.errors import InputError
from lvnav_trade.metrics.comparison.comparison import Comparison
from lvnav_trade.report.blocks import number, percent
from lvnav_trade.report.escape import MARKDOWN, xml_text
from lvnav_trade.store import Tables, load
from lvnav_trade.store.contents import MANIFEST, RESOLVED, owned

MET, WORSE, UNDECIDED = 0, 1, 3
EXIT = {"not worse": MET, "worse": WORSE, "undecided": UNDECIDED}
"""Exit codes of the verdicts."""
ORDER = ("worse", "undecided", "not worse")
HEAD = ("verdict", "case", "metric", "base", "candidate", "change", "bounds", "effect", "runs", "effective runs")
KEPT = ("cases", "outputs", "runs", "worst", "events", "states", "reference")
KEPT_WITHOUT_RUNS = ("history", "consistency", "covariances", "joint", "innovations")
"""Tables that a comparison reads; `reference` at fewer times, to know the flight again."""
_KEPT_EVERY = 20
_OF_ONE_MACHINE = ("command", "cpu", "folder", "host", "system", "timings_s", "created", "finished")


def exit_code(found: Comparison) -> int:
    """Return 0 where nothing is worse, 1 where something is, 3 where the runs do not tell."""
    return EXIT[found.verdict]


def answer(found: Comparison) -> str:
    """Say the outcome in one sentence."""
    counts = Counter(found.frame.verdict)
    parts = [f"{counts[word]} {word}" for word in ORDER if counts[word]]
    start = {"worse": "Worse", "undecided": "Undecided", "not worse": "Nothing worse"}[found.verdict]
    return f"{start}: of {len(found.frame)} comparisons {', '.join(parts)}, at {percent(found.confidence)} confidence."


def rows(found: Comparison) -> list[tuple[str, ...]]:
    """Return the cells of `HEAD`, what is worse first."""
    order = found.frame.verdict.map(ORDER.index)
    return [_row(row) for row in found.frame.loc[order.sort_values(kind="stable").index].itertuples(index=False)]


def _row(row: Any) -> tuple[str, ...]:
    what = row.metric.replace("_", " ") + (" (requirement)" if row.kind == "requirement" else "")
    what += f" at {row.event.replace('_', ' ')}" if row.event else ""
    what += f" ({row.statistic})" if row.statistic not in ("rms", "fraction beyond") else ""
    unit = f" {row.unit}" if row.unit else ""
    sizes = [
        percent(value) if row.scale == "fraction of runs" else number(value) + unit
        for value in (row.base, row.candidate)
    ]
    bounds = f"{_change(row.low, row.scale)} to {_change(row.high, row.scale)}"
    word = row.verdict + (f" ({row.remark})" if row.remark else "")
    worth = f"{row.effective_runs:.0f}" if math.isfinite(row.effective_runs) else number(row.effective_runs)
    effect = _change(row.effect, row.scale, "g").lstrip("+")
    return (word, row.case, what, *sizes, _change(row.change, row.scale), bounds, effect, str(row.runs), worth)


def _change(value: float, scale: str, form: str = "") -> str:
    """Write a change with its sign: a ratio in percent, a fraction of runs in percentage points."""
    if math.isnan(value):
        return "–"
    sign = "+" if value > 0 else ("-" if value < 0 else "")
    size = abs(value) if scale not in ("ratio", "fraction of runs") else 100.0 * abs(value)
    unit = {"ratio": "%", "fraction of runs": "points"}.get(scale, scale)
    return f"{sign}{format(size, form) if form else number(size)} {unit}"


def markdown(found: Comparison) -> str:
    """Return the comparison as a page."""
    source = (resources.files("lvnav_trade.report") / "templates" / "compare.md.j2").read_text(encoding="utf-8")
    environment = jinja2.Environment(trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined)
    environment.filters |= MARKDOWN
    text = environment.from_string(source).render(
        base=found.base, candidate=found.candidate, answer=answer(found), head=HEAD, rows=rows(found),
        notes=found.notes, confidence=percent(found.confidence),
    )  # fmt: skip
    return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


def content(found: Comparison) -> dict[str, Any]:
    """Return the comparison as JSON can hold it: what is not a finite number is null."""
    records = [
        {key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in row.items()}
        for row in found.frame.to_dict(orient="records")
    ]
    return {
        "base": str(found.base),
        "candidate": str(found.candidate),
        "verdict": found.verdict,
        "answer": answer(found),
        "confidence": found.confidence,
        "notes": list(found.notes),
        "rows": records,
    }


def junit(found: Comparison) -> str:
    """Return the comparison as JUnit XML: worse is a failure, undecided is skipped."""
    counts = Counter(found.frame.verdict)
    numbers = {"tests": len(found.frame), "failures": counts["worse"], "skipped": counts["undecided"], "errors": 0}
    attributes = {key: str(value) for key, value in numbers.items()}
    root = ElementTree.Element("testsuites", {"name": "lvnav-trade compare", **attributes})
    suite = ElementTree.SubElement(
        root, "testsuite", {"name": xml_text(f"{found.base} against {found.candidate}"), **attributes}
    )
    for row in found.frame.itertuples(index=False):
        cells = _row(row)
        case = ElementTree.SubElement(
            suite, "testcase", {"classname": xml_text(row.case), "name": xml_text(cells[2]), "time": "0"}
        )
        text = xml_text("; ".join(f"{name}: {cell}" for name, cell in zip(HEAD[3:], cells[3:], strict=True)))
        if row.verdict != "not worse":
            kind = "failure" if row.verdict == "worse" else "skipped"
            message = f"{cells[0]}; change {cells[5]}, bounds {cells[6]}"
            ElementTree.SubElement(case, kind, {"message": xml_text(message)}).text = text
        else:
            ElementTree.SubElement(case, "system-out").text = text
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def parse_map(assignments: Sequence[str]) -> dict[str, str]:
    """Return the mapping of texts such as ``tactical_fog:tactical_fog_worse``."""
    found = {}
    for text in assignments:
        name, colon, other = (part.strip() for part in text.partition(":"))
        if not (name and colon and other):
            raise InputError(f"--map {text}: write BASE:CANDIDATE, such as tactical_fog:tactical_fog_worse")
        found[name] = other
    return found


def write(found: Comparison, md: Path | None = None, xml: Path | None = None) -> list[Path]:
    """Write the files asked for, and append the page to the summary of a CI job where there is one; return them."""
    written = []
    for path, text in ((md, markdown), (xml, junit)):
        if path is not None:
            _write(path, text(found), "w")
            written.append(path)
    summary = os.environ.get("GITHUB_STEP_SUMMARY")
    if summary:
        _write(Path(summary), markdown(found) + "\n", "a")
        written.append(Path(summary))
    return written


def _write(path: Path, text: str, mode: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open(mode, encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error


def keep_base(results: Path | str | Tables, folder: Path | str) -> Path:
    """Copy what a later comparison needs of results into a folder, small enough for a repository; return the folder.

    Without Monte-Carlo runs the history and the covariances go along: then they are what is compared.
    """
    import pyarrow.parquet as pq

    tables, target = load(results), owned(folder, "base")
    names = KEPT if int(tables.cases.run_count.sum()) else (*KEPT, *KEPT_WITHOUT_RUNS)
    try:
        # a table of an older version may lack; a comparison that needs it says so
        files = {name: f"{name}.parquet" for name in names if (tables.folder / f"{name}.parquet").exists()}
        target.claim("base", (RESOLVED, MANIFEST, *files.values()))
        target.write(RESOLVED, (tables.folder / RESOLVED).read_bytes())
        manifest = {name: value for name, value in tables.manifest.items() if name not in _OF_ONE_MACHINE}
        target.write(MANIFEST, json.dumps(manifest, indent=2, sort_keys=True) + "\n")
        for name, file in files.items():
            table = pq.read_table(tables.folder / file)
            if name == "reference":
                table = table.take(list(range(0, table.num_rows, _KEPT_EVERY)))
            content = io.BytesIO()
            pq.write_table(table, content, compression="zstd")
            target.write(file, content.getvalue())
        target.replace("base", (RESOLVED, MANIFEST, *files.values()))
    except OSError as error:
        raise InputError(f"{folder}: the base cannot be kept there: {error.strerror or error}") from error
    return target.folder
