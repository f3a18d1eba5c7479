"""Output of a comparison as Markdown, JSON (``--json``) and JUnit XML; copies of a base for a repository."""

import io
import json
import math
import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from lvnav_trade.quantities.errors import InputError, writing
from lvnav_trade.report.blocks import number, percent
from lvnav_trade.report.escape import render, xml_text
from lvnav_trade.report.sentences import say
from lvnav_trade.results.comparison.comparison import ResultComparison
from lvnav_trade.results.tables.contents import DIGESTS, MANIFEST, RESOLVED, damaged, digest, owned
from lvnav_trade.results.tables.read import Tables, has_table, load, stored_table
from lvnav_trade.results.tables.versions import RESULTS_VERSION, across_machines

EXIT = {"not worse": 0, "worse": 1, "undecided": 3}
"""Exit codes of the verdicts."""
ORDER = ("worse", "undecided", "not worse")
HEAD = ("verdict", "case", "metric", "base", "candidate", "change", "bounds", "effect", "runs", "effective runs")
KEPT = ("cases", "outputs", "runs", "interval_errors", "events", "states", "reference")
KEPT_WITHOUT_RUNS = ("history", "consistency", "covariances", "joint_covariances", "innovations")
"""Tables that a comparison reads; of `reference` only few times, which identify the trajectory."""
_KEPT_EVERY = 20
_OF_ONE_MACHINE = ("command", "cpu", "folder", "host", "system", "timings_s", "created", "finished")


def answer(comparison: ResultComparison) -> str:
    """Return the outcome of a comparison in one sentence."""
    counts = Counter(comparison.frame.verdict)
    return say(
        "compared_with",
        verdict=comparison.verdict,
        whole=len(comparison.frame),
        counts={word: counts[word] for word in ORDER if counts[word]},
        confidence=comparison.confidence,
    )


def rows(comparison: ResultComparison) -> list[tuple[str, ...]]:
    """Return the cells of the comparison table below `HEAD`, deteriorations first."""
    order = comparison.frame.verdict.map(ORDER.index)
    return [_row(row) for row in comparison.frame.loc[order.sort_values(kind="stable").index].itertuples(index=False)]


def _row(row: Any) -> tuple[str, ...]:
    """Return the cells of one compared quantity."""
    is_requirement = row.kind == "requirement"
    quantity = say(
        "quantity", metric=row.metric, is_requirement=is_requirement, event=row.event, statistic=row.statistic
    )
    unit = f" {row.unit}" if row.unit else ""
    sizes = [
        percent(value) if row.scale == "fraction of runs" else number(value) + unit
        for value in (row.base, row.candidate)
    ]
    bounds = f"{_change(row.low, row.scale)} to {_change(row.high, row.scale)}"
    word = row.verdict + (f" ({row.remark})" if row.remark else "")
    worth = f"{row.effective_runs:.0f}" if math.isfinite(row.effective_runs) else number(row.effective_runs)
    effect = _change(row.effect, row.scale, "g").lstrip("+")
    return (word, row.case, quantity, *sizes, _change(row.change, row.scale), bounds, effect, str(row.runs), worth)


def _change(value: float, scale: str, form: str = "") -> str:
    """Return a change with its sign: a ratio in percent, a fraction of runs in percentage points."""
    if math.isnan(value):
        return "–"
    sign = "+" if value > 0 else ("-" if value < 0 else "")
    size = abs(value) if scale not in ("ratio", "fraction of runs") else 100.0 * abs(value)
    unit = {"ratio": "%", "fraction of runs": "points"}.get(scale, scale)
    return f"{sign}{format(size, form) if form else number(size)} {unit}"


def markdown(comparison: ResultComparison) -> str:
    """Return a comparison as a Markdown page."""
    sides = {"base": comparison.base, "candidate": comparison.candidate, "notes": comparison.notes}
    confidence = percent(comparison.confidence)
    return render(
        "compare.md.j2", **sides, answer=answer(comparison), head=HEAD, rows=rows(comparison), confidence=confidence
    )


def content(comparison: ResultComparison) -> dict[str, Any]:
    """Return a comparison as data for JSON; numbers that are not finite become null."""
    records = [
        {key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in row.items()}
        for row in comparison.frame.to_dict(orient="records")
    ]
    return {
        "base": str(comparison.base),
        "candidate": str(comparison.candidate),
        "verdict": comparison.verdict,
        "answer": answer(comparison),
        "confidence": comparison.confidence,
        "notes": list(comparison.notes),
        "rows": records,
    }


def junit(comparison: ResultComparison) -> str:
    """Return a comparison as JUnit XML: "worse" is a failure, "undecided" is skipped."""
    counts = Counter(comparison.frame.verdict)
    numbers = {"tests": len(comparison.frame), "failures": counts["worse"], "skipped": counts["undecided"], "errors": 0}
    attributes = {key: str(value) for key, value in numbers.items()}
    root = ElementTree.Element("testsuites", {"name": "lvnav-trade compare", **attributes})
    suite = ElementTree.SubElement(
        root, "testsuite", {"name": xml_text(f"{comparison.base} against {comparison.candidate}"), **attributes}
    )
    for row in comparison.frame.itertuples(index=False):
        cells = _row(row)
        case = ElementTree.SubElement(
            suite, "testcase", {"classname": xml_text(row.case), "name": xml_text(cells[2]), "time": "0"}
        )
        text = xml_text("; ".join(f"{name}: {cell}" for name, cell in zip(HEAD[3:], cells[3:], strict=True)))
        if row.verdict != "not worse":
            element = "failure" if row.verdict == "worse" else "skipped"
            message = f"{cells[0]}; change {cells[5]}, bounds {cells[6]}"
            ElementTree.SubElement(case, element, {"message": xml_text(message)}).text = text
        else:
            ElementTree.SubElement(case, "system-out").text = text
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def parse_map(assignments: Sequence[str]) -> dict[str, str]:
    """Return the mapping of base cases to candidate cases.

    Parameters
    ----------
    assignments : sequence of str
        Texts such as ``tactical_fog:tactical_fog_worse``.

    Raises
    ------
    InputError
        A text is not BASE:CANDIDATE.
    """
    mapping = {}
    for text in assignments:
        name, colon, candidate = (field.strip() for field in text.partition(":"))
        if not (name and colon and candidate):
            raise InputError(f"--map {text}: write BASE:CANDIDATE, such as tactical_fog:tactical_fog_worse")
        mapping[name] = candidate
    return mapping


def write(comparison: ResultComparison, md: Path | None = None, xml: Path | None = None) -> list[Path]:
    """Write the requested files and return their paths.

    In a CI job that offers a summary file, the page is appended to it.

    Parameters
    ----------
    comparison : ResultComparison
        The comparison.
    md, xml : Path, optional
        Markdown and JUnit files.
    """
    summary = os.environ.get("GITHUB_STEP_SUMMARY")
    files = [
        (md, "w", markdown),
        (xml, "w", junit),
        (Path(summary) if summary else None, "a", lambda found: markdown(found) + "\n"),
    ]
    written = []
    for path, mode, text in files:
        if path is not None:
            with writing(path, "cannot be written"):
                path.parent.mkdir(parents=True, exist_ok=True)
                with path.open(mode, encoding="utf-8") as file:
                    file.write(text(comparison))
            written.append(path)
    return written


def keep_base(results: Path | str | Tables, folder: Path | str) -> Path:
    """Copy the results that a later comparison needs into a folder small enough for a repository; return the folder.

    Without Monte Carlo runs, the covariance history is copied too, because the comparison then uses it.

    Raises
    ------
    InputError
        A file of the results is damaged.
    """
    tables, target = load(results), owned(folder, "base")
    if not tables.campaign:  # reading the campaign first rejects damaged results before they are copied
        raise damaged(tables.folder / RESOLVED, "it states nothing")
    names = KEPT if int(tables.cases.run_count.sum()) else (*KEPT, *KEPT_WITHOUT_RUNS)
    manifest = {name: value for name, value in tables.manifest.items() if name not in _OF_ONE_MACHINE}
    manifest |= {"results_version": RESULTS_VERSION, "across_machines": across_machines()}  # of the tables as kept
    with writing(folder, "the base cannot be kept there"):
        files = {RESOLVED: (tables.folder / RESOLVED).read_bytes()}
        for name in names:
            # results of an older version may lack a table; a comparison that needs it reports this
            if has_table(tables.folder, name):
                files[f"{name}.parquet"] = _kept(tables.folder, name)
        manifest[DIGESTS] = {name: digest(content) for name, content in files.items()}
        files[MANIFEST] = (json.dumps(manifest, indent=2, sort_keys=True) + "\n").encode()
        target.publish("base", files)
    return target.folder


def _kept(folder: Path, name: str) -> bytes:
    import pyarrow.parquet as pq

    table, content = stored_table(folder, name), io.BytesIO()
    if name == "reference":
        table = table.take(list(range(0, table.num_rows, _KEPT_EVERY)))
    pq.write_table(table, content, compression="zstd")
    return content.getvalue()
