"""Coverage: fraction of the runs with errors within three formal sigmas."""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.quantities import units
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.results.statistics.gaussian import formal_covariance, gaussian
from lvnav_trade.results.statistics.probability import box_probability, success_bounds
from lvnav_trade.results.statistics.select import NAVIGATION, at_time, errors_by_axis, flight_events, history_of, pick
from lvnav_trade.results.tables.read import Tables

COLUMNS = [
    "case",
    "event",
    "t_s",
    "quantity",
    "run_count",
    "inside_ratio",
    "all_inside_ratio",
    "low_ratio",
    "high_ratio",
    "honest",
]
SIGMAS = 3.0
# Probability of a Gaussian within three sigmas
GAUSSIAN = 0.9973
_TAIL = 0.025  # probability of each tail of the interval


class CoverageProbability(NamedTuple):
    """Probability that all three axes are within three formal sigmas."""

    formal: float  # for errors with the formal covariance; NaN if not known
    true: float  # for errors by linear covariance; NaN if not known
    runs: Floats  # (n_run,) one if all axes of the run are within, else zero; empty without runs


def coverage_probability(tables: Tables, case: str, event: str, quantity: str) -> CoverageProbability:
    """Return the coverage of a quantity at an event by formal covariance, by linear covariance and by the runs.

    The first two use the formal sigmas of the nominal flight, the last the RMS over the runs of their formal sigmas.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    event : str
        Name of the event.
    quantity : str
        Navigation error, such as position.
    """
    formal = true = np.nan
    covariance = formal_covariance(tables, case, event, quantity)
    law = gaussian(tables, case, event, quantity, "3d")
    if covariance is not None and law is not None:
        limits = SIGMAS * np.sqrt(np.diagonal(covariance))
        formal = box_probability(np.zeros(3), covariance, limits)
        true = box_probability(law.mean, law.covariance, limits)
    is_all_within = _within_sigmas(tables, case, event, quantity).all(axis=1)
    return CoverageProbability(formal, true, is_all_within.astype(float))


def probability_below_limit(tables: Tables, case: str, event: str, quantity: str, limit: str) -> CoverageProbability:
    """Return the runs whose 3-D error at an event is below a limit; the numbers of linear covariance are NaN.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    event : str
        Name of the event.
    quantity : str
        Navigation error, such as position.
    limit : str
        Limit with its unit.
    """
    outputs = pick(tables.outputs, case=case, quantity=quantity)
    errors = errors_by_axis(tables, case, event, quantity)
    if errors.empty or outputs.empty:
        return CoverageProbability(np.nan, np.nan, np.empty(0))
    components = errors.drop(columns="failure").to_numpy(dtype=float)
    size = np.linalg.norm(components, axis=1)
    limit_si = units.parse(limit, str(outputs.unit.iloc[0]))
    is_sound = (errors.failure == "").to_numpy()
    is_below = (size < limit_si) & is_sound
    return CoverageProbability(np.nan, np.nan, is_below.astype(float))


def coverage(tables: Tables) -> pd.DataFrame:
    """Return the fraction of runs within three formal sigmas of attitude, velocity and position at the events.

    Columns: case, event, t_s, quantity, run_count; inside_ratio: fraction within, of all runs and axes;
    all_inside_ratio: fraction of runs with all axes within; low_ratio, high_ratio: its 95 % interval (Clopper and
    Pearson); honest: whether the interval reaches 0.9919, the probability of three independent Gaussian axes. Sigma is
    the RMS over the runs of their formal sigmas.
    """
    rows = []
    for case, label in tables.labels.items():
        for event in flight_events(tables, case).event:
            for quantity in NAVIGATION:
                values = _coverage_values(tables, case, event, quantity)
                if values:
                    rows.append({"case": label, "event": event} | values)
    return pd.DataFrame(rows, columns=COLUMNS)


def _within_sigmas(tables: Tables, case: str, event: str, quantity: str) -> Bools:
    """Return whether each error of the runs at an event is within three formal sigmas.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    event : str
        Name of the event.
    quantity : str
        Navigation error, such as position.

    Returns
    -------
    (n_run, 3) array of bool
        By run and reporting axis; False for failed runs. Empty (0, 3) if the results do not have the errors.
    """
    runs = errors_by_axis(tables, case, event, quantity)
    outputs = pick(tables.outputs, case=case, quantity=quantity)
    axes = [axis for axis in outputs.axis if axis != "3d"]
    if runs.empty or not axes:
        return np.zeros((0, 3), dtype=bool)
    t = float(pick(tables.runs, case=case, event=event).t_s.iloc[0])
    sigma = []
    for axis in axes:
        history = history_of(tables, case, quantity, axis)
        sigma.append(at_time(history, t).filter_sigma_si)
    bound = SIGMAS * np.array(sigma)
    is_within = runs.drop(columns="failure").abs() <= bound
    is_sound = (runs.failure == "").to_numpy()
    return np.asarray(is_within.to_numpy() & is_sound[:, None])


def _coverage_values(tables: Tables, case: str, event: str, quantity: str) -> dict[str, Any]:
    """Return the values of `COLUMNS` from the time on; empty if the results do not have the errors."""
    is_within = _within_sigmas(tables, case, event, quantity)
    if not len(is_within):
        return {}
    n = len(is_within)
    is_all_within = is_within.all(axis=1)
    low, high = success_bounds(n, int(n - is_all_within.sum()), 1.0 - _TAIL)
    return {
        "t_s": float(pick(tables.runs, case=case, event=event).t_s.iloc[0]),
        "quantity": quantity,
        "run_count": n,
        "inside_ratio": float(is_within.mean()),
        "all_inside_ratio": float(is_all_within.mean()),
        "low_ratio": low,
        "high_ratio": high,
        "honest": bool(high >= GAUSSIAN**3),
    }
