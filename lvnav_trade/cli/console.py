"""The console: the application, options that commands share, output, error handling and exit codes."""

import inspect
import json
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple, NoReturn, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from lvnav_trade.campaign.interrupts import interrupt_handlers, raise_if_interrupted
from lvnav_trade.cli.streams import guard, output_error_text
from lvnav_trade.quantities.errors import (
    InputError,
    Mistake,
    is_full_disk,
    system_message,
    visible_text,
    without_credentials,
)

JSON_VERSION = 1
FAILED, INTERNAL = 4, 5
_READ = ("campaign", "base", "file", "folder", "source", "place", "log")
"""Arguments that name the input of a verb; the first that is given counts."""
_has_answer = False

RUN, EXPLORE, SEARCH, DATA, EXPORT = "Run and report", "Explore", "Search", "Data", "Export"
GROUPS = {
    RUN: ("check", "plan", "selfcheck", "run", "status", "merge", "report", "cases", "keep-base", "compare", "study"),
    EXPLORE: ("fields", "metrics", "cards", "schema", "replay"),
    SEARCH: ("solve", "indices", "tune", "estimate-q"),
    DATA: ("init", "fit-unit", "process-log"),
    EXPORT: ("export-trajectory", "export-vectors", "export-filter", "schedule-gains", "kml"),
}
"""Verbs by purpose, in the order of the help."""


class Groups(TyperGroup):
    """The verbs, listed in groups."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the verbs, group by group."""
        return [name for names in GROUPS.values() for name in names]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the list of verbs."""
        longest = max(map(len, self.commands))
        for group, names in GROUPS.items():
            with formatter.section(group):
                limit = formatter.width - 6 - longest
                helps = [(name, self.commands[name].get_short_help_str(limit)) for name in names]
                formatter.write_dl([(name.ljust(longest), text) for name, text in helps])


class Verb(TyperCommand):
    """A verb, whose usage names required arguments without brackets."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the pieces of the usage line."""
        return [piece.strip("{}") for piece in super().collect_usage_pieces(ctx)]


app = typer.Typer(
    cls=Groups,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Which IMU, receiver and filter meet a launch vehicle's injection-accuracy requirement?",
    epilog="Exit codes: 0 all requirements met, 1 one violated, 2 input error, 3 undecided, 4 some runs failed, "
    "5 internal error, 130 interrupted (resumable).",
)


def folder_option(content: str, default: str = "") -> Any:
    """Return the option ``--out`` of a verb that writes a folder."""
    return _out_option("DIR", f"folder of {content}", default)


def file_option(content: str, default: str = "") -> Any:
    """Return the option ``--out`` of a verb that writes a file."""
    return _out_option("FILE", content, default)


def _out_option(metavar: str, content: str, default: str) -> Any:
    help_text = f"{content} [default: {default}]" if default else content
    return typer.Option("--out", "-o", metavar=metavar, help=help_text, show_default=False)


CampaignFile = Annotated[str, typer.Argument(metavar="CAMPAIGN", help="campaign file, or one that comes with the tool")]
Sets = Annotated[list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="change one field; repeatable")]
Json = Annotated[bool, typer.Option("--json", help="one JSON object on standard output")]
Debug = Annotated[bool, typer.Option("--debug", help="show the traceback of an internal error")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="no progress")]
Out = Annotated[Path | None, folder_option("the results", "results/NAME")]
Jobs = Annotated[int, typer.Option("--jobs", "-j", help="worker processes; -1: all cores")]


def _version(is_requested: bool) -> None:
    if is_requested:
        from lvnav_trade.results.tables.versions import tool_version

        print(f"lvnav-trade {tool_version()}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="show the version")
    ] = False,
) -> None:
    pass


class VerbResult(NamedTuple):
    """Result of a verb."""

    text: str  # for people
    content: Mapping[str, Any] = MappingProxyType({})  # for programs
    code: int = 0  # exit code


def verb(example: str, with_json: bool = True) -> Callable[[Callable[..., VerbResult]], Callable[..., None]]:
    """Add a command to the application: a function that returns its answer.

    The arguments of the function are those of the command, which has the options ``--json`` and ``--debug`` too. An
    argument that is a record (NamedTuple) gives the command an option for every field. A function that prints before it
    answers takes ``--json`` as `as_json`.

    Parameters
    ----------
    example : str
        Arguments of an example, printed below the help without the name of the tool.
    with_json : bool
        Whether the command has the option ``--json``.
    """

    def add(function: Callable[..., VerbResult]) -> Callable[..., None]:
        name = function.__name__.replace("_", "-")
        arguments = inspect.signature(function, eval_str=True).parameters
        records = {
            key: argument.annotation for key, argument in arguments.items() if hasattr(argument.annotation, "_fields")
        }
        options = {option.name: option for argument in arguments.values() for option in _options_of(argument)}
        takes_json = "as_json" in options
        if with_json:
            options["as_json"] = _flag("as_json", Json)
        options["debug"] = _flag("debug", Debug)

        @app.command(name, cls=Verb, epilog=f"Example: lvnav-trade {name} {example}")
        @wraps(function)
        def command(*, debug: bool, as_json: bool = False, **values: Any) -> None:
            with errors(as_json, debug):
                jobs = values.get("jobs", -1)
                if jobs == 0 or jobs < -1:
                    raise InputError(f"--jobs {jobs}: give a number of worker processes, or -1 for all cores")
                start = time.monotonic()
                is_talkative = not as_json and not values.get("quiet", False)
                if is_talkative and sys.stderr.isatty():  # a log has the progress, and one line in case of failure
                    _print_input(name, values)
                call = {key: value for key, value in values.items() if key in arguments}
                for key, record in records.items():
                    call[key] = record(*map(values.get, record._fields))
                if takes_json:
                    call["as_json"] = as_json
                answer = function(**call)
                if as_json:
                    _print_json(name, answer.code, **answer.content)
                else:
                    print(answer.text)
                if is_talkative and "quiet" in values:
                    _say(f"{name}: {_duration(time.monotonic() - start)} in total")
                _exit_with_answer(answer.code)

        command.__signature__ = inspect.Signature(list(options.values()))  # type: ignore[attr-defined]
        command.__annotations__ = {key: option.annotation for key, option in options.items()}
        return command

    return add


def _flag(name: str, annotation: Any) -> inspect.Parameter:
    """Return an option that is off by default."""
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation)


def _options_of(argument: inspect.Parameter) -> list[inspect.Parameter]:
    """Return the options of an argument of a verb: the argument itself, or the fields of a record."""
    record = argument.annotation
    if not hasattr(record, "_fields"):
        return [argument]
    annotations = get_type_hints(record, include_extras=True)
    options = []
    for field in record._fields:
        default = record._field_defaults.get(field, argument.empty)
        options.append(inspect.Parameter(field, argument.kind, default=default, annotation=annotations[field]))
    return options


def _print_input(name: str, values: Mapping[str, Any]) -> None:
    """Print the input of a verb, before the import of the packages that the verb needs."""
    for argument in _READ:
        if values.get(argument) is not None:
            _say(f"{name}: reading {values[argument]}")
            return


def _say(line: str) -> None:
    from lvnav_trade.campaign.running.progress import stamped_line

    print(stamped_line(visible_text(line)), file=sys.stderr, flush=True)


def _duration(seconds: float) -> str:
    """Return a duration in words: 12 s, 3 min 5 s, 2 h 10 min."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    if seconds < 59.5:
        return f"{seconds:.0f} s"
    minutes, hours = seconds / 60.0, seconds / 3600.0
    if minutes < 59.5:
        whole_seconds = int(seconds + 0.5)
        return f"{whole_seconds // 60} min {whole_seconds % 60} s"
    if hours < 1000:
        whole_minutes = int(minutes + 0.5)
        return f"{whole_minutes // 60} h {whole_minutes % 60} min"
    return f"{hours:.0f} h"


@contextmanager
def errors(as_json: bool, debug: bool) -> Iterator[None]:
    """Turn every failure in the context into one line and an exit code.

    Parameters
    ----------
    as_json : bool
        Whether the line is printed as a JSON object.
    debug : bool
        Whether an internal error is raised with its traceback.
    """
    if debug:
        os.environ["LVNAV_TRADE_DEBUG"] = "1"
    try:
        with interrupt_handlers():  # SIGTERM too, by which a batch system ends a job
            try:
                yield
            except (typer.Exit, typer.Abort):
                raise
            except Exception as error:
                raise_if_interrupted(error)
                _exit_on(error, as_json, debug)
    except KeyboardInterrupt:
        _exit(130, as_json, "interrupted; the same command resumes")


def _exit_on(error: Exception, as_json: bool, debug: bool) -> NoReturn:
    """Exit with the line and the exit code of an error; with `debug`, an internal error is raised.

    Parameters
    ----------
    error : Exception
        The error.
    as_json : bool
        Whether the message is printed as a JSON object.
    debug : bool
        Whether an internal error is raised with its traceback.
    """
    error_type = type(error).__name__
    if isinstance(error, InputError):
        _exit(2, as_json, str(error), error.records)
    if error_type == "Halted":
        _exit(FAILED, as_json, str(error))
    if error_type == "TerminatedWorkerError":
        _exit(FAILED, as_json, "a worker process died (out of memory?); the same command tries again")
    if isinstance(error, OSError) and error.errno and not debug:
        _exit(FAILED if is_full_disk(error) else 2, as_json, system_message(error))
    if debug:
        raise error
    text = str(error).strip().partition("\n")[0]
    _exit(INTERNAL, as_json, f"internal error: {error_type}: {text} (--debug shows where; please report it)")


def _exit(code: int, as_json: bool, message: str, records: Sequence[Mistake] = ()) -> NoReturn:
    """Print a message and exit; in a CI service, also annotate the line of the file.

    Parameters
    ----------
    code : int
        Exit code.
    as_json : bool
        Whether the message is printed as a JSON object on standard output.
    message : str
        Message; credentials in it are removed.
    records : sequence of Mistake
        Input errors with their places.
    """
    message = visible_text(without_credentials(message))
    if as_json:
        _print_json("error", code, message=message, mistakes=[record._asdict() for record in records])
    else:
        print(message, file=sys.stderr)
    if os.environ.get("GITHUB_ACTIONS"):
        for record in records:
            text = f"{record.path}: {record.message}" if record.path else record.message
            location = f" file={record.file},line={record.line},col={record.column}" if record.line else ""
            print(f"::error{location}::{text}", file=sys.stderr)
    raise typer.Exit(code)


def _exit_with_answer(code: int) -> NoReturn:
    """Exit with the code of an answer; exit codes 1 and 3 come from here only."""
    global _has_answer
    _has_answer = True
    raise typer.Exit(code)


def main() -> NoReturn:
    """Run the command line.

    Exit codes 0, 1 and 3 are those of a verb that has completed and written all its output.
    """
    global _has_answer
    _has_answer = False
    stream, code = guard(), INTERNAL
    try:
        app()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else INTERNAL
        if code in (1, 3) and not _has_answer:
            code = INTERNAL
    except KeyboardInterrupt:
        code = 130
    except Exception:  # of --debug, or before a verb begins
        traceback.print_exc()
    output_error = output_error_text(stream)
    if output_error:
        print(output_error, file=sys.stderr)
        code = FAILED if code in (0, 1, 3) else code
    sys.stderr.flush()
    sys.exit(code)


def _print_json(verb: str, code: int, **content: Any) -> None:
    print(json.dumps({"lvnav_trade_json": JSON_VERSION, "verb": verb, "exit_code": code, **content}, default=str))
