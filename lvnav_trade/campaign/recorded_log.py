"""Processing of a recorded log by the filters of a campaign: estimates over time, and simulated outages."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from pydantic import ValidationError

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.syntax import tree
from lvnav_trade.kernels.transition import VEL
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, geodetic_from_ecef
from lvnav_trade.quantities.records import Floats
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.simulation.recorded.alignment import Alignment, align
from lvnav_trade.simulation.recorded.log_consistency import remove_wild_solutions
from lvnav_trade.simulation.recorded.navigation_log import NavigationLog, read_recording
from lvnav_trade.simulation.recorded.outages import Outage, outage
from lvnav_trade.simulation.recorded.recorded_flight import log_replay, refuse_unable

_MOTION = slice(VEL, VEL + 6)  # outputs of velocity and position


class OutagePlan(NamedTuple):
    """Outages in which the solutions of the receiver are withheld."""

    lengths: tuple[float, ...] = (15.0, 60.0)  # durations, s
    first: float = 20.0  # begin of the first outage, s after the rest
    interval: float = 5.0  # from the begin of an outage to the begin of the next, s


class FilteredLog(NamedTuple):
    """A log processed by the filters of a campaign."""

    card: NavigationLog  # card of the log
    alignment: Alignment  # attitude and biases from the rest
    track: pd.DataFrame  # estimates and their errors, one row per case and time
    outages: pd.DataFrame  # one row per case and outage
    summary: pd.DataFrame  # one row per case and duration of the outages
    notes: tuple[str, ...] = ()  # parts of the log that are not used, and failures


def read_card(file: Path) -> NavigationLog:
    """Read the card of a log.

    Parameters
    ----------
    file : Path
        File of the card.

    Raises
    ------
    InputError
        With all input errors of the card.
    """
    root = tree.read_mapping(file)
    try:
        return NavigationLog.model_validate(tree.plain_data(root))
    except ValidationError as error:
        raise InputError(records=explain(error, root, NavigationLog, "")) from None


def process(campaign: Campaign, file: Path, plan: OutagePlan) -> FilteredLog:
    """Process a log with the filter of every case of a campaign.

    The log replaces trajectory, IMU and receiver. The runs, requirements, faults and true errors of the campaign have
    no effect.

    Parameters
    ----------
    campaign : Campaign
        Campaign with the filters.
    file : Path
        Card of the log.
    plan : OutagePlan
        Outages to simulate.

    Returns
    -------
    FilteredLog
        Alignment, tracks, outages, summary.

    Raises
    ------
    InputError
        The log cannot be read or aligned, is too short for an outage, or lacks data that a filter needs.
    """
    card = read_card(file)
    all_cases = cases(campaign)
    for case in all_cases:
        with _label_errors(case):
            refuse_unable(case.scenario, card)
    # the lever arm of the first case: the log is of one vehicle, so all cases should have the same antenna
    lever_b = np.array(all_cases[0].scenario.receiver.lever_b)
    log = remove_wild_solutions(read_recording(card, file.parent), card, lever_b)
    alignment = align(log, card)
    tracks, outage_rows, notes = [], [], list(log.notes)
    for case in all_cases:
        with _label_errors(case):
            prepared_case, remarks = log_replay(case.scenario, log, card, alignment)
        track, failure = _track(case, prepared_case)
        tracks.append(track)
        notes += [f"{case.label}: {note}" for note in (*remarks, *failure)]
        outage_rows += [_outage_row(case, length, result) for length, result in _outages(prepared_case, plan)]
    if not outage_rows:
        lengths = " or ".join(f"{length:g}" for length in plan.lengths)
        raise InputError(
            f"{file}: no outage of {lengths} s fits between {plan.first:g} s after the rest and the end of the log"
        )
    outages = pd.DataFrame(outage_rows, columns=list(_COLUMNS))
    summary = outage_summary(outages)
    notes += failures(summary)
    return FilteredLog(
        card=card,
        alignment=alignment,
        track=pd.concat(tracks, ignore_index=True),
        outages=outages,
        summary=summary,
        notes=tuple(notes),
    )


def failures(summary: pd.DataFrame) -> Iterator[str]:
    """Yield a note for each case and duration with failed outages."""
    for row in summary[summary.failed > 0].itertuples():
        success_count = row.outages - row.failed
        basis_text = "there is no NEES, RMS or worst"
        if success_count:
            basis_text = f"NEES, RMS and worst are of the other {success_count}"
        yield (
            f"{row.case}, {row.length_s:g} s: {row.failed} of {row.outages} outages fail (the estimate is not finite, "
            f"or beyond the case's limit); {basis_text}"
        )


@contextmanager
def _label_errors(case: Case) -> Iterator[None]:
    """Add the label of a case to input errors raised within the block."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{case.label}: {error}") from None


def _outages(prepared_case: PreparedCase, plan: OutagePlan) -> list[tuple[float, Outage]]:
    """Return the outages of a replayed case, each with its nominal duration (s).

    Parameters
    ----------
    prepared_case : PreparedCase
        The replayed case.
    plan : OutagePlan
        Outages to simulate.
    """
    results = []
    for length in plan.lengths:
        for begin in np.arange(plan.first, prepared_case.t_epoch[-1] - length, plan.interval).tolist():
            result = outage(prepared_case, begin, length)
            if result is not None:
                results.append((length, result))
    return results


_COLUMNS = (
    "case",
    "length_s",
    "begin_s",
    "end_s",
    "position_error_m",
    "position_3sigma_m",
    "velocity_error_m_per_s",
    "velocity_3sigma_m_per_s",
    "nees_ratio",
    "inside",
    "failed",
)


def _outage_row(case: Case, length: float, result: Outage) -> dict[str, Any]:
    """Return an outage as a row of `_COLUMNS`; errors and sigmas of a failed outage are NaN.

    Parameters
    ----------
    case : Case
        The case.
    length : float
        Nominal duration of the outage (s).
    result : Outage
        Error (6,) of velocity (m/s) and position (m) at the end of the outage, reporting axes, with its covariance.
    """

    def norm(vector: Floats) -> float:
        return math.nan if result.has_failed else float(np.linalg.norm(vector))

    three_sigma = 3.0 * result.sigma
    return {
        "case": case.label,
        "length_s": length,
        "begin_s": result.begin,
        "end_s": result.end,
        "position_error_m": norm(result.error[3:]),
        "position_3sigma_m": norm(three_sigma[3:]),
        "velocity_error_m_per_s": norm(result.error[:3]),
        "velocity_3sigma_m_per_s": norm(three_sigma[:3]),
        "nees_ratio": result.square,
        "inside": result.is_inside,
        "failed": result.has_failed,
    }


def outage_summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the statistics of the outages by case and duration.

    Parameters
    ----------
    rows : pandas.DataFrame
        One row per outage.

    Returns
    -------
    pandas.DataFrame
        Number of outages, number of failed outages, percentage of all outages that end within three sigma; mean
        NEES ratio, RMS and largest errors of the outages that do not fail (NaN if all fail).
    """
    groups = rows.groupby(["case", "length_s"], sort=False)
    return pd.DataFrame(
        {
            "outages": groups.size(),
            "failed": groups.failed.sum().astype(int),
            "inside_percent": 100.0 * groups.inside.mean(),
            "nees_ratio": groups.nees_ratio.mean(),
            "position_rms_m": groups.position_error_m.agg(_rms),
            "position_worst_m": groups.position_error_m.max(),
            "velocity_rms_m_per_s": groups.velocity_error_m_per_s.agg(_rms),
        }
    ).reset_index()


def _rms(values: "pd.Series[float]") -> float:
    mean_square = np.mean(values**2)
    return float(np.sqrt(mean_square))


def _track(case: Case, prepared_case: PreparedCase) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Return the estimate over time with all solutions in use, and a note if the filter fails.

    Parameters
    ----------
    case : Case
        The case.
    prepared_case : PreparedCase
        The replayed case.

    Returns
    -------
    pandas.DataFrame, tuple of str
        Geodetic position (deg and m), errors with respect to the receiver's solutions, and sigmas; notes.
    """
    run = run_block(prepared_case, 0, 0, 1)
    error = run.err[0]
    sigma = run.sigma[0]
    motion_outputs = list(enumerate(prepared_case.outputs[: _MOTION.stop]))[_MOTION]
    position = [k for k, output in motion_outputs if output.quantity == "position"]
    # estimate = recorded position - error, as an error is truth minus estimate; rows of `axes`: the reporting axes
    record = prepared_case.record
    error_i = np.einsum("nji,nj->ni", record.axes, error[:, position])
    theta = earth_angle(prepared_case.trajectory.theta0, prepared_case.t_hist)
    estimate_i = record.r - error_i
    estimate_e = ecef_from_eci(estimate_i, theta)
    latitude, longitude, height = geodetic_from_ecef(estimate_e)
    track = pd.DataFrame({"case": case.label, "t_s": prepared_case.t_hist})
    track["latitude_deg"] = np.degrees(latitude)
    track["longitude_deg"] = np.degrees(longitude)
    track["height_m"] = height
    for k, output in motion_outputs:
        unit = output.unit.replace("/", "_per_")
        name = f"{output.quantity}_{output.axis}_{unit}"
        track[f"error_{name}"] = error[:, k]
        track[f"sigma_{name}"] = sigma[:, k]
    if not run.failed[0]:
        return track, ()
    note = f"the filter fails at {run.t_failed[0]:.6g} s after the rest with nothing withheld"
    return track, (note,)
