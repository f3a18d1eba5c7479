"""The verb of designs: cases."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import VerbResult, file_option, verb
from lvnav_trade.quantities.errors import InputError

_ROWS = 20
_WIDE = ("label", "limiting_requirement")  # texts too wide for a terminal


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
    written = str(result.write(out)) if out is not None else None
    content = {
        "cases": json.loads(result.rows.to_json(orient="records", double_precision=15)),
        "columns": result.columns.to_dict("records"),
        "total": result.total,
        "written": written,
    }
    if units:
        return VerbResult(table(["column", "unit", "meaning"], list(result.columns.itertuples(index=False))), content)
    lines = [_shown(result, limit, bool(names))]
    more = len(result.rows) - limit
    lines.append(f"{len(result.rows)} of {result.total} cases{f', {limit} of them shown' if more > 0 else ''}")
    lines += [f"written: {written}"] if written else []
    return VerbResult("\n".join(lines), content)


def _shown(found: Any, limit: int, is_chosen: bool) -> str:
    """Return the first rows as a table; unless the user has chosen columns, only the most informative columns."""
    omitted = ("_formal_", "_probability_", "_verdict", "_count")
    rows = found.rows.head(limit)
    columns = [
        name for name in rows if is_chosen or not (name in _WIDE or any(fragment in name for fragment in omitted))
    ]
    names = [name for name in columns if is_chosen or not (rows[name].astype(str) == "").all()]
    head = [name if is_chosen else name.removeprefix("axis_") for name in names]
    return table(head, list(rows[names].itertuples(index=False, name=None)))
