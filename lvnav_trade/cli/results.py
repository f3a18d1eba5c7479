"""Commands that read results: report, compare, keep-base, kml."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import Debug, Jobs, Json, app, check_jobs, errors, leave_with_answer, print_json, say


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(metavar="RESULTS")],
    keep: Annotated[
        Path | None,
        typer.Option("--keep", metavar="FOLDER", help="copy the Markdown report, figures and CSV tables here"),
    ] = None,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Build the report again from results."""
    with errors(as_json, debug):
        from lvnav_trade import api
        from lvnav_trade.store.contents import owned

        api.load(folder)
        if keep is not None:
            owned(keep, "report")  # refused before the report is built
        page = api.build_report(folder)
        kept = api.keep_report(folder, keep) if keep is not None else None
        text = f"report: {page}" + (f"\nkept: {kept}" if kept else "")
        say("report", as_json, text, report=str(page), kept=str(kept) if kept else None)


@app.command()
def compare(
    base: Annotated[str, typer.Argument(metavar="BASE", help="folder of results, or a campaign, which is run first")],
    candidate: Annotated[str, typer.Argument(metavar="CANDIDATE", help="the same")],
    effect: Annotated[
        list[str] | None,
        typer.Option("--effect", metavar="METRIC=AMOUNT", help="smallest change of interest: velocity_error_3d=5%"),
    ] = None,
    confidence: Annotated[float | None, typer.Option("--confidence", help="of the verdicts [default: 0.95]")] = None,
    maps: Annotated[
        list[str] | None, typer.Option("--map", metavar="BASE:CANDIDATE", help="cases or levels of other names")
    ] = None,
    md: Annotated[Path | None, typer.Option("--md", metavar="FILE", help="write the comparison in Markdown")] = None,
    junit: Annotated[Path | None, typer.Option("--junit", metavar="FILE", help="write JUnit XML")] = None,
    jobs: Jobs = -1,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Compare two result sets run by run (paired).

    Exit code 0 nothing worse, 1 worse, 2 no comparison, 3 undecided.
    """
    with errors(as_json, debug):
        from lvnav_trade import api
        from lvnav_trade.report import compare as comparison

        check_jobs(jobs)
        found = api.compare(base, candidate, effect or (), confidence, comparison.parse_map(maps or ()), jobs)
        written = comparison.write(found, md, junit)
        code = comparison.exit_code(found)
        if as_json:
            print_json("compare", code, **comparison.content(found), written=written)
        else:
            print(table(comparison.HEAD, comparison.rows(found)), *found.notes, comparison.answer(found), sep="\n")
        leave_with_answer(code)


@app.command("keep-base")
def keep_base(
    folder: Annotated[Path, typer.Argument(metavar="RESULTS")],
    target: Annotated[Path, typer.Argument(metavar="FOLDER", help="where, such as a folder of the repository")],
    debug: Debug = False,
) -> None:
    """Copy of results what `compare` needs of a base.

    Runs and events, some hundred kilobytes.
    """
    with errors(False, debug):
        from lvnav_trade import api

        print(f"base: {api.keep_base(folder, target)}")


@app.command()
def kml(
    source: Annotated[str, typer.Argument(metavar="CARD|RESULTS", help="trajectory card, or folder of results")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="file to write")],
    ellipses: Annotated[bool, typer.Option("--ellipses", help="draw 3-sigma position errors, of results")] = False,
    every: Annotated[float, typer.Option("--every", help="seconds between ellipses")] = 60.0,
    magnify: Annotated[float, typer.Option("--magnify", help="draw ellipses so many times as large")] = 1.0,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Write trajectories as KML, for viewers of the Earth."""
    with errors(as_json, debug):
        from lvnav_trade import api

        written = str(api.write_kml(source, output, ellipses, every, magnify))
        say("kml", as_json, f"kml: {written}", kml=written)
