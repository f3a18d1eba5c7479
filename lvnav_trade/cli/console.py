"""The console: the application, options that commands share, output, error handling and exit codes."""

import inspect
import json
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple, NoReturn

import typer

from lvnav_trade.cli.streams import complaint, guard
from lvnav_trade.errors import InputError, Mistake, is_full_disk, system_message, visible, without_credentials
from lvnav_trade.interrupts import raise_if_interrupted, remembering_interrupts

JSON_VERSION = 1
FAILED, INTERNAL = 4, 5
_answered = False

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


class Answer(NamedTuple):
    """What a verb found: text for people, content for programs, and the exit code that it means."""

    text: str
    content: Mapping[str, Any] = MappingProxyType({})
    code: int = 0


def verb(example: str, with_json: bool = True) -> Callable[[Callable[..., Answer]], Callable[..., None]]:
    """Add a command to the application: a function that returns its answer.

    Its arguments are those of the command, which has the options ``--json`` and ``--debug`` too. A function that prints
    before it answers takes the former as `as_json`. `example` stands below its help, without the name of the tool.
    """

    def add(function: Callable[..., Answer]) -> Callable[..., None]:
        name = function.__name__.replace("_", "-")
        parameters = dict(inspect.signature(function, eval_str=True).parameters)
        prints = "as_json" in parameters
        for option, kind in (("as_json", Json), ("debug", Debug)) if with_json else (("debug", Debug),):
            parameters[option] = inspect.Parameter(
                option, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind
            )

        @app.command(name, epilog=f"Example: lvnav-trade {name} {example}")
        @wraps(function)
        def command(*, debug: bool, as_json: bool = False, **given: Any) -> None:
            with errors(as_json, debug):
                if (jobs := given.get("jobs", -1)) == 0 or jobs < -1:
                    raise InputError(f"--jobs {jobs}: give a number of worker processes, or -1 for all cores")
                answer = function(**given, as_json=as_json) if prints else function(**given)
                if as_json:
                    _print_json(name, answer.code, **answer.content)
                else:
                    print(answer.text)
                _leave_with_answer(answer.code)

        command.__signature__ = inspect.Signature(list(parameters.values()))  # type: ignore[attr-defined]
        command.__annotations__ = {option: parameter.annotation for option, parameter in parameters.items()}
        return command

    return add


@contextmanager
def errors(as_json: bool, debug: bool) -> Iterator[None]:
    """Turn every way to fail into one line and an exit code."""
    if debug:
        os.environ["LVNAV_TRADE_DEBUG"] = "1"
    try:
        with remembering_interrupts():  # SIGTERM too, by which a batch system ends a job
            try:
                yield
            except (typer.Exit, typer.Abort):
                raise
            except Exception as error:
                raise_if_interrupted(error)
                _leave_with_error(error, as_json, debug)
    except KeyboardInterrupt:
        _leave(130, as_json, "interrupted; the same command resumes")


def _leave_with_error(error: Exception, as_json: bool, debug: bool) -> NoReturn:
    """Leave with the line and the exit code of an error; with `debug` one that is not the user's is raised."""
    kind = type(error).__name__
    if isinstance(error, InputError):
        _leave(2, as_json, str(error), error.records)
    if kind == "Halted":
        _leave(FAILED, as_json, str(error))
    if kind == "TerminatedWorkerError":
        _leave(FAILED, as_json, "a worker process died (out of memory?); the same command tries again")
    if isinstance(error, OSError) and error.errno and not debug:
        _leave(FAILED if is_full_disk(error) else 2, as_json, system_message(error))
    if debug:
        raise error
    text = str(error).strip().partition("\n")[0]
    _leave(INTERNAL, as_json, f"internal error: {kind}: {text} (--debug shows where; please report it)")


def _leave(code: int, as_json: bool, message: str, records: Sequence[Mistake] = ()) -> NoReturn:
    """Print why and leave; as a note on the file's line too where a CI service reads those."""
    message = visible(without_credentials(message))
    if as_json:
        _print_json("error", code, message=message, mistakes=[record._asdict() for record in records])
    else:
        print(message, file=sys.stderr)
    if os.environ.get("GITHUB_ACTIONS"):
        for record in records:
            text = f"{record.path}: {record.message}" if record.path else record.message
            where = f" file={record.file},line={record.line},col={record.column}" if record.line else ""
            print(f"::error{where}::{text}", file=sys.stderr)
    raise typer.Exit(code)


def _leave_with_answer(code: int) -> NoReturn:
    """Leave with the exit code of an answer: no other way leads to exit codes 1 and 3."""
    global _answered
    _answered = True
    raise typer.Exit(code)


def main() -> NoReturn:
    """Run the command line. Exit codes 0, 1 and 3 are those of a verb that came to its end and wrote all it had."""
    global _answered
    _answered = False
    out, code = guard(), INTERNAL
    try:
        app()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else INTERNAL
        if code in (1, 3) and not _answered:
            code = INTERNAL
    except KeyboardInterrupt:
        code = 130
    except Exception:  # of --debug, or before a verb begins
        traceback.print_exc()
    lost = complaint(out)
    if lost:
        print(lost, file=sys.stderr)
        code = FAILED if code in (0, 1, 3) else code
    sys.stderr.flush()
    sys.exit(code)


def _print_json(verb: str, code: int, **content: Any) -> None:
    print(json.dumps({"lvnav_trade_json": JSON_VERSION, "verb": verb, "exit_code": code, **content}, default=str))
