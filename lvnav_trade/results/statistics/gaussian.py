"""Gaussian distribution of an error by linear covariance, and the worst time of a phase with respect to a bound."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy import special

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.statistics.case_results import SAME_TIME, CaseResults, Gaussian
from lvnav_trade.results.statistics.probability import norm_probability
from lvnav_trade.results.tables.read import Tables, pick, pick_columns


def gaussian(tables: Tables, case: str, event: str, quantity: str, axis: str) -> Gaussian | None:
    """Return the Gaussian distribution of an error at an event, by linear covariance.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    event : str
        Name of the event.
    quantity : str
        attitude, velocity, position, or one of the backup strapdown.
    axis : str
        Axis, or 3d for all three components.

    Returns
    -------
    Gaussian or None
        Mean, covariance and its part due to each error source, SI, reporting axes; None if it is not stored.
    """
    names = ("t_s", "source", "axis", "other_axis", "true_si2")
    times, source, *elements = pick_columns(tables.covariances, names, case=case, event=event, quantity=quantity)
    axes = list(dict.fromkeys(elements[0]))
    wanted = axes if axis == "3d" else [axis]
    if not axes or not set(wanted) <= set(axes):
        return None
    parts = {str(name): source == name for name in dict.fromkeys(source)}
    by_source = {name: _matrix(axes, wanted, *(column[part] for column in elements)) for name, part in parts.items()}
    mean = []
    for name in wanted:
        t, size = pick_columns(tables.history, ("t_s", "lincov_mean_si"), case=case, quantity=quantity, axis=name)
        mean.append(float(size[np.argmin(np.abs(t - times[0]))]))
    return Gaussian(np.array(mean), by_source.pop(""), by_source)  # the rows without a source are the total


def formal_covariance(tables: Tables, case: str, event: str, quantity: str) -> Floats | None:
    """Return the formal covariance (3, 3) of a quantity at an event of the nominal flight, SI; None if unknown."""
    rows = pick(tables.covariances, case=case, event=event, quantity=quantity, source="")
    axes = list(dict.fromkeys(rows.axis))
    return _matrix(axes, axes, rows.axis, rows.other_axis, rows.formal_si2.to_numpy()) if axes else None


def _matrix(axes: list[str], wanted: list[str], row: Iterable[str], column: Iterable[str], values: Floats) -> Floats:
    """Return the symmetric matrix (k, k) of the wanted axes, from elements (n,) with their row and column axes (n,)."""
    matrix = np.zeros((len(axes), len(axes)))
    i, j = ([axes.index(name) for name in names] for names in (row, column))
    matrix[i, j] = matrix[j, i] = values
    chosen = [axes.index(name) for name in wanted]
    return matrix[np.ix_(chosen, chosen)]


def least_kept(case: CaseResults, quantity: str, axis: str, during: str, bound: float) -> tuple[Gaussian, str] | None:
    """Return the distribution of an error at the time of a phase with the smallest probability of keeping a bound.

    Parameters
    ----------
    case : CaseResults
        Results of a case.
    quantity, axis : str
        The error; 3d is the norm.
    during : str
        Phase, such as ``liftoff to injection``.
    bound : float
        Bound on the magnitude, SI.

    Returns
    -------
    (Gaussian, str) or None
        Distribution, and event or time; None if nothing is known in the phase.

    Notes
    -----
    The norm needs the covariance of three axes, which is stored at events only. The error along one axis is also
    examined at every time of the history.
    """
    first, last = case.phase(during)
    candidates: list[tuple[float, Gaussian, str]] = []
    for event, at in case.events().items():
        law = case.gaussian(event, quantity, axis) if first - SAME_TIME <= at <= last + SAME_TIME else None
        if law is not None:
            candidates.append((norm_probability(law.mean, law.covariance, bound), law, event.replace("_", " ")))
    rows = case.history(quantity, axis)
    inside = (rows.t >= first - SAME_TIME) & (rows.t <= last + SAME_TIME) & (rows.true > 0.0)
    if axis != "3d" and inside.any():
        t, sigma, mean = rows.t[inside], rows.true[inside], rows.mean[inside]
        kept = special.ndtr((bound - mean) / sigma) - special.ndtr((-bound - mean) / sigma)
        k = int(np.argmin(kept))
        law = Gaussian(mean[k : k + 1], sigma[k : k + 1, None] ** 2, {})
        candidates.append((float(kept[k]), law, f"{t[k]:.0f} s"))
    return min(candidates, key=lambda candidate: candidate[0])[1:] if candidates else None
