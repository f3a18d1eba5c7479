"""Mutants of a folder of results, read by every verb that reads results."""

from __future__ import annotations

import json
import random
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from lvnav_trade import api
from lvnav_trade.campaign.running.status import status
from lvnav_trade.report.compare import keep_base
from lvnav_trade.results.tables.parts import paths, span
from lvnav_trade.results.tables.write import open_results
from tests import synthetic
from tests.fuzzing.mutants import Outcome, flipped, mutated, outcome_of

VALUES: tuple[Any, ...] = (
    "<script>x</script>", "../../x", "a\nb", "\x1b[31m", None, True, -1, 0, 10**30, [], {}, "x" * 9_000, [1], "",
)  # fmt: skip
_GOOD: list[Path] = []


def good() -> Path:
    """Return a folder of sound results, which is made once."""
    if not _GOOD:
        _GOOD.append(synthetic.results(Path(tempfile.mkdtemp(prefix="results-")) / "good", n_run=12))
    return _GOOD[0]


VERBS: tuple[Callable[[Path, Path], object], ...] = (
    lambda folder, _: status(folder),
    lambda folder, _: api.load(folder).requirements,
    lambda folder, _: api.report(folder),
    lambda folder, out: keep_base(folder, out / "base"),
    lambda folder, out: api.kml(folder, out / "flight.kml", ellipses=True),
    lambda folder, _: api.compare(good(), folder),
    lambda folder, _: api.compare(folder, good()),
)


def resume(folder: Path) -> None:
    """Read what `run` and `plan` read of results before they go on: the campaign, and which blocks are there."""
    for case, _ in synthetic.CASES:
        _ = [span(path) for path in paths(folder / "parts" / case.id)]
    written = open_results(folder, "synthetic", synthetic.CAMPAIGN, {"seed": 7}, "resume")
    for case, _ in synthetic.CASES:
        written.block_spans(case.id)


def _nodes(tree: Any) -> Iterator[tuple[Any, Any]]:
    keys = list(tree) if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else ()
    for key in keys:
        yield tree, key
        yield from _nodes(tree[key])


def _mutate_json(path: Path, draw: random.Random) -> str:
    tree = json.loads(path.read_text())
    holder, key = draw.choice(list(_nodes(tree)))
    if draw.random() < 0.3:
        del holder[key]
        change = f"without {key}"
    else:
        holder[key] = draw.choice(VALUES)
        change = f"{key} = {str(holder[key])[:40]!r}"
    path.write_text(json.dumps(tree))
    return f"{path.name}: {change}"


def _mutate_table(path: Path, draw: random.Random) -> str:
    table = pq.read_table(path)
    at = draw.randrange(table.num_columns)
    name, kind, rows = table.column_names[at], table.schema.field(at).type, table.num_rows
    what = draw.choice(("rename", "drop", "texts", "empty", "nulls", "twice", "values"))
    if what == "rename":
        table = table.rename_columns([f"{one}x" if k == at else one for k, one in enumerate(table.column_names)])
    elif what == "drop":
        table = table.drop_columns([name])
    elif what == "texts":
        table = table.set_column(at, name, pa.array(["<b>x"] * rows))
    elif what == "empty":
        table = table.slice(0, 0)
    elif what == "nulls":
        table = table.set_column(at, name, pa.nulls(rows, kind))
    elif what == "twice":
        table = pa.concat_tables([table, table])
    elif pa.types.is_floating(kind):
        table = table.set_column(at, name, pa.array([draw.choice((float("nan"), float("inf"), -1e308))] * rows, kind))
    elif pa.types.is_integer(kind):
        table = table.set_column(at, name, pa.array([draw.choice((-1, 100_000))] * rows).cast(kind, safe=False))
    elif pa.types.is_string(kind):
        table = table.set_column(
            at, name, pa.array([draw.choice(("<script>", "\x1b[2J", "a\nb|c", "../.."))] * rows, kind)
        )
    pq.write_table(table, path)
    return f"{path.name}: {what} {name}"


def mutate(folder: Path, draw: random.Random) -> str:
    """Change one file of results, and say what was changed."""
    tables = sorted(folder.glob("*.parquet"))
    kind = draw.choice(("table", "table", "bytes", "bytes", "manifest", "contents", "campaign", "gone", "link"))
    if kind == "table":
        return _mutate_table(draw.choice(tables), draw)
    if kind in ("manifest", "contents"):
        return _mutate_json(folder / f"{kind}.json", draw)
    if kind == "campaign":
        path = folder / "campaign.resolved.yaml"
        text, change = mutated(path.read_text(), draw)
        path.write_text(text, encoding="utf-8", errors="replace")
        return f"{path.name}: {change}"
    path = draw.choice([one for one in sorted(folder.rglob("*")) if one.is_file()])
    if kind == "bytes":
        content, change = flipped(path.read_bytes() or b"x", draw)
        path.write_bytes(content)
        return f"{path.name}: {change}"
    path.unlink()
    if kind == "link":
        path.symlink_to(draw.choice(("/nonexistent/x", "/dev/zero", "/etc/hostname", ".")))
    return f"{path.name}: {kind}"


def try_one(seed: int, folder: Path) -> Outcome:
    """Make the mutant of a seed, read it by one verb, and as a run that goes on."""
    place = folder / "results"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    shutil.copytree(good(), place)
    draw = random.Random(f"results {seed}")
    change = mutate(place, draw)
    number = seed % len(VERBS)
    found = outcome_of(lambda: VERBS[number](place, folder), f"verb {number}, {change}")
    outcome_of(lambda: resume(place), change)
    return found
