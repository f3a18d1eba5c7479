"""A recorded log through the filters of a campaign's cases: the estimate over time, and outages in every case."""

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
from lvnav_trade.engines.recorded.alignment import Alignment, align
from lvnav_trade.engines.recorded.consistency import consistent
from lvnav_trade.engines.recorded.flight import refuse_unable, replayed
from lvnav_trade.engines.recorded.outages import Outage, outage
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.engines.simulate.montecarlo import run_block
from lvnav_trade.errors import InputError
from lvnav_trade.frames import earth_angle, ecef_from_eci, geodetic_from_ecef
from lvnav_trade.kernels.transition import VEL
from lvnav_trade.world.user_file.navigation_log import NavigationLog, read_recording

_MOTION = slice(VEL, VEL + 6)  # outputs of velocity and position


class Asked(NamedTuple):
    """Outages to withhold: lengths (s), the first one's begin and the step from one to the next, s after the rest."""

    lengths: tuple[float, ...] = (15.0, 60.0)
    first: float = 20.0
    every: float = 5.0


class Processed(NamedTuple):
    """A log through the cases of a campaign: its alignment; track, a row per case and time; outages, a row per case
    and outage; summary, a row per case and length of outage; notes: on what of the log is left out, and on failures.
    """

    card: NavigationLog
    alignment: Alignment
    track: pd.DataFrame
    outages: pd.DataFrame
    summary: pd.DataFrame
    notes: tuple[str, ...] = ()


def read_card(file: Path) -> NavigationLog:
    """Return the card of a log; InputError for every mistake in it."""
    root = tree.read_mapping(file)
    try:
        return NavigationLog.model_validate(tree.plain(root))
    except ValidationError as error:
        raise InputError(records=explain(error, root, NavigationLog, "")) from None


def process(campaign: Campaign, file: Path, asked: Asked) -> Processed:
    """Return what the filters of a campaign make of a log, whose card is a file.

    Runs, requirements, faults and the true errors of the campaign do not count: the log takes the place of
    trajectory, unit and receiver.

    InputError where the log cannot be read or aligned, or a case's filter takes what it has not.
    """
    card = read_card(file)
    found = cases(campaign)
    for case in found:
        with _of(case):
            refuse_unable(case.scenario, card)
    # the antenna of the first case: the log is of one vehicle
    log = consistent(read_recording(card, file.parent), card, np.array(found[0].scenario.receiver.lever_b))
    aligned = align(log, card)
    tracks, outages, notes = [], [], list(log.notes)
    for case in found:
        with _of(case):
            prepared, said = replayed(case.scenario, log, card, aligned)
        track, failure = _track(case, prepared)
        tracks.append(track)
        notes += [f"{case.label}: {one}" for one in (*said, *failure)]
        outages += [_row(case, length, one) for length, one in _outages(prepared, asked)]
    rows = pd.DataFrame(outages, columns=list(_COLUMNS))
    if rows.empty:
        raise InputError(
            f"{file}: no outage of {' or '.join(f'{length:g}' for length in asked.lengths)} s fits between "
            f"{asked.first:g} s after the rest and the end of the log"
        )
    summary = summarised(rows)
    notes += failures(summary)
    return Processed(card, aligned, pd.concat(tracks, ignore_index=True), rows, summary, tuple(notes))


def failures(summary: pd.DataFrame) -> Iterator[str]:
    """Say of each case and length how many outages fail."""
    for row in summary[summary.failed > 0].itertuples():
        others = row.outages - row.failed
        rest = f"NEES, RMS and worst are of the other {others}" if others else "there is no NEES, RMS or worst"
        yield (
            f"{row.case}, {row.length_s:g} s: {row.failed} of {row.outages} outages fail (the estimate is not finite, "
            f"or beyond the case's limit); {rest}"
        )


@contextmanager
def _of(case: Case) -> Iterator[None]:
    """Let a mistake that is found within say which case it is of."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{case.label}: {error}") from None


def _outages(prepared: Prepared, asked: Asked) -> list[tuple[float, Outage]]:
    """Return the outages of a replayed case with the length that was asked for."""
    found = []
    for length in asked.lengths:
        for begin in np.arange(asked.first, prepared.t_epoch[-1] - length, asked.every).tolist():
            one = outage(prepared, begin, length)
            if one is not None:
                found.append((length, one))
    return found


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


def _row(case: Case, length: float, one: Outage) -> dict[str, Any]:
    sigma = 3.0 * one.sigma
    velocity, position = one.error[:3], one.error[3:]
    sizes = (position, sigma[3:], velocity, sigma[:3])
    norms = (math.nan if one.failed else float(np.linalg.norm(part)) for part in sizes)
    values = (case.label, length, one.begin, one.end, *norms)
    return dict(zip(_COLUMNS, (*values, one.square, one.inside, one.failed), strict=True))


def summarised(rows: pd.DataFrame) -> pd.DataFrame:
    """Return for each case and length how many outages there are, how many of them fail, which part of all ends within
    three sigma, and the errors of those that do not fail (NaN where all fail).
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
    return float(np.sqrt(np.mean(values**2)))


def _track(case: Case, prepared: Prepared) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Return the estimate over time with nothing withheld: its place, its errors against the solutions, its sigmas;
    and a note where it fails.
    """
    run, record = run_block(prepared, 0, 0, 1), prepared.record
    error, sigma = run.err[0], run.sigma[0]
    shown = list(enumerate(prepared.outputs[: _MOTION.stop]))[_MOTION]
    r_i = record.r - np.einsum(
        "nji,nj->ni", record.axes, error[:, [k for k, one in shown if one.quantity == "position"]]
    )
    place = geodetic_from_ecef(ecef_from_eci(r_i, earth_angle(prepared.trajectory.theta0, prepared.t_hist)))
    frame = pd.DataFrame({"case": case.label, "t_s": prepared.t_hist})
    frame["latitude_deg"], frame["longitude_deg"], frame["height_m"] = (*np.degrees(place[:2]), place[2])
    for k, one in shown:
        name = f"{one.quantity}_{one.axis}_{one.unit.replace('/', '_per_')}"
        frame[f"error_{name}"], frame[f"sigma_{name}"] = error[:, k], sigma[:, k]
    failed = f"the filter fails at {run.t_failed[0]:.6g} s after the rest with nothing withheld"
    return frame, (failed,) if run.failed[0] else ()
