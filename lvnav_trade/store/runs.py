"""The tables with rows of every run: errors, mode logic, draws at the start; of a vehicle under control."""

from typing import Any

import numpy as np

from lvnav_trade.engines.setup.starts import StartDraws
from lvnav_trade.engines.simulate.statistics import BlockSummary, columns
from lvnav_trade.records import MODES, REASONS, Output
from lvnav_trade.steering.nozzle import AXES, FEEDS, PHASES, Controlled
from lvnav_trade.store.schema import error_column, rms_column

FAILURES = {0: "", 1: "not finite", 2: "diverged"}


def run_columns(outputs: tuple[Output, ...], summary: BlockSummary | None) -> dict[str, dict[str, Any]]:
    """Return the columns of `runs`, `worst` and `logic` for some runs; without runs those of the outputs, empty.

    `worst` has one row per run and span from an event to the next.
    """
    every = columns(outputs)
    errors, means = (
        [column(output.quantity, output.axis, output.unit) for output in every] for column in (error_column, rms_column)
    )
    if summary is None:
        return {"runs": {name: [] for name in errors}, "worst": {name: [] for name in (*errors, *means)}, "logic": {}}
    n_event, n_span = len(summary.events), summary.worst.shape[1]
    failures = np.array([FAILURES.get(int(code), f"code {code}") for code in summary.failed])
    run, t, before, after, why = summary.changes.T
    runs = {
        "run_number": np.repeat(summary.runs, n_event),
        "event": list(summary.events) * summary.n_run,
        "t_s": np.tile(summary.t_event, summary.n_run),
        "failure": np.repeat(failures, n_event),
        "t_failed_s": np.repeat(summary.t_failed, n_event),
        "nees_ratio": summary.event_nees.ravel(),
    }
    worst = {
        "run_number": np.repeat(summary.runs, n_span),
        "t_s": np.tile(summary.t_bound[:-1], summary.n_run),
        "t_end_s": np.tile(summary.t_bound[1:], summary.n_run),
        "failure": np.repeat(failures, n_span),
    }
    logic = {
        "run_number": run.astype(np.int64),
        "t_s": t,
        "from_mode": np.array(MODES)[before.astype(int)],
        "to_mode": np.array(MODES)[after.astype(int)],
        "reason": np.array(REASONS)[why.astype(int)],
    }
    runs |= _named(errors, summary.event_error)
    worst |= _named(errors, summary.worst) | _named(means, np.sqrt(summary.mean_square))
    return {"runs": runs, "worst": worst, "logic": logic}


def _named(names: list[str], values: Any) -> dict[str, Any]:
    """Return the last axis of values (n_run, n, n_name) as columns."""
    return dict(zip(names, values.reshape(-1, len(names)).T, strict=True))


def start_columns(starts: StartDraws | None) -> dict[str, Any]:
    """Return the columns of the table of what runs draw at their start."""
    if starts is None:
        return {}
    n_run, n_draw = starts.values.shape
    return {
        "run_number": np.repeat(starts.runs, n_draw),
        "source": list(starts.sources) * n_run,
        "axis": list(starts.axes) * n_run,
        "draw_ratio": starts.values.ravel(),
    }


_TURNING = (
    "inside_turning_ratio", "inside_jerk_ratio", "furthest_turning_ratio", "furthest_jerk_ratio", "attitude_error_rad",
    "rate_error_rad_per_s", "rate_sigma_rad_per_s",
)  # fmt: skip
_MOTION = ("turning_rad_per_s2", "turning_bound_rad_per_s2", "jerk_m_per_s3", "jerk_bound_m_per_s3")
WHOLE = "flight"  # what stands for all burns together


def controlled_columns(found: Controlled) -> dict[str, dict[str, Any]]:
    """Return the columns of `nozzle`, `movement`, `turning` and `motion`."""
    burns = np.array([WHOLE] + [f"burn {number}" for number in range(1, found.total.shape[2])])
    feed, run, burn, axis = np.indices(found.total.shape).reshape(4, -1)
    nozzle = {
        "feed": np.array(FEEDS)[feed],
        "run_number": run,
        "burn": burns[burn],
        "axis": np.array(AXES)[axis],
        "moved_rad": found.total.ravel(),
    }
    feed, time, axis = np.indices(found.mean.shape).reshape(3, -1)
    sizes = {"mean_rad": found.mean, "low_rad": found.low, "high_rad": found.high}
    movement = {"t_s": found.t[time], "feed": np.array(FEEDS)[feed], "axis": np.array(AXES)[axis]}
    movement |= {name: values.ravel() for name, values in sizes.items()}
    feed, axis, phase = np.nonzero(found.turning[..., 0] > 0.0)
    ticks, *ratios = found.turning[feed, axis, phase].T
    turning = {"feed": np.array(FEEDS)[feed], "axis": np.array(AXES)[axis], "phase": np.array(PHASES)[phase]}
    turning |= {"tick_count": ticks.astype(np.int64), **dict(zip(_TURNING, ratios, strict=True))}
    axis, time = np.indices((2, found.shown_t.size)).reshape(2, -1)
    motion = {"t_s": found.shown_t[time], "axis": np.array(AXES)[axis]}
    motion |= dict(zip(_MOTION, found.shown[time, axis].T, strict=True))
    return {"nozzle": nozzle, "movement": movement, "turning": turning, "motion": motion}
