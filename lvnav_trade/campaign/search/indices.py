"""Global sensitivity of an error to the sigmas of its sources: frozen in closed form, re-tuned by a fit."""

import time
from typing import NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.campaign.definition.axes import Case, cases
from lvnav_trade.campaign.definition.schema import Campaign, Requirement
from lvnav_trade.campaign.definition.searches import Indices
from lvnav_trade.campaign.reading.spaced import points
from lvnav_trade.campaign.running.pool import each
from lvnav_trade.campaign.search.point import HISTORY, look, not_described
from lvnav_trade.engines.analysis.explain import flown_events, scaled
from lvnav_trade.engines.lincov.history import covariance
from lvnav_trade.engines.setup.prepare import Prepared, prepare
from lvnav_trade.errors import InputError, quoted
from lvnav_trade.metrics.basics.chaos import basis, fitted, fitted_indices, predicted
from lvnav_trade.metrics.families.errors import NORM, StateError
from lvnav_trade.metrics.registry import metric_of
from lvnav_trade.records import CovHistory, Floats
from lvnav_trade.scenario import Scenario

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


class Indexed(NamedTuple):
    """Indices of the largest sources (`COLUMNS`), the case and error that they are of, the part of the mean square
    that these sources make, how well the fit predicts left-out designs (1: exactly), designs, seconds, and a remark
    where linear covariance does not describe the case.
    """

    indices: pd.DataFrame
    case: str
    error: str
    covered: float
    predicted: float
    samples: int
    seconds: float
    remark: str = ""


def indices(campaign: Campaign, asked: Indices, jobs: int = 1) -> Indexed:
    """Return the sensitivity indices of the mean square of a requirement's error in the first case of a campaign.

    The sigma of each source is times f, log f even between -log F and log F. Frozen: the mean square is c + sum s_k
    f_k^2 (s_k by the budget), so first-order and total index are both s_k^2 / sum s_j^2. Re-tuned: linear covariance of
    `samples` designs (Sobol's points), in each of which a `matched` filter follows; the logarithm of the mean square is
    fitted by Legendre polynomials, and indices are those of the fit (`fitted_indices`), half-widths the 95 % of fits to
    `RESAMPLED` draws from the designs. local: derivative of log RMS by log sigma, gains frozen.
    """
    begun = time.monotonic()
    requirement = _requirement(campaign, asked.requirement)
    case = cases(campaign)[0]
    prepared = prepare(case.scenario, campaign.keep.history)
    history = covariance(prepared)
    at, columns = _place(prepared, history, requirement, case)
    by_source = history.budget[at][:, columns].sum(axis=1)
    total = float(by_source.sum() + np.sum(history.mean[at, columns] ** 2))
    able = [k for k in np.argsort(-by_source) if _is_scaled(case.scenario, history.sources[k])][: asked.sources]
    sources, s = [history.sources[k] for k in able], by_source[able]
    d = len(sources)
    if asked.samples < 2 * (terms := len(basis(d))):
        raise InputError(f"indices.samples: {asked.samples} are too few for {terms} polynomials; give {2 * terms}")
    u = 2.0 * points("sobol", d, 1 << (asked.samples - 1).bit_length(), campaign.seed)[: asked.samples] - 1.0
    units = [(case.scenario, sources, asked.factor**one, float(history.t[at]), columns) for one in u]
    value = np.array(list(each(jobs, mean_square, units, ordered=True)))
    rng = np.random.default_rng(campaign.seed)
    picks = [np.arange(len(u)), *rng.integers(0, len(u), (RESAMPLED, len(u)))]
    found = fitted_indices(np.array([fitted(u[pick], value[pick]) for pick in picks]), d)
    first, whole = found[:, 0]
    widths = 0.5 * np.ptp(np.quantile(found[:, 1:], (0.025, 0.975), axis=1), axis=0)
    frozen = s**2 / np.sum(s**2)
    rows = zip(sources, s / total, s / total, frozen, frozen, first, widths[0], whole, widths[1], strict=True)
    return Indexed(
        pd.DataFrame(list(rows), columns=COLUMNS),
        case.label,
        f"{requirement.metric} at {requirement.at}",
        float(s.sum() / total),
        predicted(u, value),
        asked.samples,
        time.monotonic() - begun,
        not_described(one.outside for one in look(campaign, case.scenario, [requirement.name]).values()),
    )


def _requirement(campaign: Campaign, name: str) -> Requirement:
    found = [one for one in campaign.requirements if not name or one.name == name]
    if not found or found[0].during is not None or not isinstance(metric_of(found[0].metric), StateError):
        raise InputError(
            f"indices.requirement: no requirement {quoted(name)} on an error of the navigation at an event"
        )
    return found[0]


def _place(prepared: Prepared, history: CovHistory, asked: Requirement, case: Case) -> tuple[int, list[int]]:
    """Return the history time and the columns of a requirement's error."""
    metric, events = metric_of(asked.metric), flown_events(prepared)
    columns = [
        k
        for k, one in enumerate(prepared.outputs)
        if isinstance(metric, StateError) and one.quantity == metric.quantity and metric.axis in (NORM, one.axis)
    ]
    if asked.at not in events or not columns:
        raise InputError(f"{case.label}: linear covariance does not hold {asked.metric} at {asked.at}")
    return int(np.argmin(np.abs(history.t - events[str(asked.at)]))), columns


def _is_scaled(scenario: Scenario, source: str) -> bool:
    return scaled(scenario, source, 2.0) != scenario


def mean_square(scenario: Scenario, sources: list[str], factors: Floats, t: float, columns: list[int]) -> float:
    """Return the true mean square of an error at a time, with the sigma of each source times a factor."""
    for source, factor in zip(sources, factors, strict=True):
        scenario = scaled(scenario, source, float(factor))
    history = covariance(prepare(scenario, HISTORY))
    at = int(np.argmin(np.abs(history.t - t)))
    return float(np.sum(history.true_sigma[at, columns] ** 2 + history.mean[at, columns] ** 2))
