"""Global sensitivity of an error to the sigmas of its sources: closed form (frozen filter) and fit (re-tuned).

The sigma of source k is multiplied by f_k, with log f_k uniform between -log F and log F.

Frozen filter: the mean square is c + sum_k s_k f_k^2, with the variances s_k of the error budget. First-order and
total index are therefore equal, s_k^2 / sum_j s_j^2.

Re-tuned filter: the logarithm of the mean square is computed by linear covariance at `samples` Sobol points, where
`matched` filter models follow the sigmas, and fitted by Legendre polynomials. The indices are those of the fit
(`fitted_indices`). The half-widths are the 95 % intervals over fits to `RESAMPLED` bootstrap samples.

local: derivative of the logarithm of the RMS error by the logarithm of sigma, with frozen gains: s_k / total.
"""

import time
from typing import NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.definition.schema import Campaign, Requirement
from lvnav_trade.campaign.definition.searches import Indices
from lvnav_trade.campaign.reading.spaced import points
from lvnav_trade.campaign.running.case_arrays import CaseArrays
from lvnav_trade.campaign.running.pool import each
from lvnav_trade.campaign.search.point import HISTORY, look, not_described
from lvnav_trade.covariance.diagnostics.case_diagnostics import flown_events, scaled
from lvnav_trade.covariance.history import covariance
from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.records import CovHistory, Floats
from lvnav_trade.results.metrics.injection import InjectionError
from lvnav_trade.results.metrics.state_errors import NORM, StateError
from lvnav_trade.results.registry import metric_of
from lvnav_trade.results.statistics.probability import basis, fitted, fitted_indices, predicted
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.prepare import Prepared, prepare

COLUMNS = [
    "source",
    "share_ratio",
    "local",
    "frozen_first",
    "frozen_total",
    "retuned_first",
    "retuned_first_half_width",
    "retuned_total",
    "retuned_total_half_width",
]
RESAMPLED = 100


class ErrorIndices(NamedTuple):
    """Sensitivity indices of an error."""

    indices: pd.DataFrame  # indices of the largest sources, columns `COLUMNS`
    case: str  # label of the case
    error: str  # metric and event
    covered: float  # share of these sources in the mean square of the error
    predicted: float  # coefficient of determination of the fit for designs excluded from it; 1 for an exact fit
    samples: int  # number of designs
    seconds: float  # wall time, s
    remark: str = ""  # reason why linear covariance does not describe the case; empty if it does


def indices(campaign: Campaign, settings: Indices, jobs: int = 1) -> ErrorIndices:
    """Return the sensitivity indices of the mean square of a requirement's error in the first case; see the module.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    settings : Indices
        Requirement, number of sources, range of their sigmas, number of samples.
    jobs : int
        Worker processes.

    Returns
    -------
    ErrorIndices
        Indices and quality of the fit.

    Raises
    ------
    InputError
        There is no such requirement, linear covariance does not give its error, or there are too few samples.
    """
    begun = time.monotonic()
    requirement = _requirement(campaign, settings.requirement)
    case = cases(campaign)[0]
    prepared = prepare(case.scenario, campaign.keep.history)
    history = covariance(prepared)
    parts = _mean_squares(prepared, history, requirement)
    able = [k for k in np.argsort(-parts.by_source) if _is_scaled(case.scenario, parts.sources[k])][: settings.sources]
    sources, s = [parts.sources[k] for k in able], parts.by_source[able]
    d, total = len(sources), parts.total
    if settings.samples < 2 * (terms := len(basis(d))):
        raise InputError(f"indices.samples: {settings.samples} are too few for {terms} polynomials; give {2 * terms}")
    u = 2.0 * points("sobol", d, 1 << (settings.samples - 1).bit_length(), campaign.seed)[: settings.samples] - 1.0
    items = [(case.scenario, sources, settings.factor**sample, requirement) for sample in u]
    value = np.array(list(each(jobs, mean_square, items, ordered=True)))
    rng = np.random.default_rng(campaign.seed)
    picks = [np.arange(len(u)), *rng.integers(0, len(u), (RESAMPLED, len(u)))]
    by_fit = fitted_indices(np.array([fitted(u[pick], value[pick]) for pick in picks]), d)
    first, total_index = by_fit[:, 0]  # row 0 is the fit to all designs; the others are bootstrap samples
    widths = 0.5 * np.ptp(np.quantile(by_fit[:, 1:], (0.025, 0.975), axis=1), axis=0)
    frozen = s**2 / np.sum(s**2)
    rows = zip(sources, s / total, s / total, frozen, frozen, first, widths[0], total_index, widths[1], strict=True)
    return ErrorIndices(
        pd.DataFrame(list(rows), columns=COLUMNS),
        case.label,
        f"{requirement.metric} at {requirement.at}",
        float(s.sum() / total),
        predicted(u, value),
        settings.samples,
        time.monotonic() - begun,
        not_described(result.outside for result in look(campaign, case.scenario, [requirement.name]).values()),
    )


def _requirement(campaign: Campaign, name: str) -> Requirement:
    candidates = [requirement for requirement in campaign.requirements if not name or requirement.name == name]
    if (
        not candidates
        or candidates[0].during is not None
        or not isinstance(metric_of(candidates[0].metric), StateError | InjectionError)
    ):
        raise InputError(
            f"indices.requirement: no requirement {quoted(name)} on an error of navigation or injection at an event"
        )
    return candidates[0]


class _MeanSquares(NamedTuple):
    """Mean square of an error by linear covariance, SI.

    sources : Names of the error sources.
    by_source : (n_source,). Contribution of each source.
    total : Sum of all contributions, and the square of the mean.
    """

    sources: tuple[str, ...]
    by_source: Floats
    total: float


def _mean_squares(prepared: Prepared, history: CovHistory, requirement: Requirement) -> _MeanSquares:
    """Return the mean square of a requirement's error, by source; InputError if linear covariance does not give it."""
    metric = metric_of(requirement.metric)
    if isinstance(metric, InjectionError):
        return _of_injection(prepared, history, requirement)
    events = flown_events(prepared)
    columns = [
        k
        for k, output in enumerate(prepared.outputs)
        if isinstance(metric, StateError) and output.quantity == metric.quantity and metric.axis in (NORM, output.axis)
    ]
    if requirement.at not in events or not columns:
        raise InputError(f"indices: linear covariance does not hold {requirement.metric} at {requirement.at}")
    at = int(np.argmin(np.abs(history.t - events[str(requirement.at)])))
    by_source = history.budget[at][:, columns].sum(axis=1)
    return _MeanSquares(history.sources, by_source, float(by_source.sum() + np.sum(history.mean[at, columns] ** 2)))


def _of_injection(prepared: Prepared, history: CovHistory, requirement: Requirement) -> _MeanSquares:
    """As `_mean_squares`, for an error of the injection of a guided ascent."""
    distribution = metric_of(requirement.metric).law(CaseArrays(prepared, history), requirement.model_dump(mode="json"))
    if isinstance(distribution, str):
        raise InputError(f"indices.requirement: {requirement.metric}: {distribution}")
    law = distribution.law
    if not law.sources:
        raise InputError(
            f"indices.requirement: near a circular orbit {requirement.metric} is not a sum over error sources; use "
            "injection_semi_major_axis_error or injection_eccentricity_vector_error"
        )
    by_source = np.array([np.trace(part) for part in law.sources.values()])
    return _MeanSquares(tuple(law.sources), by_source, float(np.trace(law.covariance) + law.mean @ law.mean))


def _is_scaled(scenario: Scenario, source: str) -> bool:
    return scaled(scenario, source, 2.0) != scenario


def mean_square(scenario: Scenario, sources: list[str], factors: Floats, requirement: Requirement) -> float:
    """Return the true mean square of a requirement's error, with the sigmas of error sources scaled.

    Parameters
    ----------
    scenario : Scenario
        The scenario; `matched` filter models follow the scaled sigmas.
    sources : list of str
        Names of the error sources.
    factors : (n_source,) array
        Factor of each sigma.
    requirement : Requirement
        Requirement on an error at an event.

    Returns
    -------
    float
        Mean square (SI).
    """
    for source, factor in zip(sources, factors, strict=True):
        scenario = scaled(scenario, source, float(factor))
    prepared = prepare(scenario, HISTORY)
    return _mean_squares(prepared, covariance(prepared), requirement).total
