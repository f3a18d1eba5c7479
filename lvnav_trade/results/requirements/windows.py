"""Worst error in a window of time around the event of a requirement."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.state_layout import split_metric
from lvnav_trade.quantities.units import parse
from lvnav_trade.results.evaluate import metric_in
from lvnav_trade.results.evaluation.covariances import why_not_applicable
from lvnav_trade.results.evaluation.protection_levels import series_of
from lvnav_trade.results.mechanics.mission_errors import drawn_of, expected_of
from lvnav_trade.results.mechanics.stored_states import ErrorGaussian, State, laws, states
from lvnav_trade.results.metric import where
from lvnav_trade.results.metrics.mission import MissionError
from lvnav_trade.results.metrics.normalised import SIGMAS, NormalisedError, whitening
from lvnav_trade.results.metrics.protection import ProtectionLevel
from lvnav_trade.results.requirements.confirmation import unconfirmed, verdicts
from lvnav_trade.results.statistics.case_results import number_in
from lvnav_trade.results.statistics.gaussian import gaussian
from lvnav_trade.results.statistics.probability import norm_quantile
from lvnav_trade.results.statistics.select import SAME_TIME, ends_of, history_of, once, pick, rows_between
from lvnav_trade.results.tables.read import Tables

COLUMNS = [
    "requirement",
    "case",
    "event",
    "t_s",
    "first_s",
    "last_s",
    "estimate",
    "worst",
    "worst_s",
    "limit",
    "unit",
    "probability",
    "by",
    "verdict_changes",
]
UNEVALUATED = ["requirement", "case", "event", "reason"]
BEFORE, AFTER = 5.0, 20.0  # s, default window
RUNS, COVARIANCE, EXTRAPOLATED = "runs", "LinCov", "runs, extrapolated"
# Quantiles of |error| of the runs that are stored in the history
_STORED = {0.5: "q50_si", 0.95: "q95_si", 0.997: "q997_si"}
_LARGEST = 2  # number of times with the largest RMS at which the quantile by linear covariance is computed
_BLOCKS = {"velocity": slice(0, 3), "position": slice(3, 6)}  # of the joint covariance, frame i
_NOT_STORED = "the covariance of velocity and position is not stored around it"
_AT_EVENTS = "the metric is known at events only"
_AXES_UNKNOWN = "the covariance between the axes of attitude is stored at events only"


class RequirementWindow(NamedTuple):
    """Window of a requirement in one case, s since lift-off."""

    t: float  # time of the event
    first: float  # start of the window
    last: float  # end of the window


class WindowErrors(NamedTuple):
    """Error of a requirement in its window."""

    t: Floats  # (n,) s
    size: Floats  # (n,) P-quantile of the error with the required probability P, in `unit`; NaN where not computed
    limit: float  # limit of the requirement, in `unit`
    unit: str  # display unit
    by: str  # method: runs, LinCov, or runs, extrapolated


@once
def windows(tables: Tables) -> pd.DataFrame:
    """Return the worst error around the event of each requirement at an event, case by case.

    t_s: time of the event; first_s, last_s: ends of the window within the history. estimate, worst: P-quantile of the
    error with the required probability P, at the event and its largest value in the window, in `unit`; worst_s: time of
    the latter. by: method. verdict_changes: whether the error is below the limit at the event and reaches it in the
    window.

    by "runs": the verdict is by runs, and on average at least one run is beyond the quantile. Their quantiles of 50, 95
    and 99.7 % are interpolated, and extrapolated, like those of the norm of a standard normal vector. by "LinCov":
    quantile of the Gaussian at the times of the largest RMS; normalised errors, orbital elements and impact point at
    the stored states, 5 s apart; protection levels directly. by "runs, extrapolated": there are too few runs, and
    linear covariance does not describe the case. Requirements that cannot be evaluated are in `unevaluated`.
    """
    rows = []
    for (name, case), (around, found) in _every(tables).items():
        if not isinstance(found, str):
            rows.append(_row(tables, name, case, around, found))
    return pd.DataFrame(rows, columns=COLUMNS)


@once
def unevaluated(tables: Tables) -> pd.DataFrame:
    """Return the requirements at an event whose window cannot be evaluated, case by case, with the reason."""
    rows = [
        (name, tables.labels[case], where(_stated(tables, name)), sizes)
        for (name, case), (_, sizes) in _every(tables).items()
        if isinstance(sizes, str)
    ]
    return pd.DataFrame(rows, columns=UNEVALUATED)


@once
def _every(tables: Tables) -> dict[tuple[str, str], tuple[RequirementWindow, WindowErrors | str]]:
    """Return window and error (or the reason why there is none) by name of the requirement and digest of the case."""
    found = {}
    for requirement in tables.campaign.get("requirements") or ():
        once_only = requirement.get("during") or metric_in(requirement).once_a_run
        for case in tables.labels:
            around = None if once_only else _around(tables, case, requirement)
            if around is not None:
                found[str(requirement["name"]), case] = around, _sizes(tables, case, requirement, around)
    return found


def _stated(tables: Tables, name: str) -> Mapping[str, Any]:
    requirement: Mapping[str, Any] = next(each for each in tables.campaign["requirements"] if each["name"] == name)
    return requirement


def _around(tables: Tables, case: str, requirement: Mapping[str, Any]) -> RequirementWindow | None:
    """Return the window of a requirement; None if its event does not occur."""
    event = pick(tables.events, case=case, event=where(requirement))
    if event.empty:
        return None
    stated = requirement.get("window") or {}
    before, after = (
        parse(str(stated[name]), "s") if name in stated else default
        for name, default in (("before", BEFORE), ("after", AFTER))
    )
    t, (start, end) = float(event.t_s.iloc[0]), ends_of(tables, case)
    return RequirementWindow(t, max(t - before, start), min(t + after, end))


def _sizes(tables: Tables, case: str, requirement: Mapping[str, Any], around: RequirementWindow) -> WindowErrors | str:
    """Return the error of a requirement in its window, or the reason why it is not known."""
    metric = metric_in(requirement)
    if isinstance(metric, ProtectionLevel):
        return _level(tables, case, requirement, around)
    refused = why_not_applicable(tables, case) or unconfirmed(tables).get(tables.labels[case], "")
    if not metric.has_history:
        return refused or (_AXES_UNKNOWN if isinstance(metric, NormalisedError) else _AT_EVENTS)
    if not isinstance(metric, MissionError | NormalisedError):
        found: WindowErrors | str = _error(tables, case, requirement, around, refused)
    else:
        found = refused or _of_states(tables, case, metric, requirement, around)
    known = isinstance(found, str) or bool(np.isfinite(found.size).any() or np.isinf(found.size).any())
    return found if known else "its quantile is not known there"


def _level(tables: Tables, case: str, requirement: Mapping[str, Any], around: RequirementWindow) -> WindowErrors | str:
    """Return a protection level, which is equal in all runs."""
    quantity = str(requirement["metric"]).removesuffix("_protection_level")
    rows = rows_between(series_of(tables, case, quantity), around.first, around.last)
    if rows.empty:
        return "no protection level is known there"
    unit, factor = tables.people[quantity, "3d"]
    si = str(pick(tables.outputs, case=case, quantity=quantity, axis="3d").unit.iloc[0])
    limit = number_in(requirement["below"], si) * factor
    return WindowErrors(rows.t_s.to_numpy(), rows.level_si.to_numpy(dtype=float) * factor, limit, unit, COVARIANCE)


def _of_states(
    tables: Tables,
    case: str,
    metric: MissionError | NormalisedError,
    requirement: Mapping[str, Any],
    around: RequirementWindow,
) -> WindowErrors | str:
    """Return an error of the orbit or impact point, or a normalised error, at the stored states."""
    probability = float(requirement["probability"])
    inside = [
        (state, law)
        for state, law in zip(states(tables, case), laws(tables, case), strict=True)
        if around.first - SAME_TIME <= state.t <= around.last + SAME_TIME
    ]
    if not inside:
        return _NOT_STORED
    t = np.array([state.t for state, _ in inside])
    if isinstance(metric, NormalisedError):
        part, at = _BLOCKS[metric.quantity], int(np.argmin(np.abs(t - around.t)))
        values = _normalised([law for _, law in inside], part, probability, at)
        return WindowErrors(t, values, number_in(requirement["below"], SIGMAS), SIGMAS, COVARIANCE)
    found = [_quantile_of(state, law, metric.name, probability) for state, law in inside]
    reason = found[int(np.argmin(np.abs(t - around.t)))]
    if isinstance(reason, str):
        return reason
    unit, factor = metric.label_unit, metric.label_factor
    size = np.array([np.nan if isinstance(quantile, str) else quantile * factor for quantile in found])
    return WindowErrors(t, size, number_in(requirement["below"], metric.unit) * factor, unit, COVARIANCE)


def _normalised(given: Sequence[ErrorGaussian], part: slice, probability: float, at: int) -> Floats:
    """Return the quantile (n,) of a normalised error, in formal sigmas.

    It is computed at the event (index `at`) and at the states with the largest RMS; it is NaN at the others, and where
    the formal covariance is singular. part: components of the error in the joint covariance.
    """
    found = np.full(len(given), np.nan)
    normal, size = {}, np.full(len(given), -1.0)
    for k, law in enumerate(given):
        white = whitening(law.formal[part, part])
        if white is not None:
            normal[k] = white @ law.mean[part], white @ law.true[part, part] @ white.T
            size[k] = float(np.sum(np.square(normal[k][0])) + np.trace(normal[k][1]))
    for k in {at, *np.argsort(-size)[:_LARGEST].tolist()} & normal.keys():
        found[k] = norm_quantile(*normal[k], probability)
    return found


def _quantile_of(state: State, law: ErrorGaussian, metric: str, probability: float) -> float | str:
    """Return the quantile (SI) of a mission metric by linear covariance, or the reason why there is none."""
    found = expected_of(state, law, metric)
    if not isinstance(found, str):
        return norm_quantile(*found, probability)
    drawn = drawn_of(state, law, metric)
    return found if drawn is None else float(np.quantile(drawn, probability))


def _error(
    tables: Tables, case: str, requirement: Mapping[str, Any], around: RequirementWindow, refused: str
) -> WindowErrors | str:
    """Return an error with a stored history; `refused`: reason why linear covariance does not count."""
    metric, probability = split_metric(str(requirement["metric"])), float(requirement["probability"])
    rows = rows_between(history_of(tables, case, *metric), around.first, around.last)
    if rows.empty:
        return "the error is not reported"
    runs = int(rows.run_count.max())
    by = (
        RUNS if runs and runs * (1.0 - probability) >= 1.0 and _rests_on_runs(tables, case, requirement) else COVARIANCE
    )
    if by == COVARIANCE and refused:
        by = EXTRAPOLATED if runs * (1.0 - probability) < 1.0 else RUNS
    if not runs and by != COVARIANCE:
        return refused
    unit, factor = tables.people[metric]
    si = str(pick(tables.outputs, case=case, quantity=metric[0], axis=metric[1]).unit.iloc[0])
    size = (
        _quantiles_of_covariance(tables, case, metric, probability, around.t, rows)
        if by == COVARIANCE
        else quantiles_of_runs(rows, metric[1], probability)
    )
    return WindowErrors(rows.t_s.to_numpy(), size * factor, number_in(requirement["below"], si) * factor, unit, by)


def _rests_on_runs(tables: Tables, case: str, requirement: Mapping[str, Any]) -> bool:
    """Whether the verdict on a requirement in a case is by runs."""
    frame = verdicts(tables)
    found = frame.by[(frame.requirement == requirement["name"]) & (frame.case == tables.labels[case])]
    return bool((found == RUNS).all())


def _row(tables: Tables, name: str, case: str, around: RequirementWindow, errors: WindowErrors) -> tuple[Any, ...]:
    """Return the row of `windows` for a requirement and case."""
    requirement, size = _stated(tables, name), errors.size
    at, worst = int(np.argmin(np.abs(errors.t - around.t))), int(np.nanargmax(size))
    changes = bool(size[at] < errors.limit <= size[worst])
    head = (name, tables.labels[case], where(requirement), *around)
    sizes = (float(size[at]), float(size[worst]), float(errors.t[worst]), errors.limit, errors.unit)
    return (*head, *sizes, float(requirement["probability"]), errors.by, changes)


def quantiles_of_runs(rows: pd.DataFrame, axis: str, probability: float) -> Floats:
    """Return the quantile (n_time,) of |error| of the runs, SI, from the quantiles stored in the history.

    The stored quantiles are interpolated, and beyond the last extrapolated, linearly in the quantile of the norm of
    three standard normal components ("3d") or of one component.
    """
    freedom = 3 if axis == "3d" else 1
    place = np.sqrt(stats.chi2.ppf([*_STORED, probability], freedom))
    known = np.stack([rows[name].to_numpy(dtype=float) for name in _STORED.values()])
    upper = int(np.clip(np.searchsorted(place[:-1], place[-1]), 1, len(_STORED) - 1))
    low, high = place[upper - 1], place[upper]
    weight = (place[-1] - low) / (high - low)
    with np.errstate(invalid="ignore"):  # infinite where runs failed
        found = known[upper - 1] + weight * (known[upper] - known[upper - 1])
    return np.where(np.isinf(known[upper]), np.where(weight > 0.0, np.inf, known[upper - 1]), found)


def _quantiles_of_covariance(
    tables: Tables, case: str, metric: tuple[str, str], probability: float, t_event: float, rows: pd.DataFrame
) -> Floats:
    """Return the quantile (n_time,) by linear covariance, SI, at the event and at the times of the largest RMS.

    It is NaN at all other times.
    """
    t, rms = rows.t_s.to_numpy(), np.hypot(rows.lincov_true_si, rows.lincov_mean_si).to_numpy()
    at = int(np.argmin(np.abs(t - t_event)))
    found = np.full(len(rows), np.nan)
    for k in {at, *np.argsort(-rms)[:_LARGEST].tolist()}:
        mean, covariance = _law(tables, case, metric, float(t[k]))
        size = float(np.sqrt(mean @ mean + np.trace(covariance)))
        found[k] = norm_quantile(mean, covariance, probability) * (rms[k] / size if size > 0.0 else 0.0)
    return found


def _law(tables: Tables, case: str, metric: tuple[str, str], t: float) -> tuple[Floats, Floats]:
    """Return mean (k,) and covariance (k, k) of an error at a time.

    For velocity and position they are those of the nearest stored joint covariance, whose magnitude may differ; the
    caller scales the quantile. Components of attitude are assumed uncorrelated between events.
    """
    quantity, axis = metric
    for event in pick(tables.events, case=case).itertuples():
        if abs(event.t_s - t) < SAME_TIME and (law := gaussian(tables, case, event.event, quantity, axis)) is not None:
            return law.mean, law.covariance
    if axis == "3d" and quantity in _BLOCKS and (known := laws(tables, case)):
        part = _BLOCKS[quantity]
        nearest = int(np.argmin([abs(state.t - t) for state in states(tables, case)]))
        return known[nearest].mean[part], known[nearest].true[part, part]
    axes = [name for of, name in tables.people if of == quantity and name != "3d"] if axis == "3d" else [axis]
    series = [history_of(tables, case, quantity, name) for name in axes]
    at = [rows.iloc[int(np.argmin(np.abs(rows.t_s.to_numpy() - t)))] for rows in series]
    return np.array([row.lincov_mean_si for row in at]), np.diag([row.lincov_true_si**2 for row in at])
