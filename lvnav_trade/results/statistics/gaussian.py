"""Gaussian distribution of an error by linear covariance, and the worst time of a phase with respect to a bound."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.statistics.case_results import SAME_TIME, CaseResults, Gaussian
from lvnav_trade.results.statistics.probability import norm_probability, probability_between
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
    columns = pick_columns(tables.covariances, names, case=case, event=event, quantity=quantity)
    times, source, row_axis, column_axis, covariance = columns
    axes = list(dict.fromkeys(row_axis))
    metric_axes = axes if axis == "3d" else [axis]
    if not axes or not set(metric_axes) <= set(axes):
        return None
    covariance_by_source = {}
    for name in dict.fromkeys(source):
        is_of_source = source == name
        elements = row_axis[is_of_source], column_axis[is_of_source], covariance[is_of_source]
        covariance_by_source[str(name)] = _matrix(axes, metric_axes, *elements)
    total = covariance_by_source.pop("")  # rows without a source
    mean = []
    for name in metric_axes:
        history = pick_columns(tables.history, ("t_s", "lincov_mean_si"), case=case, quantity=quantity, axis=name)
        t, mean_error = history
        nearest = np.argmin(np.abs(t - times[0]))
        mean.append(float(mean_error[nearest]))
    return Gaussian(np.array(mean), total, covariance_by_source)


def formal_covariance(tables: Tables, case: str, event: str, quantity: str) -> Floats | None:
    """Return the formal covariance (3, 3) of a quantity at an event of the nominal flight, SI; None if unknown.

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
    (3, 3) array or None
        Covariance assumed by the filter, reporting axes, SI.
    """
    rows = pick(tables.covariances, case=case, event=event, quantity=quantity, source="")
    axes = list(dict.fromkeys(rows.axis))
    if not axes:
        return None
    return _matrix(axes, axes, rows.axis, rows.other_axis, rows.formal_si2.to_numpy())


def _matrix(
    axes: list[str], shown_axes: list[str], row: Iterable[str], column: Iterable[str], values: Floats
) -> Floats:
    """Return the symmetric matrix of the shown axes.

    Parameters
    ----------
    axes : list of str
        All axes of the elements.
    shown_axes : list of str
        The k axes of the result, in its order.
    row, column : (n,) iterable of str
        Axes of the row and of the column of each element. An element also gives its mirror element.
    values : (n,) array
        Elements.

    Returns
    -------
    (k, k) array
        Matrix, in the unit of the elements.
    """
    matrix = np.zeros((len(axes), len(axes)))
    i = [axes.index(name) for name in row]
    j = [axes.index(name) for name in column]
    matrix[i, j] = values
    matrix[j, i] = values
    indices = [axes.index(name) for name in shown_axes]
    return matrix[np.ix_(indices, indices)]


def worst_time_gaussian(
    case: CaseResults, quantity: str, axis: str, phase_text: str, bound: float
) -> tuple[Gaussian, str] | None:
    """Return the distribution of an error at the time of a phase with the smallest probability of keeping a bound.

    Parameters
    ----------
    case : CaseResults
        Results of a case.
    quantity, axis : str
        The error; 3d is the norm.
    phase_text : str
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
    first, last = case.phase(phase_text)
    candidates: list[tuple[float, Gaussian, str]] = []  # probability of keeping the bound, distribution, time
    for event, t_event in case.events().items():
        if not first - SAME_TIME <= t_event <= last + SAME_TIME:
            continue
        law = case.gaussian(event, quantity, axis)
        if law is not None:
            probability = norm_probability(law.mean, law.covariance, bound)
            candidates.append((probability, law, event.replace("_", " ")))
    history = case.history(quantity, axis)
    has_started = history.t >= first - SAME_TIME
    has_not_ended = history.t <= last + SAME_TIME
    is_in_phase = has_started & has_not_ended & (history.true_sigma > 0.0)
    if axis != "3d" and is_in_phase.any():
        t = history.t[is_in_phase]
        sigma = history.true_sigma[is_in_phase]
        mean = history.mean[is_in_phase]
        low = (-bound - mean) / sigma
        high = (bound - mean) / sigma
        probabilities = probability_between(low, high)
        k = int(np.argmin(probabilities))
        variance = sigma[k : k + 1, None] ** 2
        law = Gaussian(mean[k : k + 1], variance, {})
        least_probability = float(probabilities[k])
        candidates.append((least_probability, law, f"{t[k]:.0f} s"))
    if not candidates:
        return None
    _, law, moment = min(candidates, key=lambda candidate: candidate[0])
    return law, moment
