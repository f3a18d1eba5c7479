"""Verbs for recorded data: fit-unit, process-log."""

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import VerbResult, file_option, folder_option, verb
from lvnav_trade.quantities.errors import InputError

LogFile = Annotated[str, typer.Argument(metavar="LOG", help="CSV or Parquet, units in the names of its columns")]


@verb("unit_at_rest.csv -o configs/imu/my_unit.yaml --plot allan.png")
def fit_unit(
    log: LogFile,
    out: Annotated[Path, file_option("card to write")],
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="write the figure as PNG")] = None,
    start: Annotated[
        float | None, typer.Option("--start", metavar="SECONDS", help="use the log from this time")
    ] = None,
    end: Annotated[float | None, typer.Option("--end", metavar="SECONDS", help="use the log up to this time")] = None,
    shortest: Annotated[
        float, typer.Option("--shortest", metavar="SECONDS", help="smallest averaging time of the fit")
    ] = 0.0,
    longest: Annotated[
        float,
        typer.Option(
            "--longest",
            metavar="SECONDS",
            help="largest averaging time of the fit [default: a ninth of the log]",
            show_default=False,
        ),
    ] = math.inf,
    counted: Annotated[
        bool,
        typer.Option("--count-rows", help="treat rows as evenly spaced, for scattered time stamps of a host computer"),
    ] = False,
) -> VerbResult:
    """Fit an IMU card to a log of the IMU at rest.

    Overlapping Allan variance by axis: quantisation, white noise, bias instability, rate random walk, with intervals.
    """
    from lvnav_trade import api

    fit = api.fit_unit(log, out, plot, start, end, shortest, longest, counted)
    frame = fit.coefficients
    rows = [
        [
            row.sensor,
            row.coefficient,
            f"{row.estimate:.4g}" if row.shown else "not shown",
            f"{row.low:.4g} to {row.high:.4g}" if row.shown else f"below {row.high:.3g}",
            row.unit,
        ]
        for row in frame.itertuples()
    ]
    lines = [table(["axis", "coefficient", "estimate", "95 %", "unit"], rows)]
    if frame.shown[frame.coefficient == "bias_instability"].any():
        lines.append("bias_instability is B of IEEE 952; the floor of the Allan deviation is 0.664 B")
    lines.append(f"card: {out}")
    lines += [f"figure: {plot}"] if plot is not None else []
    content = {"card": str(out), "plot": str(plot) if plot else None, "seconds": fit.seconds, "rate_hz": fit.rate}
    return VerbResult("\n".join(lines), {**content, "coefficients": json.loads(frame.to_json(orient="records"))})


@verb("walk.yaml walk_log.yaml -o walk_outages --outage '15 s' --outage '60 s'")
def process_log(
    campaign: Annotated[
        str, typer.Argument(metavar="CAMPAIGN", help="campaign with the filters; each case is processed")
    ],
    log: Annotated[Path, typer.Argument(metavar="LOG", help="card of the log: files, axes, rest")],
    out: Annotated[Path, folder_option("report and tables")],
    outage: Annotated[
        list[str] | None,
        typer.Option("--outage", metavar="SECONDS", help="duration of outages [default: 15 s and 60 s]"),
    ] = None,
    first: Annotated[
        float, typer.Option("--first", metavar="SECONDS", help="start of the first outage, after the rest")
    ] = 20.0,
    every: Annotated[
        float, typer.Option("--every", metavar="SECONDS", help="interval between the starts of outages")
    ] = 5.0,
    sets: Annotated[list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="change the campaign")] = None,
) -> VerbResult:
    """Run a recorded log through the filters of a campaign.

    Receiver solutions are withheld repeatedly for some seconds; the error at the end is compared with the sigma.
    """
    from lvnav_trade import api
    from lvnav_trade.quantities.units import parse

    try:
        lengths = [parse(text, "s") for text in outage or ("15 s", "60 s")]
    except ValueError as error:
        raise InputError(f"--outage: {error}") from None
    if min(lengths) <= 0.0 or every <= 0.0 or first < 0.0:
        raise InputError("--outage and --every: should be above zero, --first not below it")
    filtered_log = api.process_log(campaign, log, out, lengths, first, every, sets or ())
    rows = [
        [
            row.case,
            f"{row.length_s:g} s",
            row.outages,
            row.failed,
            f"{row.inside_percent:.0f} %",
            *(
                ["-"] * 3
                if row.failed == row.outages
                else [f"{row.nees_ratio:.2f}", f"{row.position_rms_m:.3g} m", f"{row.position_worst_m:.3g} m"]
            ),
        ]
        for row in filtered_log.summary.itertuples()
    ]
    heading = math.degrees(filtered_log.alignment.heading) % 360.0
    lines = [
        table(["case", "withheld", "outages", "failed", "inside 3 sigma", "NEES", "position RMS", "worst"], rows),
        *filtered_log.notes,
        f"heading after the rest: {heading:.1f} deg; page: {out / 'report.html'}",
    ]
    content = {"page": str(out / "report.html"), "heading_deg": heading, "notes": list(filtered_log.notes)}
    summary = json.loads(filtered_log.summary.to_json(orient="records"))
    return VerbResult("\n".join(lines), content | {"summary": summary})
