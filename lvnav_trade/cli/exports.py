"""Verbs for flight software: export-vectors, export-filter."""

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import CampaignFile, Quiet, Sets, VerbResult, folder_option, verb
from lvnav_trade.cli.results import CaseOf


class TableFormat(StrEnum):
    """Format of tables."""

    CSV = "csv"
    PARQUET = "parquet"


@verb("demo --case 'imu=tactical_mems, filter=tight' -o my_vectors")
def export_vectors(
    campaign: CampaignFile,
    out: Annotated[Path, folder_option("the tables")],
    sets: Sets = None,
    case: CaseOf = None,
    run: Annotated[int, typer.Option("--run", metavar="RUN", help="number of the run, from 0")] = 0,
    kind: Annotated[TableFormat, typer.Option("--format", help="format of the tables")] = TableFormat.CSV,
) -> VerbResult:
    """Write inputs and expected outputs of a filter.

    Use them to test another implementation of the filter: IMU samples, measurements, satellites; estimates and
    covariance before and after the measurements of every epoch. columns.csv states the units.
    """
    from lvnav_trade import api

    vectors = api.export_vectors(campaign, out, case, run, sets or (), kind.value)
    rows = [[f"{name}.{kind.value}", len(frame)] for name, frame in vectors.tables.items()]
    lines = [table(["file", "rows"], rows), f"units: {out / 'columns.csv'}", f"use: {out / 'README.md'}"]
    return VerbResult("\n".join(lines), {"folder": str(out), "run": run, "files": sorted(vectors.files)})


@verb("demo --case 'imu=tactical_mems, filter=tight' -o my_filter --runs 10")
def export_filter(
    campaign: CampaignFile,
    out: Annotated[Path, folder_option("the C files and the runs")],
    sets: Sets = None,
    case: CaseOf = None,
    runs: Annotated[int, typer.Option("--runs", help="runs that are recorded and replayed; 0: C code only")] = 10,
    quiet: Quiet = False,
) -> VerbResult:
    """Write the filter of a case as C99.

    Recorded runs are written too. If this machine has a C compiler (CC, cc, gcc, clang), they are replayed. Each
    estimate must agree with the simulation to a relative error of 1e-9.
    """
    from lvnav_trade import api

    def progress(step: str) -> None:
        if not quiet:
            print(step, file=sys.stderr)

    code = api.export_filter(campaign, out, case, runs, sets or (), progress)
    lines = [f"files: {out}"]
    difference_rows = []
    if code.differences is not None:
        difference_rows = code.differences.to_dict(orient="records")
        by_estimate = code.differences.groupby("estimate", sort=False)
        worst = by_estimate.agg(runs=("run", "nunique"), worst=("difference", "max"))
        rows = [[row.Index, row.runs, f"{row.worst:.1e}"] for row in worst.itertuples()]
        lines.insert(0, table(["estimate", "runs", "largest difference"], rows))
        agreement = "agrees" if code.agrees else "an estimate differs by more than 1e-9 of its size"
        lines.append(f"replayed: {agreement}")
    elif runs:
        lines.append(f"no C compiler is here; where one is: {code.command}")
    content = {
        "folder": str(out),
        "compiler": code.compiler,
        "agrees": code.agrees,
        "replayed": difference_rows,
    }
    return VerbResult("\n".join(lines), content, 0 if code.agrees else 1)
