"""Recorded data from Python: the card of an IMU from its log at rest, and flight logs processed by filters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from lvnav_trade.api.display import FittedImu, ProcessedLog
from lvnav_trade.quantities.errors import writing


def fit_unit(
    log: str | Path,
    card: str | Path,
    plot: str | Path | None = None,
    start: float | None = None,
    end: float | None = None,
    shortest: float = 0.0,
    longest: float = math.inf,
    counted: bool = False,
) -> FittedImu:
    """Write the card of an IMU from its log at rest: Allan variance by axis.

    Parameters
    ----------
    log : str or Path
        Rows of the log, CSV or Parquet, units in the names of the columns.
    card : str or Path
        Card to write.
    plot : str or Path, optional
        Figure of the Allan deviation, PNG.
    start, end : float, optional
        Start and end of the evaluated part of the log, s after its first row.
    shortest, longest : float
        Smallest and largest averaging time of the fit (s).
    counted : bool
        The samples are equally spaced although their time stamps scatter: count samples and ignore the stamps.

    Returns
    -------
    FittedImu
        Coefficients with their intervals in the unit of each row, Allan deviations (SI), text of the card.

    Raises
    ------
    InputError
        The log cannot be read, has gaps, is uneven or too short: nothing has been written.
    """
    from lvnav_trade.campaign import unit_card
    from lvnav_trade.campaign.syntax.card_lookup import write_text
    from lvnav_trade.report.figures.raster import figure_bytes
    from lvnav_trade.report.figures.vehicle_motion import allan_of_log

    imu_fit = unit_card.fit_unit(str(log), start, end, shortest, longest, counted)
    write_text(Path(card), imu_fit.text)
    if plot is not None:
        with writing(plot, "the figure cannot be written there"):
            Path(plot).write_bytes(figure_bytes(allan_of_log(imu_fit.curves), "png"))
    return FittedImu(*imu_fit)


def process_log(
    campaign: str | Path,
    log: str | Path,
    folder: str | Path,
    lengths: Sequence[float] = (15.0, 60.0),
    first: float = 20.0,
    every: float = 5.0,
    sets: Sequence[str] = (),
) -> ProcessedLog:
    """Process a recorded log with the filters of a campaign; write the report and its tables to a folder.

    Outages are simulated by withholding the receiver's solutions. At the end of each outage the difference from the
    receiver's solution is compared with the sigma of the filter.

    Parameters
    ----------
    campaign : str or Path
        Campaign file; each of its cases is processed.
    log : str or Path
        Card of the log: files, axes, rest.
    folder : str or Path
        Folder of report and tables.
    lengths : sequence of float
        Durations of the outages (s).
    first : float
        Start of the first outage, s after the rest.
    every : float
        Time from the start of an outage to the start of the next (s).
    sets : sequence of str
        Assignments such as ``filter=filters/loose``.

    Returns
    -------
    ProcessedLog
        Alignment, track, outages and their summary, notes.

    Raises
    ------
    InputError
        Campaign or log cannot be read, or a filter needs data that the log does not have: nothing has been written.
    """
    from lvnav_trade.campaign.reading.load import load
    from lvnav_trade.campaign.recorded_log import OutagePlan, process
    from lvnav_trade.report.build import html_page, markdown_page, pictures
    from lvnav_trade.report.escape import csv_text
    from lvnav_trade.report.recorded import page
    from lvnav_trade.results.tables.contents import owned_folder

    target, loaded_campaign = owned_folder(folder, "report"), load(campaign, sets)
    filtered_log = process(loaded_campaign, Path(log), OutagePlan(tuple(lengths), first, every))
    content = page(filtered_log, loaded_campaign)
    tables = {"outages.csv": filtered_log.outages, "summary.csv": filtered_log.summary, "track.csv": filtered_log.track}
    with writing(folder, "the page cannot be written there"):
        files = {name: csv_text(frame) for name, frame in tables.items()}
        pages = {"report.html": html_page(*content), "report.md": markdown_page(*content)}
        target.publish("report", {**files, **pages, **pictures(content[2])})
    return ProcessedLog(*filtered_log)
