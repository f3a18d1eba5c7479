"""Global sensitivity of an error to the sigmas of its sources: closed form (frozen filter) and fit (re-tuned).

The sigma of source k is multiplied by f_k, with log f_k uniform between -log F and log F.

Frozen filter: the mean square is c + sum_k s_k f_k^2, with the variances s_k of the error budget. First-order and
total index are therefore equal, s_k^2 / sum_j s_j^2.

Re-tuned filter: the logarithm of the mean square is computed by linear covariance at `samples` Sobol points, where
`matched` filter models follow the sigmas, and fitted by Legendre polynomials. The indices are those of the fit
(`fitted_indices`). The half-widths are the 95 % intervals over fits to `RESAMPLE_COUNT` bootstrap samples.

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
from lvnav_trade.campaign.running.pool import map_items
from lvnav_trade.campaign.search.point import HISTORY, combined_remark, evaluate_requirements
from lvnav_trade.covariance.diagnostics.case_diagnostics import flight_events, scale_source
from lvnav_trade.covariance.history import covariance
from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.records import CovHistory, Floats
from lvnav_trade.results.metrics.injection import InjectionError
from lvnav_trade.results.metrics.state_errors import NORM, StateError
from lvnav_trade.results.registry import metric_of
from lvnav_trade.results.statistics.probability import basis, fit_polynomials, fitted_indices, predicted_variance_share
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare

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
RESAMPLE_COUNT = 100


class ErrorIndices(NamedTuple):
    """Sensitivity indices of an error."""

    indices: pd.DataFrame  # indices of the largest sources, columns `COLUMNS`
    case: str  # label of the case
    error: str  # metric and event
    covered_share: float  # share of these sources in the mean square of the error
    determination: float  # coefficient of determination of the fit for designs excluded from it; 1 for an exact fit
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
    start_time = time.monotonic()
    requirement = _requirement(campaign, settings.requirement)
    case = cases(campaign)[0]
    prepared_case = prepare(case.scenario, campaign.keep.history)
    history = covariance(prepared_case)
    budget = _mean_squares(prepared_case, history, requirement)
    largest_first = np.argsort(-budget.by_source)
    scalable_indices = [k for k in largest_first if _is_scaled(case.scenario, budget.sources[k])]
    source_indices = scalable_indices[: settings.sources]
    sources = [budget.sources[k] for k in source_indices]
    variances = budget.by_source[source_indices]
    u = _sampled_designs(len(sources), settings.samples, campaign.seed)
    items = [(case.scenario, sources, settings.factor**design, requirement) for design in u]
    mean_squares = np.array(list(map_items(jobs, mean_square, items, is_ordered=True)))
    retuned_indices = _fitted_indices(u, mean_squares, campaign.seed)
    verdicts = evaluate_requirements(campaign, case.scenario, [requirement.name])
    return ErrorIndices(
        indices=_index_table(sources, variances, budget.total, retuned_indices),
        case=case.label,
        error=f"{requirement.metric} at {requirement.at}",
        covered_share=float(variances.sum() / budget.total),
        determination=predicted_variance_share(u, mean_squares),
        samples=settings.samples,
        seconds=time.monotonic() - start_time,
        remark=combined_remark(verdict.validity_remark for verdict in verdicts.values()),
    )


def _sampled_designs(n_source: int, samples: int, seed: int) -> Floats:
    """Return the sampled designs as Sobol points between -1 and 1.

    Parameters
    ----------
    n_source : int
        Number of error sources.
    samples : int
        Number of designs.
    seed : int
        Seed of the scrambling.

    Returns
    -------
    (samples, n_source) array
        Exponents u of the sources: each sigma is multiplied by ``factor**u``.

    Raises
    ------
    InputError
        The designs are too few for the fit of the polynomials.
    """
    terms = len(basis(n_source))
    if samples < 2 * terms:
        raise InputError(f"indices.samples: {samples} are too few for {terms} polynomials; give {2 * terms}")
    power_of_two = 1 << (samples - 1).bit_length()  # Sobol sequences are balanced for powers of two only
    unit_cube = points("sobol", n_source, power_of_two, seed)[:samples]
    return 2.0 * unit_cube - 1.0


class _FittedIndices(NamedTuple):
    """Indices of the fit to all designs, with their 95 % bootstrap intervals.

    first : (n_source,). First-order index.
    first_half_width : (n_source,). Half-width of its interval.
    total : (n_source,). Total index.
    total_half_width : (n_source,). Half-width of its interval.
    """

    first: Floats
    first_half_width: Floats
    total: Floats
    total_half_width: Floats


def _fitted_indices(u: Floats, mean_squares: Floats, seed: int) -> _FittedIndices:
    """Return the indices of the re-tuned filter, from polynomials fitted to the mean squares of the designs.

    Parameters
    ----------
    u : (n_sample, n_source) array
        Designs: exponents of the factor of each sigma, between -1 and 1.
    mean_squares : (n_sample,) array
        Mean square of the error of each design.
    seed : int
        Seed of the bootstrap resamples.
    """
    n_sample, n_source = u.shape
    rng = np.random.default_rng(seed)
    resamples = rng.integers(0, n_sample, (RESAMPLE_COUNT, n_sample))
    fits = [fit_polynomials(u, mean_squares)]
    fits += [fit_polynomials(u[resample], mean_squares[resample]) for resample in resamples]
    by_fit = fitted_indices(np.array(fits), n_source)  # (first and total, fit, source)
    first, total = by_fit[:, 0]
    interval = np.quantile(by_fit[:, 1:], (0.025, 0.975), axis=1)
    first_half_width, total_half_width = 0.5 * np.ptp(interval, axis=0)
    return _FittedIndices(first, first_half_width, total, total_half_width)


def _index_table(sources: list[str], variances: Floats, total: float, retuned_indices: _FittedIndices) -> pd.DataFrame:
    """Return the table of `COLUMNS`.

    Parameters
    ----------
    sources : list of str
        Names of the error sources.
    variances : (n_source,) array
        Mean square of the error due to each source.
    total : float
        Mean square of the error, including the sources that are not in the table.
    retuned_indices : _FittedIndices
        Indices of the re-tuned filter.
    """
    share = variances / total
    squares = variances**2
    frozen = squares / np.sum(squares)
    columns = [
        sources,
        share,
        share,  # with frozen gains the local derivative equals the share
        frozen,
        frozen,
        retuned_indices.first,
        retuned_indices.first_half_width,
        retuned_indices.total,
        retuned_indices.total_half_width,
    ]
    rows = list(zip(*columns, strict=True))
    return pd.DataFrame(rows, columns=COLUMNS)


def _requirement(campaign: Campaign, name: str) -> Requirement:
    """Return the requirement with a name, or the first if the name is empty."""
    for requirement in campaign.requirements:
        if name in ("", requirement.name):
            is_error = isinstance(metric_of(requirement.metric), StateError | InjectionError)
            if requirement.during is None and is_error:
                return requirement
            break
    raise InputError(
        f"indices.requirement: no requirement {quoted(name)} on an error of navigation or injection at an event"
    )


class _MeanSquares(NamedTuple):
    """Mean square of an error by linear covariance, SI.

    sources : Names of the error sources.
    by_source : (n_source,). Contribution of each source.
    total : Sum of all contributions, and the square of the mean.
    """

    sources: tuple[str, ...]
    by_source: Floats
    total: float


def _mean_squares(prepared_case: PreparedCase, history: CovHistory, requirement: Requirement) -> _MeanSquares:
    """Return the mean square of a requirement's error, by source.

    Parameters
    ----------
    prepared_case : PreparedCase
        The prepared case.
    history : CovHistory
        Its linear covariance.
    requirement : Requirement
        Requirement at an event.

    Raises
    ------
    InputError
        Linear covariance does not give the error at the event.
    """
    metric = metric_of(requirement.metric)
    if isinstance(metric, InjectionError):
        return _injection_mean_squares(prepared_case, history, requirement)
    events = flight_events(prepared_case)
    columns = []
    if isinstance(metric, StateError):
        for k, output in enumerate(prepared_case.outputs):
            if output.quantity == metric.quantity and metric.axis in (NORM, output.axis):
                columns.append(k)
    if requirement.at not in events or not columns:
        raise InputError(f"indices: linear covariance does not hold {requirement.metric} at {requirement.at}")
    t_event = events[str(requirement.at)]
    epoch = int(np.argmin(np.abs(history.t - t_event)))
    by_source = history.budget[epoch][:, columns].sum(axis=1)
    mean = history.mean[epoch, columns]
    total = by_source.sum() + np.sum(mean**2)
    return _MeanSquares(history.sources, by_source, float(total))


def _injection_mean_squares(prepared_case: PreparedCase, history: CovHistory, requirement: Requirement) -> _MeanSquares:
    """As `_mean_squares`, for an error of the injection of a guided ascent."""
    results = CaseArrays(prepared_case, history)
    metric = metric_of(requirement.metric)
    distribution = metric.distribution(results, requirement.model_dump(mode="json"))
    if isinstance(distribution, str):
        raise InputError(f"indices.requirement: {requirement.metric}: {distribution}")
    law = distribution.law
    if not law.sources:
        raise InputError(
            f"indices.requirement: near a circular orbit {requirement.metric} is not a sum over error sources; use "
            "injection_semi_major_axis_error or injection_eccentricity_vector_error"
        )
    by_source = np.array([np.trace(covariance_part) for covariance_part in law.sources.values()])
    # E|e|^2 = tr P + m' m
    mean_square = float(np.trace(law.covariance) + law.mean @ law.mean)
    return _MeanSquares(tuple(law.sources), by_source, mean_square)


def _is_scaled(scenario: Scenario, source: str) -> bool:
    return scale_source(scenario, source, 2.0) != scenario


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
        scenario = scale_source(scenario, source, float(factor))
    prepared_case = prepare(scenario, HISTORY)
    return _mean_squares(prepared_case, covariance(prepared_case), requirement).total
