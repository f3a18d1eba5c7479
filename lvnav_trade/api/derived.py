"""Cards and files derived from a case: process noise, stored gains, a trajectory file, a first campaign."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from lvnav_trade.api.display import ExportedTrajectory, StartedCampaign
from lvnav_trade.api.selecting import case_of
from lvnav_trade.api.types import EstimatedNoise
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.quantities.errors import InputError, writing

if TYPE_CHECKING:
    from lvnav_trade.filter.policies.stored_gains import GainSchedule


def estimate_q(
    campaign: str | Path | Campaign,
    file: str | Path,
    sets: Sequence[str] = (),
    case: str | None = None,
    runs: int = 100,
    step: float | None = None,
) -> EstimatedNoise:
    """Estimate the process noise of a filter from perturbed runs of a case, and write a filter card with it.

    The runs of the ensemble are unaided, with all IMU errors and initial errors. The error that the filter's
    transition does not predict within a step gives the spectral densities. The error per step is written next to the
    card as CSV and PNG.

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
        Number of runs of the ensemble.
    step : float, optional
        Length of a step (s); the interval between measurement updates if absent.

    Returns
    -------
    EstimatedNoise
        Root spectral densities (SI) of the whole flight and of each phase, and the files.

    Raises
    ------
    InputError
        The campaign has an input error, or a file cannot be written.
    """
    from lvnav_trade.campaign.derived_cards import process_noise
    from lvnav_trade.campaign.syntax.card_lookup import write_card
    from lvnav_trade.report.escape import csv_text
    from lvnav_trade.report.figures.published import steps
    from lvnav_trade.report.figures.raster import figure_bytes

    loaded_campaign, found_case = case_of(campaign, sets, case)
    noise = process_noise(loaded_campaign, found_case, runs, step)
    card = Path(file)
    table = card.with_suffix(".csv")
    picture = card.with_suffix(".png")
    write_card(card, noise.card)
    with writing(card, "its tables cannot be written there"):
        table.write_text(csv_text(noise.steps), encoding="utf-8")
        figure = steps(noise.steps, [phase[:3] for phase in noise.phases])
        picture.write_bytes(figure_bytes(figure, "png"))
    return EstimatedNoise(noise, card, (table, picture))


def schedule_gains(
    campaign: str | Path | Campaign,
    file: str | Path,
    sets: Sequence[str] = (),
    case: str | None = None,
    by: Literal["event", "time"] = "event",
    tolerance: float = 0.02,
) -> GainSchedule:
    """Record the Kalman gains of a case on its nominal flight; write them as a card for `filter.gains`.

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
        Index of the stored gains in flight: the time since the last event, or the time since lift-off.
    tolerance : float
        Largest interpolation error between knots, as a fraction of the largest magnitude of each gain.

    Returns
    -------
    GainSchedule
        States of the filter, and segments with their knots.

    Raises
    ------
    InputError
        The campaign has an input error, or the file cannot be written.
    """
    from lvnav_trade.campaign.derived_cards import gain_schedule
    from lvnav_trade.campaign.syntax.card_lookup import write_card

    loaded_campaign, found_case = case_of(campaign, sets, case)
    schedule = gain_schedule(loaded_campaign, found_case, by, tolerance)
    write_card(Path(file), schedule)
    return schedule


def export_trajectory(
    source: str | Path, file: str | Path, sets: Sequence[str] = (), case: str | None = None, rate: float = 10.0
) -> ExportedTrajectory:
    """Write a trajectory as a CSV file with its card, and compare the file, read back, with the original.

    Parameters
    ----------
    source : str or Path
        Trajectory card, or campaign file.
    file : str or Path
        CSV file to write; its card is written next to it.
    sets : sequence of str
        Assignments; for a campaign only.
    case : str, optional
        Case of a campaign; the first case if absent.
    rate : float
        Rows per second (Hz). Changes of specific force and angular rate between two rows are not resolved.

    Returns
    -------
    ExportedTrajectory
        Files, times (s) of the events, largest differences between the file and the original (SI).

    Raises
    ------
    InputError
        The card or campaign has an input error, or a file exists already.
    """
    from lvnav_trade.campaign.reading.flights import read_card
    from lvnav_trade.campaign.reading.starting import is_card, write_flight

    if is_card(str(source), Path.cwd()):
        if sets or case:
            raise InputError(f"{source}: is a trajectory card; assignments and cases are those of a campaign")
        card = read_card(str(source), Path.cwd())
    else:
        _, found_case = case_of(source, sets, case)
        card = found_case.scenario.trajectory
    return ExportedTrajectory(*write_flight(card, Path(file), rate))


def init(folder: str | Path, file: str | Path, epoch: str | None = None, time: str | None = None) -> StartedCampaign:
    """Write a first campaign for your own trajectory; existing files are never overwritten.

    Columns, units, frames and events are guessed. The card gives the reason for every guess, line by line.

    Parameters
    ----------
    folder : str or Path
        Folder of the new campaign.
    file : str or Path
        Table of the trajectory, CSV or Parquet.
    epoch : str, optional
        Time of lift-off, UTC, such as ``2027-02-01T12:00:00Z``; assumed if absent.
    time : str, optional
        Name of the time column; guessed if absent.

    Returns
    -------
    StartedCampaign
        Campaign, card, guesses with their reasons, events.

    Raises
    ------
    InputError
        The table cannot be read, or a file exists already.
    """
    from lvnav_trade.campaign.reading.starting import start

    return StartedCampaign(*start(Path(folder), Path(file), epoch, time))
