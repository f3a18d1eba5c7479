"""Verbs of campaigns: run, check, plan, replay, status; fields, schema and cards; study."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.answers import answer_of, check_preferred, shared, shown, with_ranking
from lvnav_trade.cli.clusters import Backend, workers
from lvnav_trade.cli.console import Answer, CampaignFile, Jobs, Json, Out, Sets, verb
from lvnav_trade.errors import InputError

if TYPE_CHECKING:
    from lvnav_trade.campaign.definition.schema import Campaign

Strict = Annotated[
    bool, typer.Option("--strict", help="exit code 2 where the runs cannot show a requirement, however good they are")
]
VERDICTS = ("passed", "failed", "not checked")


@verb("demo --set monte_carlo.runs=50")
def run(
    campaign: CampaignFile,
    sets: Sets = None,
    out: Out = None,
    jobs: Jobs = -1,
    fresh: Annotated[bool, typer.Option("--fresh/--resume", help="begin again, or go on with what is there")] = False,
    fail_fast: Annotated[bool, typer.Option("--fail-fast", help="stop at the first failed run")] = False,
    report: Annotated[bool, typer.Option("--report/--no-report", help="build the report at the end")] = True,
    shard: Annotated[
        str | None,
        typer.Option("--shard", metavar="I/N", help="do share I of N, for a batch system; `merge` puts all together"),
    ] = None,
    backend: Annotated[Backend, typer.Option("--backend", help="what does the work")] = Backend.PROCESSES,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="of Dask [default: a cluster of this machine]")
    ] = None,
    prefer: Annotated[
        list[str] | None,
        typer.Option("--prefer", metavar="NAME", help="rank cases by cost, mass, power, volume or error; repeatable"),
    ] = None,
    copy_to: Annotated[
        str, typer.Option("--copy-to", metavar="URL", help="copy results to such as s3://bucket/demo (fsspec)")
    ] = "",
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="no progress")] = False,
    as_json: Json = False,
) -> Answer:
    """Run a campaign and build its report.

    Linear covariance answers first, in seconds; then Monte Carlo. The same command resumes what was interrupted.
    """
    from lvnav_trade import api
    from lvnav_trade.campaign.reading.load import load
    from lvnav_trade.campaign.running.progress import choose

    loaded = load(campaign, sets or ())
    check_preferred(prefer or ())
    folder = out or Path("results") / loaded.name
    if shard is not None:
        from lvnav_trade.clusters import run_shard

        if prefer or copy_to or scheduler is not None or backend != Backend.PROCESSES:
            raise InputError("--shard: goes without --prefer, --copy-to, --backend and --scheduler")
        return shared(run_shard(loaded, shard, (), folder, jobs, fresh, fail_fast, choose(quiet)))
    found, show = shown(as_json)
    with workers(backend, scheduler, folder, jobs) as (place, count):
        results = api.run(loaded, (), place, count, fresh, fail_fast, report, choose(quiet), show, (), copy_to)
    answer = answer_of(results, found, report)
    return with_ranking(answer, results, prefer) if prefer else answer


@verb("my_campaign.yaml --strict")
def check(campaign: CampaignFile, sets: Sets = None, strict: Strict = False) -> Answer:
    """Validate a campaign without running it."""
    from lvnav_trade import api
    from lvnav_trade.campaign.definition.axes import cases
    from lvnav_trade.campaign.reading.flights import remark_lines

    loaded, remarks = api.examine(campaign, sets or ())
    if strict:
        api.refuse_undemonstrable(loaded)
    found = cases(loaded)
    good = f"{campaign}: good, {len(found)} {'case' if len(found) == 1 else 'cases'}"
    known = [{"id": case.id, "label": case.label} for case in found]
    return Answer("\n".join([*remark_lines(remarks), good]), {**remarks, "cases": known, "mistakes": []})


@verb("demo")
def plan(campaign: CampaignFile, sets: Sets = None, out: Out = None, strict: Strict = False) -> Answer:
    """Show the cases, their cost, and what is already done."""
    from lvnav_trade import api
    from lvnav_trade.campaign.reading.flights import remark_lines
    from lvnav_trade.campaign.reading.load import load

    found = api.plan(campaign, sets or (), out)
    if strict:
        api.refuse_undemonstrable(load(campaign, sets or ()))
    rows = table(["case", "label", "runs", "done"], [list(row.values()) for row in found.cases])
    cost = f"{found.disk_mb:.0f} MB of disk, {found.memory_mb:.0f} MB a job"
    lines = [rows, *remark_lines({"warnings": found.warnings})]
    return Answer(
        "\n".join([*lines, f"about {found.seconds:.0f} s of one core once compiled, {cost}"]), found._asdict()
    )


@verb("smoke")
def selfcheck(
    campaign: CampaignFile,
    sets: Sets = None,
    jobs: Jobs = -1,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="no progress")] = False,
) -> Answer:
    """Check the configuration of every case by itself.

    Error definitions, Jacobians against differences, linear against nonlinear propagation over gaps, innovations and
    gate, statistics of the draws. Exit code 0 all passed, 1 one failed, 2 a mistake in the campaign.
    """
    from lvnav_trade import api
    from lvnav_trade.campaign.running.progress import choose

    found = api.selfcheck(campaign, sets or (), jobs, choose(quiet))
    every = len({label for one in found for label in one.cases})
    rows = [
        ["all" if len(cases) == every else "; ".join(cases), check.kind, check.what, *check.words, check.where]
        for check, cases in found
    ]
    counts = {verdict: sum(one.check.verdict == verdict for one in found) for verdict in VERDICTS}
    said = ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count)
    lines = [table(["case", "check", "of", "figure", "allowed", "verdict", "where"], rows), said]
    content = {"counts": counts, "checks": [one.check.content() | {"cases": list(one.cases)} for one in found]}
    return Answer("\n".join(lines), content, api.VIOLATED if counts["failed"] else api.MET)


@verb('results/demo "imu=tactical_mems, filter=tight" 17')
def replay(
    source: Annotated[str, typer.Argument(metavar="CAMPAIGN|RESULTS", help="campaign file or folder of results")],
    case: Annotated[str, typer.Argument(metavar="CASE", help="digest of a case, its beginning, or its label")],
    number: Annotated[int, typer.Argument(metavar="RUN", help="number of the run, from 0")],
    sets: Sets = None,
    out: Out = None,
) -> Answer:
    """Repeat one run, bit for bit, and keep every step."""
    from lvnav_trade.campaign.definition.axes import cases
    from lvnav_trade.campaign.running import replay as again

    loaded, folder = _campaign_of(source, sets or ())
    chosen = again.find(cases(loaded), case)
    found = again.replay(loaded, chosen, number)
    trace = again.write_trace(found, out or folder, chosen, number)
    events = [{"event": e, "t_s": t, "errors": sizes, "units": units} for e, t, sizes, units in found.at_events]
    content = {"case": chosen.id, "label": chosen.label, "run": number, "failure": found.failure}
    rows = [
        [event, f"{t:.3f} s", *(f"{sizes[name]:.6g} {units[name]}" for name in sizes)]
        for event, t, sizes, units in found.at_events
    ]
    what = f"{chosen.label}, run {number}{f': {found.failure}' if found.failure else ''}"
    text = f"{what}\n{table(['event', 't', 'position', 'velocity', 'attitude'], rows)}\ntrace: {trace}"
    return Answer(text, {**content, "events": events, "trace": str(trace)})


def _campaign_of(source: str, sets: Sequence[str]) -> tuple[Campaign, Path]:
    """Return the campaign of a file or of a folder of results, and the folder of its results."""
    from lvnav_trade.campaign.reading.load import load

    folder = Path(source)
    if not folder.is_dir():
        loaded = load(source, sets)
        return loaded, Path("results") / loaded.name
    frozen = folder / "campaign.resolved.yaml"
    if not frozen.is_file():
        raise InputError(f"{folder}: no results here (no campaign.resolved.yaml)")
    return load(frozen, sets), folder


@verb("results/demo")
def status(folder: Annotated[Path, typer.Argument(metavar="RESULTS")]) -> Answer:
    """Show a campaign's progress: running, finished, damaged.

    Blocks and tables are checked.
    """
    from lvnav_trade.campaign.running.status import status as look

    found = look(folder)
    return Answer(found.text, found._asdict() | {"cases": [case._asdict() for case in found.cases]})


@verb("imu.gyro")
def fields(
    path: Annotated[
        str | None, typer.Argument(metavar="PATH", help="filter, receiver.clock, faults; the whole campaign if absent")
    ] = None,
) -> Answer:
    """List the fields at a path of a campaign.

    Each with its default, what it takes and what it means; for every kind where there are several.
    """
    from lvnav_trade.campaign.reading.reference import reference

    found = reference(path or "")
    blocks = []
    for part in found:
        title = f"kind: {part.kind} - {part.title}" if part.kind else part.title
        rows = [[row.field, row.default, "; ".join(filter(None, (row.type, row.meaning)))] for row in part.rows]
        blocks.append(f"{title}\n{table(['field', 'default', 'takes'], rows)}")
    parts = [part._asdict() | {"rows": [row._asdict() for row in part.rows]} for part in found]
    return Answer("\n\n".join(blocks), {"path": path or "", "parts": parts})


@verb("> campaign.schema.json", with_json=False)
def schema() -> Answer:
    """Print the JSON Schema of campaign files, for editors."""
    from lvnav_trade.campaign.reading.reference import json_schema

    return Answer(json.dumps(json_schema(), indent=2))


def _width() -> int:
    return min(100, shutil.get_terminal_size().columns)


@verb("imu --long")
def cards(
    name: Annotated[str | None, typer.Argument(metavar="CARD", help="show this card, or list this folder")] = None,
    long: Annotated[bool, typer.Option("--long", help="with the source of the numbers")] = False,
) -> Answer:
    """List all cards, those of a folder, or show one."""
    from lvnav_trade.campaign.syntax import cards as shelf

    every = shelf.catalogue(Path.cwd())
    found = [card for card in every if card.name.startswith(f"{(name or '').rstrip('/')}/")]
    if name is not None and not found:
        text = shelf.card_text(name, Path.cwd())
        return Answer(text.removesuffix("\n"), {"name": name, "text": text})
    found = found or every
    listed = table(["card", "what"], [[card.name, card.title] for card in found])
    if long:
        listed = "\n\n".join(
            f"{card.name}: {card.title}\n{fill(card.source, _width(), initial_indent='  ', subsequent_indent='  ')}"
            for card in found
        )
    return Answer(listed, {"cards": [card._asdict() for card in found]})


@verb("velocity")
def metrics(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="only those whose name contains this")] = None,
) -> Answer:
    """List the metrics a campaign can name, then the tables."""
    from lvnav_trade.campaign.reading.quantities import known_metrics
    from lvnav_trade.campaign.syntax.tree import hint
    from lvnav_trade.metrics import METRICS

    known = [one for one in known_metrics() if (name or "") in one.metric]
    made = {key: (metric.__doc__ or "").partition("\n")[0] for key, metric in METRICS.items() if (name or "") in key}
    if not known and not made:
        names = [*(one.metric for one in known_metrics()), *METRICS]
        raise InputError(f"metrics: no metric contains {name!r}{hint(str(name), names)}")
    blocks = [table(["metric", "unit", "meaning", "named by"], known)] if known else []
    blocks += [table(["table", "what it holds"], list(made.items()))] if made else []
    return Answer("\n\n".join(blocks), {"metrics": [one._asdict() for one in known], "tables": made})


@verb("dlr --keep reports/dlr")
def study(
    folder: Annotated[
        str, typer.Argument(metavar="FOLDER", help="folder of campaigns, or one of the tool's: conae, dlr, drdc, gains")
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

    Published numbers are compared with ours. What a campaign answers (requirements violated or undecided) is no failure
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
    lines = [f"failed: {line}" for line in found.failures]
    lines += [table(["campaign", "evidence", "as published"], rows), f"kept: {found.page}"]
    content: dict[str, Any] = {"page": str(found.page), "failures": found.failures, "campaigns": found.campaigns}
    content |= {"published": found.published, "hold": found.hold}
    return Answer("\n".join(lines), content, api.FAILED if found.failures else api.MET)
