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
from lvnav_trade.results.tables.contents import DIGESTS, MANIFEST, RESOLVED, damaged_file_error, digest, owned_folder
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
_PERCENT_UNITS = {"ratio": "%", "fraction of runs": "points"}  # units of changes that are written times 100
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
    frame = comparison.frame.sort_values(
        "verdict",
        key=lambda verdicts: verdicts.map(ORDER.index),
        kind="stable",
    )
    return [_row(row) for row in frame.itertuples(index=False)]


def _row(row: Any) -> tuple[str, ...]:
    """Return the cells of one compared quantity, in the order of `HEAD`."""
    quantity = say(
        "quantity",
        metric=row.metric,
        is_requirement=row.kind == "requirement",
        event=row.event,
        statistic=row.statistic,
    )
    has_effective_number = math.isfinite(row.effective_runs)
    return (
        f"{row.verdict} ({row.remark})" if row.remark else row.verdict,
        row.case,
        quantity,
        _size(row.base, row),
        _size(row.candidate, row),
        _change(row.change, row.scale),
        f"{_change(row.low, row.scale)} to {_change(row.high, row.scale)}",
        _change(row.effect, row.scale, "g").lstrip("+"),
        str(row.runs),
        f"{row.effective_runs:.0f}" if has_effective_number else number(row.effective_runs),
    )


def _size(value: float, row: Any) -> str:
    """Return a value of a compared quantity with its unit."""
    if row.scale == "fraction of runs":
        return percent(value)
    if row.unit:
        return f"{number(value)} {row.unit}"
    return number(value)


def _change(value: float, scale: str, form: str = "") -> str:
    """Return a change with its sign: a ratio in percent, a fraction of runs in percentage points.

    Parameters
    ----------
    value : float
        The change.
    scale : str
        "ratio", "fraction of runs", or the unit of the change.
    form : str
        Python format of the number; by default three significant digits.
    """
    if math.isnan(value):
        return "–"
    sign = "+" if value > 0 else ("-" if value < 0 else "")
    size = abs(value)
    if scale in _PERCENT_UNITS:
        size *= 100.0
    unit = _PERCENT_UNITS.get(scale, scale)
    text = format(size, form) if form else number(size)
    return f"{sign}{text} {unit}"


def markdown(comparison: ResultComparison) -> str:
    """Return a comparison as Markdown."""
    return render(
        "compare.md.j2",
        base=comparison.base,
        candidate=comparison.candidate,
        notes=comparison.notes,
        answer=answer(comparison),
        head=HEAD,
        rows=rows(comparison),
        confidence=percent(comparison.confidence),
    )


def content(comparison: ResultComparison) -> dict[str, Any]:
    """Return a comparison as data for JSON; numbers that are not finite become null."""
    records = []
    for row in comparison.frame.to_dict(orient="records"):
        records.append({key: _json_value(value) for key, value in row.items()})
    return {
        "base": str(comparison.base),
        "candidate": str(comparison.candidate),
        "verdict": comparison.verdict,
        "answer": answer(comparison),
        "confidence": comparison.confidence,
        "notes": list(comparison.notes),
        "rows": records,
    }


def _json_value(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def junit(comparison: ResultComparison) -> str:
    """Return a comparison as JUnit XML: "worse" is a failure, "undecided" is skipped."""
    counts = Counter(comparison.frame.verdict)
    attributes = {
        "tests": str(len(comparison.frame)),
        "failures": str(counts["worse"]),
        "skipped": str(counts["undecided"]),
        "errors": "0",
    }
    name = xml_text(f"{comparison.base} against {comparison.candidate}")
    root = ElementTree.Element("testsuites", {"name": "lvnav-trade compare", **attributes})
    suite = ElementTree.SubElement(root, "testsuite", {"name": name, **attributes})
    for row in comparison.frame.itertuples(index=False):
        cells = dict(zip(HEAD, _row(row), strict=True))
        testcase = ElementTree.SubElement(
            suite,
            "testcase",
            {"classname": xml_text(row.case), "name": xml_text(cells["metric"]), "time": "0"},
        )
        cell_texts = [f"{heading}: {cells[heading]}" for heading in HEAD[3:]]
        text = xml_text("; ".join(cell_texts))
        if row.verdict == "not worse":
            ElementTree.SubElement(testcase, "system-out").text = text
            continue
        result = "failure" if row.verdict == "worse" else "skipped"
        message = f"{cells['verdict']}; change {cells['change']}, bounds {cells['bounds']}"
        ElementTree.SubElement(testcase, result, {"message": xml_text(message)}).text = text
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

    In a CI job with a summary file (environment variable GITHUB_STEP_SUMMARY), the Markdown is appended to that file.

    Parameters
    ----------
    comparison : ResultComparison
        The comparison.
    md, xml : Path, optional
        Markdown and JUnit files.

    Returns
    -------
    list of Path
        The written files, including the summary file.

    Raises
    ------
    InputError
        A file cannot be written.
    """
    paths = []
    if md is not None:
        paths.append(_write_text(md, "w", markdown(comparison)))
    if xml is not None:
        paths.append(_write_text(xml, "w", junit(comparison)))
    summary = os.environ.get("GITHUB_STEP_SUMMARY")
    if summary:
        paths.append(_write_text(Path(summary), "a", markdown(comparison) + "\n"))
    return paths


def _write_text(path: Path, mode: str, text: str) -> Path:
    """Write ("w") or append ("a") a text to a file and return the file. Its folder is created if necessary."""
    with writing(path, "cannot be written"):
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open(mode, encoding="utf-8") as file:
            file.write(text)
    return path


def keep_base(results: Path | str | Tables, folder: Path | str) -> Path:
    """Copy the results that a later comparison needs into a folder small enough for a repository; return the folder.

    Without Monte Carlo runs, the covariance history is copied too, because the comparison then uses it.

    Raises
    ------
    InputError
        A file of the results is damaged.
    """
    tables = load(results)
    target = owned_folder(folder, "base")
    if not tables.campaign:  # reading the campaign first rejects damaged results before they are copied
        raise damaged_file_error(tables.folder / RESOLVED, "it states nothing")
    has_runs = int(tables.cases.run_count.sum()) > 0
    names = KEPT if has_runs else (*KEPT, *KEPT_WITHOUT_RUNS)
    with writing(folder, "the base cannot be kept there"):
        files = {RESOLVED: (tables.folder / RESOLVED).read_bytes()}
        for name in names:
            # results of an older version may lack a table; a comparison that needs it reports this
            if has_table(tables.folder, name):
                files[f"{name}.parquet"] = _table_bytes(tables.folder, name)
        manifest = {name: value for name, value in tables.manifest.items() if name not in _OF_ONE_MACHINE}
        manifest["results_version"] = RESULTS_VERSION  # of the tables as kept
        manifest["across_machines"] = across_machines()
        manifest[DIGESTS] = {name: digest(file_bytes) for name, file_bytes in files.items()}
        files[MANIFEST] = (json.dumps(manifest, indent=2, sort_keys=True) + "\n").encode()
        target.publish("base", files)
    return target.folder


def _table_bytes(folder: Path, name: str) -> bytes:
    """Return a stored table as a Parquet file; of the reference trajectory only every 20th row."""
    import pyarrow.parquet as pq

    table = stored_table(folder, name)
    if name == "reference":
        table = table.take(list(range(0, table.num_rows, _KEPT_EVERY)))
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()
