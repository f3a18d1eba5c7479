"""Verb that lists cases and designs: cases."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import VerbResult, file_option, verb
from lvnav_trade.quantities.errors import InputError

_ROWS = 20
_WIDE = ("label", "limiting_requirement")  # texts too wide for a terminal
_OMITTED = ("_formal_", "_probability_", "_verdict", "_count")  # parts of the names of further columns


@verb('results/demo --where "velocity < 0.5 m/s" --sort position')
def cases(
    folder: Annotated[Path, typer.Argument(metavar="RESULTS")],
    where: Annotated[
        list[str] | None,
        typer.Option("--where", metavar="CONDITION", help='such as "velocity < 0.1 m/s and imu == tactical_fog"'),
    ] = None,
    sort: Annotated[
        list[str] | None,
        typer.Option("--sort", metavar="COLUMN", help="smallest first; -COLUMN: largest first; repeatable"),
    ] = None,
    columns: Annotated[
        str | None, typer.Option("--columns", metavar="A,B,...", help="columns that are shown and written")
    ] = None,
    limit: Annotated[int, typer.Option("--limit", metavar="N", help="rows that are shown")] = _ROWS,
    out: Annotated[Path | None, file_option("write all cases to this .csv or .parquet")] = None,
    units: Annotated[bool, typer.Option("--units", help="list the columns with unit and meaning instead")] = False,
) -> VerbResult:
    """List cases: errors, verdicts, cost.

    One row per case, with the levels of its axes; numbers in SI. A column may be named without axis_ and without
    its unit.
    """
    from lvnav_trade import api

    if limit < 1:
        raise InputError(f"--limit {limit}: give a number of rows, at least 1")
    names = [name.strip() for name in columns.split(",")] if columns is not None else []
    result = api.cases(folder, where or (), sort or (), names)
    table_file = str(result.write(out)) if out is not None else None
    content = {
        "cases": json.loads(result.rows.to_json(orient="records", double_precision=15)),
        "columns": result.columns.to_dict("records"),
        "total": result.total,
        "written": table_file,
    }
    if units:
        rows = list(result.columns.itertuples(index=False))
        return VerbResult(table(["column", "unit", "meaning"], rows), content)
    summary = f"{len(result.rows)} of {result.total} cases"
    if len(result.rows) > limit:
        summary += f", {limit} of them shown"
    lines = [_first_rows(result, limit, bool(names)), summary]
    if table_file:
        lines.append(f"written: {table_file}")
    return VerbResult("\n".join(lines), content)


def _first_rows(result: Any, limit: int, is_chosen: bool) -> str:
    """Return the first rows as a table.

    Parameters
    ----------
    result : api.Designs
        Selected cases.
    limit : int
        Number of rows.
    is_chosen : bool
        Whether the user has chosen the columns; otherwise only the most informative columns are shown.
    """
    rows = result.rows.head(limit)
    if is_chosen:
        return table(list(rows.columns), list(rows.itertuples(index=False, name=None)))
    names = [name for name in rows if _is_informative(name) and not (rows[name].astype(str) == "").all()]
    header = [name.removeprefix("axis_") for name in names]
    return table(header, list(rows[names].itertuples(index=False, name=None)))


def _is_informative(name: str) -> bool:
    """Whether a column is shown by default."""
    return name not in _WIDE and not any(fragment in name for fragment in _OMITTED)
