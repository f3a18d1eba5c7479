"""The command that reproduces a publication: study."""

from pathlib import Path
from typing import Annotated, Any

import typer

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import Answer, Jobs, Json, verb


@verb()
def study(
    folder: Annotated[
        str, typer.Argument(metavar="FOLDER", help="folder of campaigns, or one of the tool's: conae, drdc, gains")
    ],
    keep: Annotated[Path, typer.Option("--keep", metavar="FOLDER", help="where the study's report goes")],
    runs: Annotated[int | None, typer.Option("--runs", help="runs per case, in place of the campaigns' own")] = None,
    out: Annotated[Path, typer.Option("--out", help="folder of the results", show_default="results/FOLDER")] = Path(),
    fresh: Annotated[bool, typer.Option("--fresh/--resume", help="begin again, or go on with what is there")] = False,
    only_page: Annotated[bool, typer.Option("--only-page", help="make the report from existing results")] = False,
    jobs: Jobs = -1,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="no progress")] = False,
    as_json: Json = False,
) -> Answer:
    """Run every campaign of a folder and write one report.

    Published numbers stand beside ours. What a campaign answers (requirements violated or undecided) is no failure
    here; exit code 4 where runs failed.
    """
    from lvnav_trade import api
    from lvnav_trade.campaign.running.progress import choose

    def show(name: str, results: Any) -> None:
        if not as_json and not quiet:
            print(f"{name}: {len(results.tables.cases)} cases, {len(results.failures)} failed runs", flush=True)

    place = out if out != Path() else None
    found = api.study(folder, keep, runs, place, jobs, fresh, only_page, lambda: choose(quiet), show)
    rows = [[name, *map(str, counts)] for name, counts in found.campaigns.items()]
    failed = [f"failed: {line}" for line in found.failures]
    text = "\n".join([*failed, table(["campaign", "stated", "as published"], rows), f"kept: {found.page}"])
    content: dict[str, Any] = {"page": str(found.page), "failures": found.failures, "campaigns": found.campaigns}
    content |= {"published": found.published, "in_band": found.in_band}
    return Answer(text, content, api.FAILED if found.failures else api.MET)
