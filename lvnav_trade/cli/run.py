"""Verbs of campaigns: run, check, plan, replay, status; fields, schema and cards; study."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from lvnav_trade.campaign.text import frame_table, table
from lvnav_trade.cli.answers import (
    answer_of,
    check_preferred,
    combine_components,
    covariance_collector,
    shard_result,
    with_ranking,
)
from lvnav_trade.cli.clusters import Backend, workers
from lvnav_trade.cli.console import CampaignFile, Jobs, Json, Out, Quiet, Sets, VerbResult, folder_option, verb
from lvnav_trade.quantities.errors import InputError

if TYPE_CHECKING:
    from lvnav_trade.api import Plan

CaseOf = Annotated[
    str | None,
    typer.Option("--case", metavar="CASE", help="only this case: its digest, the beginning of it, or its label"),
]
Fresh = Annotated[bool, typer.Option("--fresh/--resume", help="start again, or resume")]
Strict = Annotated[
    bool, typer.Option("--strict", help="exit code 2 if there are too few runs to demonstrate a requirement")
]
_LISTED = 20  # largest number of cases that `plan` lists individually
VERDICTS = ("passed", "failed", "not checked")
_ERROR_COLUMNS = ["event", "t", "position", "velocity", "attitude"]


class RunVerbOptions(NamedTuple):
    """Options of `run`: extent of the computation, and location of the results."""

    out: Out = None
    case: CaseOf = None
    fresh: Fresh = False
    fail_fast: Annotated[bool, typer.Option("--fail-fast", help="stop at the first failed run")] = False
    report: Annotated[bool, typer.Option("--report/--no-report", help="build the report at the end")] = True
    shard: Annotated[
        str | None,
        typer.Option("--shard", metavar="I/N", help="compute share I of N for a batch system; `merge` combines them"),
    ] = None
    prefer: Annotated[
        list[str] | None,
        typer.Option("--prefer", metavar="NAME", help="rank cases by cost, mass, power, volume or error; repeatable"),
    ] = None
    copy_to: Annotated[
        str,
        typer.Option("--copy-to", metavar="URL", help="copy results to a location such as s3://bucket/demo (fsspec)"),
    ] = ""


class WorkerOptions(NamedTuple):
    """Options of `run`: the workers."""

    jobs: Jobs = -1
    backend: Annotated[Backend, typer.Option("--backend", help="workers to use")] = Backend.PROCESSES
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler [default: a cluster on this machine]"),
    ] = None


@verb("demo --set monte_carlo.runs=50")
def run(
    campaign: CampaignFile,
    options: RunVerbOptions,
    force: WorkerOptions,
    sets: Sets = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> VerbResult:
    """Run a campaign and build its report.

    Linear covariance comes first, within seconds, then Monte Carlo. The same command resumes an interrupted campaign.
    """
    from lvnav_trade import api
    from lvnav_trade.api.campaigns import Task, carry_out
    from lvnav_trade.campaign.reading.load import load
    from lvnav_trade.campaign.reading.written_cases import single_case
    from lvnav_trade.campaign.running.progress import choose

    loaded_campaign = load(campaign, sets or ())
    if options.case is not None:
        loaded_campaign = single_case(*api.case_of(loaded_campaign, (), options.case))
    check_preferred(options.prefer or ())
    folder = options.out or Path("results") / loaded_campaign.name
    if options.shard is not None:
        uses_cluster = force.scheduler is not None or force.backend != Backend.PROCESSES
        if options.prefer or options.copy_to or uses_cluster:
            raise InputError("--shard: goes without --prefer, --copy-to, --backend and --scheduler")
        shard_outcome = api.run_shard(
            loaded_campaign, options.shard, (), folder, force.jobs, options.fresh, options.fail_fast, choose(quiet)
        )
        return shard_result(shard_outcome)
    covariance_rows, show = covariance_collector(as_json or loaded_campaign.is_space)
    with workers(force.backend, force.scheduler, folder, force.jobs) as (place, count):
        task = Task(
            count, options.fresh, options.fail_fast, options.report, options.copy_to, choose(quiet), on_answers=show
        )
        results = carry_out(loaded_campaign, place, task)
    answer = answer_of(results, covariance_rows, options.report)
    if options.prefer:
        return with_ranking(answer, results, options.prefer)
    return answer


@verb("my_campaign.yaml --strict")
def check(campaign: CampaignFile, sets: Sets = None, strict: Strict = False) -> VerbResult:
    """Validate a campaign without running it."""
    from lvnav_trade import api
    from lvnav_trade.campaign.reading.flights import remark_lines

    checked_campaign = api.check(campaign, sets or (), strict)
    remarks = {name: list(getattr(checked_campaign, name)) for name in ("beyond_limits", "warnings", "notes")}
    if checked_campaign.designs:
        size = f"{checked_campaign.designs} designs"
    else:
        size = "1 case" if len(checked_campaign.cases) == 1 else f"{len(checked_campaign.cases)} cases"
    lines = [*remark_lines(remarks), f"{campaign}: good, {size}"]
    case_list = [{"id": case.id, "label": case.label} for case in checked_campaign.cases]
    return VerbResult("\n".join(lines), {**remarks, "cases": case_list, "mistakes": []})


@verb("demo")
def plan(campaign: CampaignFile, sets: Sets = None, out: Out = None, strict: Strict = False) -> VerbResult:
    """Show the cases, their cost and the stored runs."""
    from lvnav_trade import api
    from lvnav_trade.campaign.reading.flights import remark_lines

    campaign_plan = api.plan(campaign, sets or (), out, strict)
    lines = [_planned_cases(campaign_plan), *remark_lines({"warnings": campaign_plan.warnings}), campaign_plan.cost]
    content = {
        "cases": campaign_plan.cases.to_dict("records"),
        "blocks": campaign_plan.blocks,
        "seconds": campaign_plan.seconds,
        "disk_mb": campaign_plan.disk_mb,
        "memory_mb": campaign_plan.memory_mb,
        "warnings": list(campaign_plan.warnings),
        "designs": None if campaign_plan.designs is None else campaign_plan.designs._asdict(),
    }
    return VerbResult("\n".join(lines), content)


def _planned_cases(plan: Plan) -> str:
    """Return the planned cases as a table, or in one line if they are too many for a table."""
    cases, space = plan.cases, plan.designs
    if space is not None:
        runs = f", {space.runs} runs of these at most" if space.runs else ""
        return f"{space.designs} designs: a row for each (store: {space.store}), {space.whole} whole at most{runs}"
    if len(cases) <= _LISTED:
        return table(["case", "label", "runs", "done"], [list(row) for row in cases.itertuples(index=False)])
    n_run, n_done = int(cases["runs"].sum()), int(cases["done"].sum())
    extent = f"{n_run} runs, {n_done} of them done" if n_run else "linear covariance alone"
    return f"{len(cases)} cases, {extent}; `--json` lists the cases"


@verb("smoke")
def selfcheck(
    campaign: CampaignFile,
    sets: Sets = None,
    jobs: Jobs = -1,
    quiet: Quiet = False,
) -> VerbResult:
    """Check the consistency of every case.

    Error definitions, Jacobians against differences, linear against nonlinear propagation over gaps, innovations and
    gate, statistics of the draws. Exit code 0: all passed; 1: one failed; 2: input error in the campaign.
    """
    from lvnav_trade import api
    from lvnav_trade.campaign.running.progress import choose

    outcome = api.selfcheck(campaign, sets or (), jobs, choose(quiet))
    counts = {verdict: outcome.count(verdict) for verdict in VERDICTS}
    summary = ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count)
    content = {
        "counts": counts,
        "checks": [result.check.content() | {"cases": list(result.cases)} for result in outcome.checks],
    }
    text = f"{frame_table(outcome.frame)}\n{summary}"
    return VerbResult(text, content, api.MET if outcome.passed else api.VIOLATED)


@verb('results/demo "imu=tactical_mems, filter=tight" 17')
def replay(
    source: Annotated[str, typer.Argument(metavar="CAMPAIGN|RESULTS", help="campaign file or folder of results")],
    case: Annotated[str, typer.Argument(metavar="CASE", help="digest of a case, its beginning, or its label")],
    number: Annotated[int, typer.Argument(metavar="RUN", help="number of the run, from 0")],
    sets: Sets = None,
    out: Out = None,
) -> VerbResult:
    """Repeat one run bit for bit and save every step."""
    from lvnav_trade import api

    replayed_run = api.replay(source, case, number, sets or (), out)
    events, rows = [], []
    for (event, t), errors in replayed_run.events.groupby(["event", "t_s"], sort=False):
        by_quantity = errors.set_index("quantity")
        sizes, units = by_quantity.error.to_dict(), by_quantity.unit.to_dict()
        events.append({"event": event, "t_s": t, "errors": sizes, "units": units})
        cells = [f"{sizes[quantity]:.6g} {units[quantity]}" for quantity in sizes]
        rows.append([event, f"{t:.3f} s", *cells])
    title = f"{replayed_run.label}, run {number}"
    if replayed_run.failure:
        title += f": {replayed_run.failure}"
    text = f"{title}\n{table(_ERROR_COLUMNS, rows)}\ntrace: {replayed_run.trace}"
    content = {
        "case": replayed_run.case,
        "label": replayed_run.label,
        "run": number,
        "failure": replayed_run.failure,
        "events": events,
        "trace": str(replayed_run.trace),
    }
    return VerbResult(text, content)


@verb("results/demo")
def status(folder: Annotated[Path, typer.Argument(metavar="RESULTS")]) -> VerbResult:
    """Show a campaign's progress: running, finished, damaged.

    Blocks and tables are checked.
    """
    from lvnav_trade import api

    progress = api.status(folder)
    content = progress._asdict()
    content["cases"] = [case._asdict() for case in progress.cases]
    return VerbResult(progress.text, content)


@verb("imu.gyro")
def fields(
    path: Annotated[
        str | None, typer.Argument(metavar="PATH", help="filter, receiver.clock, faults; the whole campaign if absent")
    ] = None,
) -> VerbResult:
    """List the fields at a path of a campaign.

    For each field: accepted values, default and meaning. If there are several kinds of settings, all are listed.
    """
    from lvnav_trade import api

    documents = api.fields(path or "")
    blocks, field_tables = [], []
    for document in documents:
        title = f"kind: {document.kind} - {document.title}" if document.kind else document.title
        rows = []
        for row in document.rows:
            value_text = "; ".join(filter(None, (row.type, row.meaning)))
            rows.append([row.field, row.default, value_text])
        blocks.append(f"{title}\n{table(['field', 'default', 'takes'], rows, _width())}")
        field_tables.append(document._asdict() | {"rows": [row._asdict() for row in document.rows]})
    return VerbResult("\n\n".join(blocks), {"path": path or "", "parts": field_tables})


@verb("> campaign.schema.json", with_json=False)
def schema() -> VerbResult:
    """Print the JSON Schema of campaign files, for editors."""
    from lvnav_trade import api

    return VerbResult(json.dumps(api.schema(), indent=2))


def _width() -> int:
    """Return the width of the terminal; 100 if the output is not a terminal."""
    return shutil.get_terminal_size((100, 24)).columns


def _noun(sentence: str) -> str:
    """Return the object of a docstring's first sentence "Return ...", with a capital."""
    phrase = sentence.removeprefix("Return ")
    return phrase[:1].upper() + phrase[1:]


@verb("imu --long")
def cards(
    name: Annotated[str | None, typer.Argument(metavar="CARD", help="show this card, or list this folder")] = None,
    long: Annotated[bool, typer.Option("--long", help="show the source of the numbers")] = False,
) -> VerbResult:
    """List all cards, those of a folder, or show one."""
    from lvnav_trade import api

    try:
        selected_cards = api.cards(name or "")
    except InputError:  # no folder of this name
        if name is None:
            raise
        text = api.card_text(name)
        return VerbResult(text.removesuffix("\n"), {"name": name, "text": text})
    content = {"cards": [card._asdict() for card in selected_cards]}
    if not long:
        return VerbResult(table(["card", "what"], [[card.name, card.title] for card in selected_cards]), content)
    width = min(_width(), 100)
    entries = []
    for card in selected_cards:
        source = fill(card.source, width, initial_indent="  ", subsequent_indent="  ")
        entries.append(f"{card.name}: {card.title}\n{source}")
    return VerbResult("\n\n".join(entries), content)


@verb("velocity")
def metrics(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="only those whose name contains this")] = None,
) -> VerbResult:
    """List the metrics a campaign can name, then the tables.

    The list is grouped by use, and components of one quantity share a line. With NAME, every metric has its own line.
    """
    from lvnav_trade import api

    listing = api.metrics(name or "")
    blocks = []
    for named_by, metric_rows in listing.metrics.groupby("named_by", sort=False):
        rows = list(metric_rows[["metric", "unit", "meaning"]].itertuples(index=False))
        if not name:
            rows = combine_components(rows)
        blocks.append(f"Named by {named_by}:\n{table(['metric', 'unit', 'meaning'], rows, _width())}")
    if listing.tables:
        table_rows = [[table_name, _noun(text)] for table_name, text in listing.tables.items()]
        blocks.append(f"Tables:\n{table(['table', 'content'], table_rows, _width())}")
    content = {"metrics": listing.metrics.to_dict("records"), "tables": listing.tables}
    return VerbResult("\n\n".join(blocks), content)


class StudyOptions(NamedTuple):
    """Options of `study`."""

    runs: Annotated[int | None, typer.Option("--runs", help="runs per case, instead of the campaigns' numbers")] = None
    out: Annotated[Path | None, folder_option("the results", "results/DIR")] = None
    fresh: Fresh = False
    only_page: Annotated[bool, typer.Option("--only-page", help="only make the report, from existing results")] = False
    jobs: Jobs = -1


@verb("papers/mine --keep reports/mine")
def study(
    folder: Annotated[
        str,
        typer.Argument(metavar="DIR", help="folder with campaigns and a study.yaml, or a shipped study"),
    ],
    keep: Annotated[Path, typer.Option("--keep", metavar="DIR", help="folder of the study's report")],
    options: StudyOptions,
    quiet: Quiet = False,
    as_json: Json = False,
) -> VerbResult:
    """Run every campaign of a folder and write one report.

    Published numbers are compared with ours. Violated or undecided requirements do not change the exit code; it is 4
    if runs failed.
    """
    from lvnav_trade import api
    from lvnav_trade.campaign.running.progress import choose

    def show(name: str, results: Any) -> None:
        if not as_json and not quiet:
            print(f"{name}: {len(results.tables.cases)} cases, {len(results.failures)} failed runs", flush=True)

    watch = api.StudyWatch(lambda: choose(quiet), show)
    result = api.study(folder, keep, options.runs, options.out, options.jobs, options.fresh, options.only_page, watch)
    rows = [[name, *map(str, counts)] for name, counts in result.campaigns.items()]
    lines = [f"failed: {line}" for line in result.failures]
    lines += [table(["campaign", "evidence", "as published"], rows), f"kept: {result.page}"]
    content = {
        "page": str(result.page),
        "failures": result.failures,
        "campaigns": result.campaigns,
        "published": result.published,
        "hold": result.hold,
    }
    return VerbResult("\n".join(lines), content, api.FAILED if result.failures else api.MET)
