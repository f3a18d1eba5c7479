"""Verbs that compute: run, check, plan, replay."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import (
    CampaignFile,
    Debug,
    Jobs,
    Json,
    Out,
    Sets,
    app,
    check_jobs,
    errors,
    leave_with_answer,
    print_json,
    records,
    say,
)

if TYPE_CHECKING:
    from lvnav_trade.campaign.definition.schema import Campaign


_MOST = 10
"""Failed runs that are listed one by one."""


@app.command()
def run(
    campaign: CampaignFile,
    sets: Sets = None,
    out: Out = None,
    jobs: Jobs = -1,
    fresh: Annotated[bool, typer.Option("--fresh/--resume", help="begin again, or go on with what is there")] = False,
    fail_fast: Annotated[bool, typer.Option("--fail-fast", help="stop at the first failed run")] = False,
    report: Annotated[bool, typer.Option("--report/--no-report", help="build the report at the end")] = True,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="no progress")] = False,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Run a campaign and build its report.

    Linear covariance answers first, in seconds; then Monte Carlo. The same command resumes what was interrupted.
    """
    with errors(as_json, debug):
        from lvnav_trade import api
        from lvnav_trade.campaign.reading.load import load
        from lvnav_trade.campaign.running.progress import choose

        check_jobs(jobs)
        loaded = load(campaign, sets or ())
        folder = out or Path("results") / loaded.name
        found: list[Any] = []

        def show(answers: Sequence[Any], cases: Sequence[Any]) -> None:
            found.extend(answers)
            if not as_json:
                _print_answers(answers, cases)

        results = api.run(loaded, (), folder, jobs, fresh, fail_fast, report, choose(quiet), show)
        _finish(results, found, report, as_json)


def _finish(results: Any, answers: Sequence[Any], report: bool, as_json: bool) -> NoReturn:
    """Print verdicts and where the results are, and leave with the code that they mean."""
    verdicts = results.requirements
    failures = results.failures
    warned = results.tables.manifest.get("warnings", [])
    code = results.exit_code
    page = results.folder / "report.html" if report else None
    if as_json:
        linear = [{**answer._asdict(), "rows": [list(row) for row in answer.rows]} for answer in answers]
        content = {"folder": str(results.folder), "report": str(page) if page else None, "failures": failures}
        content["warnings"] = warned
        print_json("run", code, **content, covariance=linear, requirements=records(verdicts))
    else:
        if len(verdicts):
            print(table(list(verdicts.columns), [list(row) for row in verdicts.itertuples(index=False)]))
        for line in warned:
            print(f"warning: {line}")
        for line in failures[:_MOST]:
            print(f"failed: {line}")
        if len(failures) > _MOST:
            print(f"failed: {len(failures) - _MOST} more; all of them: column failed of the table runs, or --json")
        print(f"report: {page}" if page else f"results: {results.folder}")
    leave_with_answer(code)


def _print_answers(answers: Sequence[Any], cases: Sequence[Any]) -> None:
    rows = []
    for answer, case in zip(answers, cases, strict=True):
        cells = [f"{true:.3g} ({formal:.3g}) {unit}" for _, true, formal, unit in answer.rows]
        rows.append([case.label, answer.event, *(cells or [answer.error])])
    print("Linear covariance, RMS of the true error (in brackets the formal sigma), 3D:")
    print(table(["case", "at", "position", "velocity", "attitude"], rows))
    sys.stdout.flush()


@app.command()
def check(campaign: CampaignFile, sets: Sets = None, as_json: Json = False, debug: Debug = False) -> None:
    """Validate a campaign without running it."""
    with errors(as_json, debug):
        from lvnav_trade import api
        from lvnav_trade.campaign.definition.axes import cases
        from lvnav_trade.campaign.reading.provided import warnings

        found = cases(api.check(campaign, sets or ()))
        warned = warnings(found)
        good = f"{campaign}: good, {len(found)} {'case' if len(found) == 1 else 'cases'}"
        text = "\n".join([*(f"warning: {line}" for line in warned), good])
        say(
            "check",
            as_json,
            text,
            warnings=warned,
            cases=[{"id": case.id, "label": case.label} for case in found],
            mistakes=[],
        )


@app.command()
def plan(
    campaign: CampaignFile, sets: Sets = None, out: Out = None, as_json: Json = False, debug: Debug = False
) -> None:
    """Show the cases, their cost, and what is already done."""
    with errors(as_json, debug):
        from lvnav_trade import api

        found = api.plan(campaign, sets or (), out)
        rows = table(["case", "label", "runs", "done"], [list(row.values()) for row in found.cases])
        time = f"{found.seconds:.0f} s of one core once compiled"
        cost = f"{time}, {found.disk_mb:.0f} MB of disk, {found.memory_mb:.0f} MB a job"
        say("plan", as_json, f"{rows}\nabout {cost}", **found._asdict())


@app.command()
def replay(
    source: Annotated[str, typer.Argument(metavar="CAMPAIGN|RESULTS", help="campaign file or folder of results")],
    case: Annotated[str, typer.Argument(metavar="CASE", help="digest of a case, its beginning, or its label")],
    number: Annotated[int, typer.Argument(metavar="RUN", help="number of the run, from 0")],
    sets: Sets = None,
    out: Out = None,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Repeat one run, bit for bit, and keep every step."""
    with errors(as_json, debug):
        from lvnav_trade.campaign.definition.axes import cases
        from lvnav_trade.campaign.running import replay as again

        loaded, folder = _campaign_of(source, sets or ())
        chosen = again.find(cases(loaded), case)
        found = again.replay(loaded, chosen, number)
        trace = again.write_trace(found, out or folder, chosen, number)
        if as_json:
            events = [{"event": e, "t_s": t, "errors": sizes, "units": units} for e, t, sizes, units in found.at_events]
            content = {"case": chosen.id, "label": chosen.label, "run": number, "failure": found.failure}
            print_json("replay", 0, **content, events=events, trace=str(trace))
            return
        rows = [
            [event, f"{t:.3f} s", *(f"{sizes[name]:.6g} {units[name]}" for name in sizes)]
            for event, t, sizes, units in found.at_events
        ]
        print(f"{chosen.label}, run {number}{f': {found.failure}' if found.failure else ''}")
        print(table(["event", "t", "position", "velocity", "attitude"], rows))
        print(f"trace: {trace}")


def _campaign_of(source: str, sets: Sequence[str]) -> tuple[Campaign, Path]:
    """Return the campaign of a file or of a folder of results, and the folder of its results."""
    from lvnav_trade.campaign.reading.load import load
    from lvnav_trade.errors import InputError

    folder = Path(source)
    if not folder.is_dir():
        loaded = load(source, sets)
        return loaded, Path("results") / loaded.name
    frozen = folder / "campaign.resolved.yaml"
    if not frozen.is_file():
        raise InputError(f"{folder}: no results here (no campaign.resolved.yaml)")
    return load(frozen, sets), folder
