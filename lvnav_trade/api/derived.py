"""Cards and files made from a case: process noise, stored gains, a flight, a first campaign."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from lvnav_trade.api.choosing import case_of
from lvnav_trade.api.shown import ExportedTrajectory, StartedCampaign
from lvnav_trade.api.types import EstimatedNoise
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.errors import InputError, writing

if TYPE_CHECKING:
    from lvnav_trade.filters.scheduled import GainSchedule


def estimate_q(
    campaign: str | Path | Campaign,
    file: str | Path,
    sets: Sequence[str] = (),
    case: str | None = None,
    runs: int = 100,
    step: float | None = None,
) -> EstimatedNoise:
    """Estimate process noise from perturbed runs of a case, and write the filter's card with it.

    The error per step is written next to the card as CSV and PNG.

    Parameters
    ----------
    campaign : str, Path or Campaign
        Campaign file, name of a campaign that comes with the tool, or a loaded one.
    file : str or Path
        Card to write.
    sets : sequence of str
        Assignments such as ``imu=imu/tactical_fog``.
    case : str, optional
        Label of a case, or its digest or the beginning of it; the first case if absent.
    runs : int
        Runs of the ensemble, perturbed by the errors of the IMU.
    step : float, optional
        Length of a step (s); the time between updates if absent.

    Returns
    -------
    EstimatedNoise
        Root spectral densities (SI) over the flight and by phase, and the files.

    Raises
    ------
    InputError
        A mistake in the campaign, or a file that cannot be written.
    """
    from lvnav_trade.campaign.derived import process_noise
    from lvnav_trade.campaign.syntax.cards import write_card
    from lvnav_trade.plots.published import steps
    from lvnav_trade.plots.raster import written
    from lvnav_trade.report.escape import csv_text

    found = process_noise(*case_of(campaign, sets, case), runs, step)
    card = Path(file)
    files = (card.with_suffix(".csv"), card.with_suffix(".png"))
    write_card(card, found.card)
    with writing(card, "its tables cannot be written there"):
        files[0].write_text(csv_text(found.steps), encoding="utf-8")
        files[1].write_bytes(written(steps(found.steps, [phase[:3] for phase in found.phases]), "png"))
    return EstimatedNoise(found, card, files)


def schedule_gains(
    campaign: str | Path | Campaign,
    file: str | Path,
    sets: Sequence[str] = (),
    case: str | None = None,
    by: Literal["event", "time"] = "event",
    tolerance: float = 0.02,
) -> GainSchedule:
    """Write the gains of a case's filter on its nominal flight as a card for `filter.gains`.

    Parameters
    ----------
    campaign : str, Path or Campaign
        Campaign file, name of a campaign that comes with the tool, or a loaded one.
    file : str or Path
        Card to write.
    sets : sequence of str
        Assignments such as ``imu=imu/tactical_fog``.
    case : str, optional
        Label of a case, or its digest or the beginning of it; the first case if absent.
    by : {"event", "time"}
        What the gains are counted from in flight.
    tolerance : float
        Largest difference between knots, as a share of each gain's largest size.

    Returns
    -------
    GainSchedule
        States, and segments with their knots.

    Raises
    ------
    InputError
        A mistake in the campaign, or a file that cannot be written.
    """
    from lvnav_trade.campaign.derived import gain_schedule
    from lvnav_trade.campaign.syntax.cards import write_card

    found = gain_schedule(*case_of(campaign, sets, case), by, tolerance)
    write_card(Path(file), found)
    return found


def export_trajectory(
    source: str | Path, file: str | Path, sets: Sequence[str] = (), case: str | None = None, rate: float = 10.0
) -> ExportedTrajectory:
    """Write a flight as a CSV file and the card that names it; the file is flown again to find the difference.

    Parameters
    ----------
    source : str or Path
        Trajectory card, or campaign file.
    file : str or Path
        CSV file to write; its card is next to it.
    sets : sequence of str
        Assignments, of a campaign only.
    case : str, optional
        Case of a campaign; the first if absent.
    rate : float
        Rows per second (Hz). Force and rate that change faster than rows 0.1 s apart show are not resolved.

    Returns
    -------
    ExportedTrajectory
        Files, times (s) of the events, largest differences of the export when flown (SI).

    Raises
    ------
    InputError
        A mistake in the card or campaign, or a file that exists.
    """
    from lvnav_trade.campaign.reading.exporting import is_card, write_flight
    from lvnav_trade.campaign.reading.flights import read_card

    if is_card(str(source), Path.cwd()):
        if sets or case:
            raise InputError(f"{source}: is a trajectory card; assignments and cases are those of a campaign")
        card = read_card(str(source), Path.cwd())
    else:
        card = case_of(source, sets, case)[1].scenario.trajectory
    return ExportedTrajectory(*write_flight(card, Path(file), rate))


def init(folder: str | Path, file: str | Path, epoch: str | None = None, time: str | None = None) -> StartedCampaign:
    """Write a first campaign around a flight of your own; no file is overwritten.

    Columns, units, frames and events are guessed; the card says why, line by line.

    Parameters
    ----------
    folder : str or Path
        Folder of the new campaign.
    file : str or Path
        Rows of the flight, CSV or Parquet.
    epoch : str, optional
        Lift-off, UTC, such as ``2027-02-01T12:00:00Z``; assumed if absent.
    time : str, optional
        Column of time; guessed if absent.

    Returns
    -------
    StartedCampaign
        Campaign, card, guesses with their reasons, events.

    Raises
    ------
    InputError
        The rows cannot be read, or a file exists.
    """
    from lvnav_trade.campaign.reading.starting import start

    return StartedCampaign(*start(Path(folder), Path(file), epoch, time))
