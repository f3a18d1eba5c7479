"""Protection levels on the nominal flight: bounds on position and velocity errors at a given integrity risk.

The filter is compared with sub-filters, each without one satellite for the whole flight (solution separation: Brenner
1996; Young and McGraw, Navigation 50(3), 2003; multiple hypotheses as in Blanch et al., IEEE Trans. AES 51(1), 2015). A
sub-filter never uses its satellite, so it bounds a failure of that satellite with any onset.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from lvnav_trade.covariance.history import covariance
from lvnav_trade.quantities.records import CovHistory, Floats, Ints, ProtectionRisks
from lvnav_trade.quantities.state_layout import PROTECTED
from lvnav_trade.simulation.preparation.prepare import PreparedCase

_HALVINGS = 60


class Protection(NamedTuple):
    """Protection levels over a flight, by axis of position and velocity, SI, reporting axes.

    t : (n_hist,) s since lift-off. History times.
    sigma : (n_hist, n_quantity, 3). Standard deviation in the filter's own covariance.
    fault_free_level : (n_hist, n_quantity, 3). Protection level if no satellite fails.
    level : (n_hist, n_quantity, 3). Protection level with satellite failures.
    worst_satellite : (n_hist, n_quantity). Number in `satellites` of the failure with the largest level, -1 none.
    satellites : (n_satellite,). Names of the satellites in use, each with a sub-filter without it.
    limits : (n_satellite, n_hist, n_quantity, 3). Alarm limit on the separation of the sub-filter.
    separation : (n_satellite, n_hist, n_quantity, 3). Mean separation: mean error of the filter minus that of the sub-
        filter.
    alarms : Whether every run tests for alarms.
    """

    t: Floats
    sigma: Floats
    fault_free_level: Floats
    level: Floats
    worst_satellite: Ints
    satellites: tuple[str, ...]
    limits: Floats
    separation: Floats
    alarms: bool


def exceedance_probability(size: Floats, sigma: Floats) -> Floats:
    """Return the probability (...) that the magnitude of a centred Gaussian exceeds a size.

    Parameters
    ----------
    size
        (...). Size.
    sigma
        (...). Standard deviation, in the unit of the size.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(sigma > 0.0, size / sigma, np.inf)
        probability = 2.0 * ndtr(-ratio)
        return np.asarray(np.where(size <= 0.0, 1.0, probability))


def quantile(probability: float) -> float:
    """Return the number of sigmas that the magnitude of a centred Gaussian exceeds with a probability."""
    return float(-ndtri(0.5 * probability))


def thresholds(sigma: Floats, sub_filter_sigma: Floats, false_alarm: float) -> Floats:
    """Return the alarm limits of the separations between a filter and its sub-filters, (n_satellite, ...).

    For optimal filters Var(x_0 - x_k) = Var(x_k) - Var(x_0). The false-alarm probability of one axis is shared by all
    satellites.

    Parameters
    ----------
    sigma, sub_filter_sigma
        (...) and (n_satellite, ...). Sigma of the filter and of its sub-filters.
    false_alarm
        Probability of an alarm of any satellite, for one axis.
    """
    separation_variance = sub_filter_sigma**2 - sigma**2
    separation_sigma = np.sqrt(np.maximum(0.0, separation_variance))
    n_satellite = max(1, len(sub_filter_sigma))
    return np.asarray(separation_sigma * quantile(false_alarm / n_satellite))


def protection_level(sigma: Floats, sub_filter_sigma: Floats, limits: Floats, risk: float, prior: float) -> Floats:
    """Return the smallest L (...) with 2 Q(L / s_0) + prior sum_k 2 Q((L - T_k) / s_k) <= risk, by bisection.

    Parameters
    ----------
    sigma, sub_filter_sigma
        (...) and (n_satellite, ...). Sigma s_0 of the filter and s_k of its sub-filters.
    limits
        (n_satellite, ...). Alarm limits T_k of the separations.
    risk, prior
        Integrity risk, and prior probability that a satellite has failed.
    """
    # at this bound every probability of the sum is at most its share of the risk
    share = risk / (1.0 + prior * len(sub_filter_sigma))
    sigma_factor = quantile(share)
    lower_level = np.zeros(sigma.shape)
    upper_level = sigma_factor * sigma
    if len(sub_filter_sigma):
        bound = limits + sigma_factor * sub_filter_sigma
        upper_level = np.maximum(upper_level, np.max(bound, axis=0))
    for _ in range(_HALVINGS):
        middle_level = 0.5 * (lower_level + upper_level)
        fault_free_probability = exceedance_probability(middle_level, sigma)
        fault_probability = exceedance_probability(middle_level - limits, sub_filter_sigma)
        integrity_risk = fault_free_probability + prior * np.sum(fault_probability, axis=0)
        is_too_low = integrity_risk > risk
        lower_level = np.where(is_too_low, middle_level, lower_level)
        upper_level = np.where(is_too_low, upper_level, middle_level)
    return np.asarray(upper_level)


def exclude_satellite(prepared_case: PreparedCase, satellite: int) -> PreparedCase:
    """Return the case with a filter that does not use a satellite; truth and draws are unchanged."""
    model = prepared_case.model
    n_observable = model.n_observable
    is_processed = model.is_processed.copy()
    first = n_observable * satellite
    is_processed[first : n_observable * (satellite + 1)] = False
    return prepared_case._replace(model=model._replace(is_processed=is_processed))


def output_columns(prepared_case: PreparedCase) -> list[list[int]]:
    """Return the columns of the outputs of position and of velocity, by axis."""
    columns = []
    for name in PROTECTED:
        columns.append([k for k, output in enumerate(prepared_case.outputs) if output.quantity == name])
    return columns


def protection(prepared_case: PreparedCase, history: CovHistory, risks: ProtectionRisks) -> Protection:
    """Return the protection levels of a case, by one linear covariance for every satellite that its filter uses.

    Integrity risk and false-alarm probability are divided equally between the three axes of position and of velocity,
    so both apply to all six together (union bound).

    Parameters
    ----------
    prepared_case
        Prepared case.
    history
        Linear covariance of the case.
    risks
        Integrity risk, false-alarm probability, prior probability of a satellite fault.
    """
    columns = output_columns(prepared_case)
    satellite_numbers = prepared_case.signals.satellite_by_slot
    satellites = np.unique(satellite_numbers[satellite_numbers >= 0]).tolist()
    n_axis = sum(len(axes) for axes in columns)
    risk = risks.integrity_risk / n_axis
    false_alarm = risks.false_alarm / n_axis
    sigma = history.formal_sigma[:, columns]
    mean = history.mean[:, columns]
    sub_filter_sigma = np.zeros((len(satellites), *sigma.shape))
    separation = np.zeros_like(sub_filter_sigma)
    for k, satellite in enumerate(satellites):
        sub_filter = covariance(exclude_satellite(prepared_case, satellite))
        # with fewer measurements the sigma is not smaller; rounding may make it so
        sub_filter_sigma[k] = np.maximum(sub_filter.formal_sigma[:, columns], sigma)
        separation[k] = mean - sub_filter.mean[:, columns]
    limits = thresholds(sigma, sub_filter_sigma, false_alarm)
    level = protection_level(sigma, sub_filter_sigma, limits, risk, risks.satellite_fault)
    return Protection(
        t=history.t,
        sigma=sigma,
        fault_free_level=quantile(risk) * sigma,
        level=level,
        worst_satellite=_worst_failures(sigma, sub_filter_sigma, limits, risk),
        satellites=tuple(prepared_case.sky.names[satellite] for satellite in satellites),
        limits=limits,
        separation=separation,
        alarms=risks.alarms,
    )


def _worst_failures(sigma: Floats, sub_filter_sigma: Floats, limits: Floats, risk: float) -> Ints:
    """Return the satellite whose failure has the largest level, (n_hist, n_quantity); -1 if no sub-filter is worse."""
    if not len(sub_filter_sigma):
        return np.full(sigma.shape[:2], -1)
    bound = limits + quantile(risk) * sub_filter_sigma
    level = np.linalg.norm(bound, axis=-1)
    rounded_sigma = sigma * (1.0 + 1e-9)
    is_none_worse = np.all(sub_filter_sigma <= rounded_sigma, axis=(0, -1))
    worst_satellite = np.argmax(level, axis=0)
    return np.where(is_none_worse, -1, worst_satellite)
