"""Verbs of recorded data: fit-unit."""

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import Answer, verb

LogFile = Annotated[str, typer.Argument(metavar="LOG", help="CSV or Parquet, units in the names of its columns")]


@verb("unit_at_rest.csv -o configs/imu/my_unit.yaml --plot allan.png")
def fit_unit(
    log: LogFile,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="card to write")],
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="write the figure as PNG")] = None,
    start: Annotated[float | None, typer.Option("--start", metavar="SECONDS", help="from there on in the log")] = None,
    end: Annotated[float | None, typer.Option("--end", metavar="SECONDS", help="up to there in the log")] = None,
    shortest: Annotated[float, typer.Option("--shortest", metavar="SECONDS", help="averaging time to fit from")] = 0.0,
    longest: Annotated[
        float, typer.Option("--longest", metavar="SECONDS", help="and to", show_default="a ninth of the log")
    ] = math.inf,
) -> Answer:
    """Fit an IMU card to a log of the unit at rest.

    Overlapping Allan variance by axis: quantisation, white noise, bias instability, rate random walk, with intervals.
    """
    from lvnav_trade import logs

    found = logs.fit_unit(log, out, plot, start, end, shortest, longest)
    frame = found.coefficients
    rows = [
        [row.sensor, row.coefficient, f"{row.estimate:.4g}" if row.shown else "not shown",
         f"{row.low:.4g} to {row.high:.4g}" if row.shown else f"below {row.high:.3g}", row.unit]
        for row in frame.itertuples()
    ]  # fmt: skip
    lines = [table(["axis", "coefficient", "estimate", "95 %", "unit"], rows), f"card: {out}"]
    lines += [f"figure: {plot}"] if plot is not None else []
    content = {"card": str(out), "plot": str(plot) if plot else None, "seconds": found.seconds, "rate_hz": found.rate}
    return Answer("\n".join(lines), {**content, "coefficients": json.loads(frame.to_json(orient="records"))})
