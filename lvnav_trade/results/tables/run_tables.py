"""Columns of the tables of single runs: errors at events, mode logic, initial draws, time histories of a few runs."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from lvnav_trade.quantities.records import (
    FIRST_UNIT,
    ISOLATED,
    MODES,
    ORBIT,
    OUTCOMES,
    REASONS,
    Floats,
    Output,
    RunBlock,
)
from lvnav_trade.results.tables.dictionary import error_column, rms_column
from lvnav_trade.simulation.preparation.initial_draws import InitialDraws
from lvnav_trade.simulation.statistics import NORM, BlockSummary, add_norms, columns
from lvnav_trade.trajectory.ascent.dispersion_card import SOURCES

DRAWN = ("attitude", "velocity", "position")
"""Quantities whose error budget and single runs are stored over the whole flight."""
MOST_TIMES = 400
"""Largest number of stored times of a run."""
ORBIT_UNITS = {
    **dict.fromkeys(("semi_major_axis", "perigee", "apogee"), "m"),
    **dict.fromkeys(("inclination", "node"), "rad"),
    **dict.fromkeys(("eccentricity_along_node", "eccentricity_ahead_of_node"), "dimensionless"),
}
"""SI units of the elements of an achieved orbit."""
INJECTION_UNITS = {**ORBIT_UNITS, "cutoff_time": "s", "propellant_left": "kg"}
"""SI units of the numbers of an injection."""
FAILURES = {0: "", 1: "not finite", 2: "diverged"}


def run_columns(
    outputs: tuple[Output, ...], summary: BlockSummary | None, channels: tuple[str, ...] = ()
) -> dict[str, dict[str, Any]]:
    """Return the columns of the tables of single runs, by table.

    `interval_errors` has one row per run and interval between events.

    Parameters
    ----------
    outputs : tuple of Output
        Reported errors of the case.
    summary : BlockSummary or None
        Statistics of some runs; None for empty columns.
    channels : tuple of str
        Names of the filter's measurement channels.
    """
    stored_columns = columns(outputs)
    errors = [error_column(output.quantity, output.axis, output.unit) for output in stored_columns]
    means = [rms_column(output.quantity, output.axis, output.unit) for output in stored_columns]
    if summary is None:
        return {
            "runs": {name: [] for name in errors},
            "interval_errors": {name: [] for name in (*errors, *means)},
            "mode_transitions": {},
            "integrity": {},
            "injections": {},
            "failed_injection_draws": {},
        }
    names = [FAILURES.get(int(code), f"code {code}") for code in summary.failed]
    failures = np.array(names)
    n_event = len(summary.events)
    runs = {
        "run_number": np.repeat(summary.runs, n_event),
        "event": list(summary.events) * summary.n_run,
        "t_s": np.tile(summary.t_event, summary.n_run),
        "failure": np.repeat(failures, n_event),
        "t_failed_s": np.repeat(summary.t_failed, n_event),
        "nees_ratio": summary.event_nees.ravel(),
        **_split_columns(errors, summary.event_error),
    }
    n_interval = summary.worst.shape[1]
    interval_errors = {
        "run_number": np.repeat(summary.runs, n_interval),
        "t_s": np.tile(summary.t_bound[:-1], summary.n_run),
        "t_end_s": np.tile(summary.t_bound[1:], summary.n_run),
        "failure": np.repeat(failures, n_interval),
        **_split_columns(errors, summary.worst),
        **_split_columns(means, np.sqrt(summary.mean_square)),
    }
    return {
        "runs": runs,
        "interval_errors": interval_errors,
        "mode_transitions": _transition_columns(summary),
        "integrity": integrity_columns(summary.decisions, channels),
        "injections": _injection_columns(summary),
        "failed_injection_draws": _failed_injection_columns(summary),
    }


def _transition_columns(summary: BlockSummary) -> dict[str, Any]:
    """Return the columns of `mode_transitions`: one row per transition of the filter's mode logic."""
    run, t, from_mode, to_mode, reason = summary.changes.T
    return {
        "run_number": run.astype(np.int64),
        "t_s": t,
        "from_mode": np.array(MODES)[from_mode.astype(int)],
        "to_mode": np.array(MODES)[to_mode.astype(int)],
        "reason": np.array(REASONS)[reason.astype(int)],
    }


def _injection_columns(summary: BlockSummary) -> dict[str, Any]:
    """Return the columns of `injections`: one row per run and orbital element."""
    if not len(summary.injections):
        return {}
    n = len(ORBIT)
    outcome = np.repeat(summary.injections[:, 0], n)
    return {
        "run_number": np.repeat(summary.runs, n),
        "outcome": np.array(OUTCOMES)[outcome.astype(int)],
        "t_s": np.repeat(summary.injections[:, 1], n),
        "propellant_left_kg": np.repeat(summary.injections[:, 2], n),
        "quantity": list(ORBIT) * summary.n_run,
        "unit": [ORBIT_UNITS[name] for name in ORBIT] * summary.n_run,
        "error_si": summary.injections[:, 3 : 3 + n].ravel(),
        "knowledge_si": summary.injections[:, 3 + n :].ravel(),
    }


def _failed_injection_columns(summary: BlockSummary) -> dict[str, Any]:
    """Return the columns of `failed_injection_draws`: one row per draw of a run that does not reach its cut-off."""
    run, source, number, value = summary.lost.T
    return {
        "run_number": run.astype(np.int64),
        "source": np.array(SOURCES)[source.astype(int)],
        "draw_number": number.astype(np.int64),
        "draw_ratio": value,
    }


def integrity_columns(decisions: Floats, channels: tuple[str, ...]) -> dict[str, Any]:
    """Return the columns of `integrity` and `nominal_integrity`: decisions of the tests for faults.

    decisions : (n, 4). Run, time (s), number in `ISOLATED`, and number of the channel: -1 is no channel, and numbers
        from `FIRST_UNIT` downward are IMUs
    channels : names of the filter's measurement channels
    """
    run, t, isolated_number, channel = decisions.T
    channel_number = channel.astype(int)
    # The names are indexed by the number of the channel; negative numbers count from the end of the list.
    lowest = int(channel_number.min(initial=0))
    n_imu = max(0, FIRST_UNIT - lowest) + 1
    imu_names = [f"unit {k + 1}" for k in range(n_imu)]
    names = np.array([*channels, *reversed(imu_names), ""])
    return {
        "run_number": run.astype(np.int64),
        "t_s": t,
        "isolated_element": np.array(ISOLATED)[isolated_number.astype(int)],
        "channel": names[channel_number],
    }


def _split_columns(names: list[str], values: Any) -> dict[str, Any]:
    """Return values (n_run, n, n_name) as one column (n_run * n,) per name."""
    return dict(zip(names, values.reshape(-1, len(names)).T, strict=True))


def start_columns(starts: InitialDraws | None) -> dict[str, Any]:
    """Return the columns of `initial_draws`: initial and turn-on draws of the runs."""
    if starts is None:
        return {}
    n_run, n_draw = starts.values.shape
    return {
        "run_number": np.repeat(starts.runs, n_draw),
        "source": list(starts.sources) * n_run,
        "axis": list(starts.axes) * n_run,
        "draw_ratio": starts.values.ravel(),
    }


def trace_columns(outputs: tuple[Output, ...], blocks: Iterable[RunBlock]) -> dict[str, Any]:
    """Return the columns of `traces` for blocks of one run each, at most `MOST_TIMES` times including the last."""
    stored_columns = columns(outputs)
    norms = [k for k, output in enumerate(stored_columns) if output.axis == NORM and output.quantity in DRAWN]
    quantities = [stored_columns[k].quantity for k in norms]
    units = [stored_columns[k].unit for k in norms]
    pieces: list[dict[str, Any]] = []
    for block in blocks:
        n_time = len(block.t)
        step = max(1, math.ceil(n_time / MOST_TIMES))
        index = np.arange(n_time)[::-step][::-1]
        t = block.t[index]
        error = add_norms(block.err[0, index], outputs)[:, norms]
        sigma = add_norms(block.sigma[0, index], outputs)[:, norms]
        error[t >= _failure_time(block)] = np.nan
        pieces.append(
            {
                "run_number": np.full(index.size * len(norms), block.first_run),
                "t_s": np.tile(t, len(norms)),
                "quantity": np.repeat(quantities, index.size),
                "unit": np.repeat(units, index.size),
                "error_si": error.T.ravel(),
                "sigma_si": sigma.T.ravel(),
            }
        )
    if not pieces:
        return {}
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}


def _failure_time(block: RunBlock) -> float:
    """Return the time (s) at which the only run of a block failed; infinite if it did not fail."""
    if not block.failed[0] or np.isnan(block.t_failed[0]):
        return np.inf
    return float(block.t_failed[0])
