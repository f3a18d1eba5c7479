"""Protection levels on the nominal flight: bounds on position and velocity at a stated integrity risk.

The filter beside sub-filters, each without one satellite for the whole flight (solution separation: Brenner 1996; Young
and McGraw, Navigation 50(3), 2003; multiple hypotheses as in Blanch et al., IEEE Trans. AES 51(1), 2015). A sub-filter
never uses its satellite, so it bounds a failure of that one however it began.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from lvnav_trade.engines.lincov.history import covariance
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.layout import PROTECTED
from lvnav_trade.records import CovHistory, Floats, Protecting

_HALVINGS = 60


class Protection(NamedTuple):
    """Protection levels over a flight, by axis of position and velocity, SI, reporting axes.

    t : (n_hist,) s since lift-off. History times.
    sigma : (n_hist, n_quantity, 3). Standard deviation in the filter's own covariance.
    fault_free : (n_hist, n_quantity, 3). Protection level if no satellite fails.
    level : (n_hist, n_quantity, 3). Protection level with satellite failures.
    worst : (n_hist, n_quantity). Number in `satellites` of the failure with the largest level, -1 none.
    satellites : (n_satellite,). Names of the satellites in use, each with a sub-filter without it.
    limits : (n_satellite, n_hist, n_quantity, 3). Alarm limit on the separation of the sub-filter.
    apart : (n_satellite, n_hist, n_quantity, 3). Mean separation: mean error of the filter minus that of the sub-
        filter.
    alarms : Whether every run tests for alarms.
    """

    t: Floats
    sigma: Floats
    fault_free: Floats
    level: Floats
    worst: Floats
    satellites: tuple[str, ...]
    limits: Floats
    apart: Floats
    alarms: bool


def beyond(size: Floats, sigma: Floats) -> Floats:
    """Return the probability that a centred Gaussian is larger than a size, on either side."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(size <= 0.0, 1.0, 2.0 * ndtr(-np.where(sigma > 0.0, size / sigma, np.inf))))


def quantile(probability: float) -> float:
    """Return how many sigmas a centred Gaussian exceeds, on either side, with a probability."""
    return float(-ndtri(0.5 * probability))


def thresholds(sigma: Floats, without: Floats, false_alarm: float) -> Floats:
    """Return the limits (n_satellite, ...) of the separation of a filter (sigma) and its sub-filters (without), for an
    alarm of any satellite, of one axis, with a probability. Var(x_0 - x_k) = Var(x_k) - Var(x_0) of optimal filters.
    """
    apart = np.sqrt(np.maximum(0.0, without**2 - sigma**2))
    return np.asarray(apart * quantile(false_alarm / max(1, len(without))))


def protection_level(sigma: Floats, without: Floats, limits: Floats, risk: float, prior: float) -> Floats:
    """Return the least size L (...) with 2 Q(L / s_0) + prior sum_k 2 Q((L - T_k) / s_k) <= risk, by bisection.

    Parameters
    ----------
    sigma, without
        (...) of the filter's error and (n_satellite, ...) of those of its sub-filters.
    limits
        (n_satellite, ...) T_k of the separations.
    risk, prior
        Integrity risk, and probability that a satellite has failed.
    """
    reach = quantile(risk / (1.0 + prior * len(without)))
    low, high = np.zeros(sigma.shape), reach * sigma
    if len(without):
        high = np.maximum(high, np.max(limits + reach * without, axis=0))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        total = beyond(middle, sigma) + prior * np.sum(beyond(middle - limits, without), axis=0)
        low, high = np.where(total > risk, middle, low), np.where(total > risk, high, middle)
    return np.asarray(high)


def without_satellite(prepared: Prepared, satellite: int) -> Prepared:
    """Return the case whose filter takes nothing of a satellite; the truth, and its draws, stay as they are."""
    model, n_kind = prepared.model, prepared.model.n_kind
    measured = model.measured.copy()
    measured[n_kind * satellite : n_kind * (satellite + 1)] = False
    return prepared._replace(model=model._replace(measured=measured))


def columns_of(prepared: Prepared) -> list[list[int]]:
    """Return the outputs of position and of velocity, by axis."""
    return [[k for k, one in enumerate(prepared.outputs) if one.quantity == name] for name in PROTECTED]


def protection(prepared: Prepared, history: CovHistory, asked: Protecting) -> Protection:
    """Return the protection levels of a case: one further linear covariance for every satellite that its filter uses.

    The risk and the false alarms are shared out evenly over the three axes of position and the three of velocity, so
    both probabilities are of any of the six (union bound).
    """
    columns, used = columns_of(prepared), np.unique(prepared.signals.used[prepared.signals.used >= 0]).tolist()
    n_axis = sum(len(axes) for axes in columns)
    risk, false_alarm = asked.integrity_risk / n_axis, asked.false_alarm / n_axis
    sigma, mean = history.formal[:, columns], history.mean[:, columns]
    found = [covariance(without_satellite(prepared, satellite)) for satellite in used]
    shape = (len(used), *sigma.shape)
    without = np.maximum(np.array([one.formal[:, columns] for one in found]).reshape(shape), sigma)
    apart = mean - np.array([one.mean[:, columns] for one in found]).reshape(shape)
    limits = thresholds(sigma, without, false_alarm)
    level = protection_level(sigma, without, limits, risk, asked.satellite_fault)
    asking = limits + quantile(risk) * without
    worst = np.argmax(np.linalg.norm(asking, axis=-1), axis=0) if used else np.full(sigma.shape[:2], -1)
    alike = np.all(without <= sigma * (1.0 + 1e-9), axis=(0, -1)) if used else True
    return Protection(
        history.t,
        sigma,
        quantile(risk) * sigma,
        level,
        np.where(alike, -1, worst),
        tuple(prepared.sky.names[satellite] for satellite in used),
        limits,
        apart,
        asked.alarms,
    )
