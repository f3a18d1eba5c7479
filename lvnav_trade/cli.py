"""The command line: verbs only; one verb, one call, one table."""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from lvnav_trade.campaign.text import table

if TYPE_CHECKING:
    from lvnav_trade.campaign.schema import Campaign
    from lvnav_trade.errors import Mistake

JSON_VERSION = 1

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Which inertial unit, receiver and filter bring a launch vehicle to injection? Exit codes: 0 all requirements "
    "met, 1 one violated, 2 bad usage or campaign file, 3 undecided, 4 some runs failed, 5 internal error, "
    "130 interrupted (resumable).",
)

CampaignFile = Annotated[str, typer.Argument(metavar="CAMPAIGN", help="campaign file, or one that comes with the tool")]
Sets = Annotated[list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="change one field; repeatable")]
Json = Annotated[bool, typer.Option("--json", help="one JSON object on standard output")]
Debug = Annotated[bool, typer.Option("--debug", help="show the traceback of an internal error")]
Out = Annotated[Path | None, typer.Option("--out", help="folder of the results [default: results/NAME]")]
Jobs = Annotated[int, typer.Option("--jobs", "-j", help="worker processes; -1: all cores")]


def main() -> None:
    """Run the command line."""
    app()


def _version(wanted: bool) -> None:
    if wanted:
        from lvnav_trade.store.versions import tool_version

        print(f"lvnav-trade {tool_version()}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="show the version")
    ] = False,
) -> None:
    pass


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
    """Carry a campaign out: linear covariance in seconds, then Monte Carlo, then the report."""
    with _errors(as_json, debug):
        from lvnav_trade import api
        from lvnav_trade.campaign.load import load
        from lvnav_trade.campaign.progress import choose

        _jobs(jobs)
        loaded = load(campaign, sets or ())
        folder = out or Path("results") / loaded.name
        found: list[Any] = []

        def told(answers: Sequence[Any], cases: Sequence[Any]) -> None:
            found.extend(answers)
            if not as_json:
                _print_answers(answers, cases)

        results = api.run(loaded, (), folder, jobs, fresh, fail_fast, report, choose(quiet), told)
        _finish(results, found, report, as_json)


def _finish(results: Any, answers: Sequence[Any], report: bool, as_json: bool) -> NoReturn:
    """Print verdicts and where the results are, and leave with the code that they mean."""
    verdicts = results.requirements
    failures = results.failures
    code = results.exit_code
    page = results.folder / "report.html" if report else None
    if as_json:
        linear = [{**answer._asdict(), "rows": [list(row) for row in answer.rows]} for answer in answers]
        content = {"folder": str(results.folder), "report": str(page) if page else None, "failures": failures}
        _print_json("run", code, **content, covariance=linear, requirements=_records(verdicts))
    else:
        if len(verdicts):
            print(table(list(verdicts.columns), [list(row) for row in verdicts.itertuples(index=False)]))
        for line in failures:
            print(f"failed: {line}")
        print(f"report: {page}" if page else f"results: {results.folder}")
    raise typer.Exit(code)


def _print_answers(answers: Sequence[Any], cases: Sequence[Any]) -> None:
    rows = []
    for answer, case in zip(answers, cases, strict=True):
        cells = [f"{true:.3g} ({formal:.3g}) {unit}" for _, true, formal, unit in answer.rows]
        rows.append([case.label, answer.event, *(cells or [answer.error])])
    print("Linear covariance, one sigma of the true error (in brackets what the filter believes), 3D:")
    print(table(["case", "at", "position", "velocity", "attitude"], rows))
    sys.stdout.flush()


@app.command()
def check(campaign: CampaignFile, sets: Sets = None, as_json: Json = False, debug: Debug = False) -> None:
    """Look a campaign over and run nothing."""
    with _errors(as_json, debug):
        from lvnav_trade import api
        from lvnav_trade.campaign.axes import cases

        found = cases(api.check(campaign, sets or ()))
        good = f"{campaign}: good, {len(found)} {'case' if len(found) == 1 else 'cases'}"
        _say("check", as_json, good, cases=[{"id": case.id, "label": case.label} for case in found], mistakes=[])


@app.command()
def plan(
    campaign: CampaignFile, sets: Sets = None, out: Out = None, as_json: Json = False, debug: Debug = False
) -> None:
    """Show the cases and what they will take, and what is done already."""
    with _errors(as_json, debug):
        from lvnav_trade import api

        found = api.plan(campaign, sets or (), out)
        rows = table(["case", "label", "runs", "done"], [list(row.values()) for row in found.cases])
        cost = f"{found.seconds:.0f} s of one core, {found.disk_mb:.0f} MB of disk, {found.memory_mb:.0f} MB a job"
        _say("plan", as_json, f"{rows}\nabout {cost}", **found._asdict())


@app.command()
def status(
    folder: Annotated[Path, typer.Argument(metavar="RESULTS")], as_json: Json = False, debug: Debug = False
) -> None:
    """Tell where a campaign stands: running, unfinished, damaged or finished; blocks and tables are checked."""
    with _errors(as_json, debug):
        from lvnav_trade.campaign.status import status as look

        found = look(folder)
        _say("status", as_json, found.text, **found._asdict() | {"cases": [case._asdict() for case in found.cases]})


@app.command()
def schema(debug: Debug = False) -> None:
    """Print the JSON Schema of campaign files, for editors."""
    with _errors(False, debug):
        from lvnav_trade.campaign.jsonschema import json_schema

        print(json.dumps(json_schema(), indent=2))


@app.command()
def cards(
    name: Annotated[str | None, typer.Argument(metavar="CARD", help="show this card")] = None,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """List the cards that a campaign here can name, or show one with its comments."""
    with _errors(as_json, debug):
        from lvnav_trade.campaign import cards as shelf

        if name is not None:
            text = shelf.card_text(name, Path.cwd())
            _say("cards", as_json, text.removesuffix("\n"), name=name, text=text)
            return
        found = shelf.catalogue(Path.cwd())
        listed = table(["card", "what", "source"], [[card.name, card.title, card.source] for card in found])
        _say("cards", as_json, listed, cards=[card._asdict() for card in found])


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(metavar="RESULTS")],
    keep: Annotated[
        Path | None,
        typer.Option("--keep", metavar="FOLDER", help="copy the Markdown page, figures and CSV tables here"),
    ] = None,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Build the report again from results."""
    with _errors(as_json, debug):
        from lvnav_trade import api

        api.load(folder)
        page = api.build_report(folder)
        kept = api.keep_report(folder, keep) if keep is not None else None
        told = f"report: {page}" + (f"\nkept: {kept}" if kept else "")
        _say("report", as_json, told, report=str(page), kept=str(kept) if kept else None)


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
    md: Annotated[Path | None, typer.Option("--md", metavar="FILE", help="write the page in Markdown")] = None,
    junit: Annotated[Path | None, typer.Option("--junit", metavar="FILE", help="write JUnit XML")] = None,
    jobs: Jobs = -1,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """Hold a candidate against a base, run by run: exit code 0 nothing worse, 1 worse, 2 no comparison, 3 undecided."""
    with _errors(as_json, debug):
        from lvnav_trade import api
        from lvnav_trade.report import compare as told

        _jobs(jobs)
        found = api.compare(base, candidate, effect or (), confidence, told.parse_map(maps or ()), jobs)
        written = told.write(found, md, junit)
        code = told.exit_code(found)
        if as_json:
            _print_json("compare", code, **told.content(found), written=written)
        else:
            print(table(told.HEAD, told.rows(found)), *found.notes, told.answer(found), sep="\n")
        raise typer.Exit(code)


@app.command("keep-base")
def keep_base(
    folder: Annotated[Path, typer.Argument(metavar="RESULTS")],
    target: Annotated[Path, typer.Argument(metavar="FOLDER", help="where, such as a folder of the repository")],
    debug: Debug = False,
) -> None:
    """Copy of results what `compare` needs of a base: runs and events, some hundred kilobytes."""
    with _errors(False, debug):
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
    """Write flights as KML, for viewers of the Earth."""
    with _errors(as_json, debug):
        from lvnav_trade import api

        written = str(api.write_kml(source, output, ellipses, every, magnify))
        _say("kml", as_json, f"kml: {written}", kml=written)


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
    """Fly one run again, bit for bit, and keep every covariance step."""
    with _errors(as_json, debug):
        from lvnav_trade.campaign import replay as again
        from lvnav_trade.campaign.axes import cases

        loaded, folder = _campaign_of(source, sets or ())
        chosen = again.find(cases(loaded), case)
        found = again.replay(loaded, chosen, number)
        trace = again.write_trace(found, out or folder, chosen, number)
        if as_json:
            events = [{"event": e, "t_s": t, "errors": sizes, "units": units} for e, t, sizes, units in found.at_events]
            content = {"case": chosen.id, "label": chosen.label, "run": number, "failure": found.failure}
            _print_json("replay", 0, **content, events=events, trace=str(trace))
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
    from lvnav_trade.campaign.load import load
    from lvnav_trade.errors import InputError

    folder = Path(source)
    if not folder.is_dir():
        loaded = load(source, sets)
        return loaded, Path("results") / loaded.name
    frozen = folder / "campaign.resolved.yaml"
    if not frozen.is_file():
        raise InputError(f"{folder}: no results here (no campaign.resolved.yaml)")
    return load(frozen, sets), folder


def _jobs(jobs: int) -> None:
    from lvnav_trade.errors import InputError

    if jobs == 0 or jobs < -1:
        raise InputError(f"--jobs {jobs}: give a number of worker processes, or -1 for all cores")


@contextmanager
def _errors(as_json: bool, debug: bool) -> Iterator[None]:
    """Turn every way to fail into one line and an exit code."""
    from lvnav_trade.errors import InputError, is_full_disk, told_by_system

    if debug:
        os.environ["LVNAV_TRADE_DEBUG"] = "1"
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # a batch system that ends the job, as Ctrl-C
    try:
        try:
            yield
        finally:
            sys.stdout.flush()  # where nobody can write, that should show here and not when Python ends
    except InputError as error:
        _leave(2, as_json, str(error), error.records)
    except KeyboardInterrupt:
        _leave(130, as_json, "interrupted; the same command resumes")
    except BrokenPipeError:
        os._exit(0)  # whoever reads has seen enough
    except (typer.Exit, typer.Abort):
        raise
    except Exception as error:
        if type(error).__name__ == "Halted":
            _leave(4, as_json, str(error))
        if isinstance(error, OSError) and error.errno and not debug:
            _leave(4 if is_full_disk(error) else 2, as_json, told_by_system(error))
        if debug:
            raise
        text = str(error).strip().partition("\n")[0]
        _leave(5, as_json, f"internal error: {type(error).__name__}: {text} (--debug shows where; please report it)")


def _leave(code: int, as_json: bool, message: str, records: Sequence[Mistake] = ()) -> NoReturn:
    """Print why and leave; as a note on the file's line too where a CI service reads those."""
    try:
        if as_json:
            _print_json("error", code, message=message, mistakes=[record._asdict() for record in records])
        else:
            print(message, file=sys.stderr)
        sys.stdout.flush()
    except OSError:  # of standard output itself, which is given up
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if as_json:
            print(message, file=sys.stderr)
    if os.environ.get("GITHUB_ACTIONS"):
        for record in records:
            text = f"{record.path}: {record.message}" if record.path else record.message
            where = f" file={record.file},line={record.line},col={record.column}" if record.line else ""
            print(f"::error{where}::{text}", file=sys.stderr)
    raise typer.Exit(code)


def _say(verb: str, as_json: bool, text: str, /, **content: Any) -> None:
    """Print what a verb has to tell, which went well: the text for people, or the content for programs."""
    if as_json:
        _print_json(verb, 0, **content)
    else:
        print(text)


def _print_json(verb: str, code: int, **content: Any) -> None:
    print(json.dumps({"lvnav_trade_json": JSON_VERSION, "verb": verb, "exit_code": code, **content}, default=str))


def _records(frame: Any) -> list[dict[str, Any]]:
    """Return the rows of a frame as JSON can hold them: what is not a number is null."""
    records: list[dict[str, Any]] = json.loads(frame.to_json(orient="records"))
    return records
