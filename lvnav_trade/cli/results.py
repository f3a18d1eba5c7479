"""Verbs of a case, flight or results: estimate-q, schedule-gains, export-trajectory, report, compare, kml."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import CampaignFile, Jobs, Sets, VerbResult, file_option, verb
from lvnav_trade.quantities.errors import InputError

CaseOf = Annotated[
    str | None,
    typer.Option("--case", metavar="CASE", help="digest of a case, its beginning, or its label [default: the first]"),
]
Card = Annotated[Path, file_option("card to write")]


@verb("gains/process_noise -o my_filter.yaml")
def estimate_q(
    campaign: CampaignFile,
    out: Card,
    sets: Sets = None,
    case: CaseOf = None,
    runs: Annotated[int, typer.Option("--runs", help="perturbed runs of the ensemble")] = 100,
    step: Annotated[
        float | None, typer.Option("--step", metavar="SECONDS", help="length of a step [default: time between updates]")
    ] = None,
) -> VerbResult:
    """Estimate process noise from runs; write a filter card.

    The runs are perturbed by the IMU's errors. The error per step is written as CSV and PNG too.
    """
    from lvnav_trade import api

    outcome = api.estimate_q(campaign, out, sets or (), case, runs, step)
    estimate = outcome.noise
    densities = {"whole flight": estimate.flight_densities}
    for name, _, _, noise in estimate.phases:
        densities[name] = noise
    rows = [_density_row(name, noise) for name, noise in densities.items()]
    excess = estimate.flight_densities._replace(
        attitude=estimate.card.attitude_noise, velocity=estimate.card.velocity_noise
    )
    excess_row = _density_row("the card: whole flight beyond the unit's own", excess)
    rows.append([*excess_row[:3], "-"])  # the card has no position noise
    header = ["phase", "attitude (deg/sqrt(h))", "velocity (m/s/sqrt(s))", "position (m/sqrt(s))"]
    steps_csv, steps_png = outcome.files
    text = f"{table(header, rows)}\ncard: {outcome.card}\nerror per step: {steps_csv}, {steps_png}"
    content = {
        "card": str(outcome.card),
        "files": [str(file) for file in outcome.files],
        "densities_si": {name: noise._asdict() for name, noise in densities.items()},
    }
    return VerbResult(text, content)


def _density_row(name: str, noise: Any) -> list[str]:
    attitude = math.degrees(noise.attitude) * 60.0  # rad/sqrt(s) to deg/sqrt(h)
    return [name, f"{attitude:.3g}", f"{noise.velocity:.3g}", f"{noise.position:.3g}"]


@verb("demo -o my_gains.yaml")
def schedule_gains(
    campaign: CampaignFile,
    out: Card,
    sets: Sets = None,
    case: CaseOf = None,
    by: Annotated[Literal["event", "time"], typer.Option("--by", help="reference of the gains in flight")] = "event",
    tolerance: Annotated[
        float,
        typer.Option("--tolerance", help="largest error between knots, relative to each gain's largest magnitude"),
    ] = 0.02,
) -> VerbResult:
    """Write the gains of a filter as a card.

    Another filter replays them: filter.gains.
    """
    from lvnav_trade import api

    gains = api.schedule_gains(campaign, out, sets or (), case, by, tolerance)
    rows = [(segment.event, len(segment.knots)) for segment in gains.segments]
    text = f"{table(['from', 'knots'], rows)}\nstates: {', '.join(gains.states)}\ncard: {out}"
    return VerbResult(text, {"card": str(out), "states": list(gains.states), "knots": dict(rows)})


@verb("results/demo --keep reports/demo --figures")
def report(
    folder: Annotated[Path, typer.Argument(metavar="RESULTS")],
    keep: Annotated[
        Path | None,
        typer.Option("--keep", metavar="DIR", help="write the Markdown report, PNG figures and CSV tables here"),
    ] = None,
    no_tables: Annotated[bool, typer.Option("--no-tables", help="with --keep: omit the CSV tables")] = False,
    figures: Annotated[bool, typer.Option("--figures", help="also write PNG and SVG figures")] = False,
    brief: Annotated[bool, typer.Option("--brief", help="also write brief.html, at most ten sheets of A4")] = False,
) -> VerbResult:
    """Build the report again from results."""
    from lvnav_trade import api

    if no_tables and keep is None:
        raise InputError("--no-tables: only --keep writes CSV tables")
    formats = ("png", "svg") if figures else ()
    report_files = api.report(folder, keep, not no_tables, formats, brief)
    page = str(report_files.page)
    if report_files.kept is None:
        return VerbResult(f"report: {page}", {"report": page, "kept": None})
    kept = str(report_files.kept)
    return VerbResult(f"report: {page}\nkept: {kept}", {"report": page, "kept": kept})


@verb("my_vehicle/base results/ascent --effect velocity_error_3d=5%")
def compare(
    base: Annotated[str, typer.Argument(metavar="BASE", help="folder of results, or a campaign, which is run first")],
    candidate: Annotated[
        str, typer.Argument(metavar="CANDIDATE", help="folder of results or campaign to compare with BASE")
    ],
    effect: Annotated[
        list[str] | None,
        typer.Option("--effect", metavar="METRIC=AMOUNT", help="smallest change of interest: velocity_error_3d=5%"),
    ] = None,
    confidence: Annotated[
        float | None, typer.Option("--confidence", help="confidence of the verdicts [default: 0.95]")
    ] = None,
    maps: Annotated[
        list[str] | None, typer.Option("--map", metavar="BASE:CANDIDATE", help="cases or levels with another name")
    ] = None,
    md: Annotated[Path | None, typer.Option("--md", metavar="FILE", help="write the comparison in Markdown")] = None,
    junit: Annotated[Path | None, typer.Option("--junit", metavar="FILE", help="write JUnit XML")] = None,
    jobs: Jobs = -1,
) -> VerbResult:
    """Compare two result sets run by run (paired).

    Exit code 0: nothing is worse; 1: something is worse; 2: not comparable; 3: undecided.
    """
    from lvnav_trade import api
    from lvnav_trade.report import compare as comparison

    names = comparison.parse_map(maps or ())
    result = api.compare(base, candidate, effect or (), confidence, names, jobs)
    content = {**comparison.content(result), "written": comparison.write(result, md, junit)}
    lines = [table(comparison.HEAD, comparison.rows(result)), *result.notes, comparison.answer(result)]
    return VerbResult("\n".join(lines), content, comparison.EXIT[result.verdict])


@verb("results/ascent my_vehicle/base", with_json=False)
def keep_base(
    folder: Annotated[Path, typer.Argument(metavar="RESULTS")],
    target: Annotated[Path, typer.Argument(metavar="DIR", help="folder of the base, such as one in your repository")],
) -> VerbResult:
    """Save what `compare` needs from results.

    These are runs and events, a few hundred kilobytes.
    """
    from lvnav_trade import api

    return VerbResult(f"base: {api.keep_base(folder, target)}")


@verb("results/demo -o demo.kml --ellipses")
def kml(
    source: Annotated[str, typer.Argument(metavar="CARD|RESULTS", help="trajectory card, or folder of results")],
    out: Annotated[Path, file_option("file to write")],
    ellipses: Annotated[bool, typer.Option("--ellipses", help="draw 3-sigma position ellipses of results")] = False,
    every: Annotated[float, typer.Option("--every", help="seconds between ellipses")] = 60.0,
    magnify: Annotated[float, typer.Option("--magnify", help="magnification of the ellipses")] = 1.0,
) -> VerbResult:
    """Write trajectories as KML for Earth viewers."""
    from lvnav_trade import api

    kml_file = str(api.kml(source, out, ellipses, every, magnify))
    return VerbResult(f"kml: {kml_file}", {"kml": kml_file})


@verb("trajectories/two_stage_leo -o my_flight.csv")
def export_trajectory(
    source: Annotated[str, typer.Argument(metavar="CARD|CAMPAIGN", help="trajectory card, or campaign")],
    out: Annotated[Path, file_option("CSV file to write, with its card next to it")],
    sets: Sets = None,
    case: CaseOf = None,
    rate: Annotated[float, typer.Option("--rate", metavar="HZ", help="rows per second")] = 10.0,
) -> VerbResult:
    """Write a trajectory as a CSV file with its card.

    The columns are those of trajectories/example_table; the events are in the card. The file is read back and the
    differences are printed.
    """
    from lvnav_trade import api

    trajectory = api.export_trajectory(source, out, sets or (), case, rate)
    differences = [[quantity, f"{value:.1e}"] for quantity, value in trajectory.difference.items()]
    lines = [
        table(["largest difference", "SI"], differences),
        f"events: {', '.join(trajectory.events)}",
        f"rows: {trajectory.file}",
        f"card: {trajectory.card}",
    ]
    content = {
        "file": str(trajectory.file),
        "card": str(trajectory.card),
        "events": trajectory.events,
        "difference": trajectory.difference,
    }
    return VerbResult("\n".join(lines), content)


@verb("my_vehicle --from flight.csv")
def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="folder of the new campaign")],
    file: Annotated[Path, typer.Option("--from", metavar="FILE", help="your trajectory, CSV or Parquet")],
    epoch: Annotated[str | None, typer.Option("--epoch", help="lift-off, UTC, such as 2027-02-01T12:00:00Z")] = None,
    time: Annotated[
        str | None, typer.Option("--time", metavar="COLUMN", help="column of time [default: guessed]")
    ] = None,
) -> VerbResult:
    """Write a first campaign for your trajectory file.

    Columns, units, frames and events are guessed; the card gives the reason for each line. No file is overwritten.
    """
    from lvnav_trade import api

    first_campaign = api.init(folder, file, epoch, time)
    rows = [[guess.field, str(guess.content), guess.reason] for guess in first_campaign.guesses]
    events = ", ".join(f"{name} {time}" for name, time in first_campaign.events.items()) or "none"
    rows.append(["events", events, "jumps of force"])
    lines = [
        table(["part", "guess", "why"], rows),
        f"card: {first_campaign.card}",
        f"campaign: {first_campaign.campaign}",
    ]
    lines.append(f"confirm the guesses in the card, then: lvnav-trade check {first_campaign.campaign}")
    guesses = {guess.field: guess.content for guess in first_campaign.guesses}
    content = {
        "campaign": str(first_campaign.campaign),
        "card": str(first_campaign.card),
        "guesses": guesses,
        "events": first_campaign.events,
    }
    return VerbResult("\n".join(lines), content)
