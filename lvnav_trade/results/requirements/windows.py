"""Worst error in a window of time around the event of a requirement."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.state_layout import split_metric
from lvnav_trade.quantities.units import parse
from lvnav_trade.results.evaluate import statement_metric
from lvnav_trade.results.evaluation.covariances import why_not_applicable
from lvnav_trade.results.evaluation.protection_levels import protection_series
from lvnav_trade.results.mechanics.mission_errors import magnitude_sample, mean_and_covariance
from lvnav_trade.results.mechanics.stored_states import ErrorGaussian, State, laws, states
from lvnav_trade.results.metric import event_or_phase
from lvnav_trade.results.metrics.mission import MissionError
from lvnav_trade.results.metrics.normalised import SIGMAS, NormalisedError, whitening
from lvnav_trade.results.metrics.protection import ProtectionLevel
from lvnav_trade.results.requirements.confirmation import disagreement_texts, verdicts
from lvnav_trade.results.statistics.case_results import parse_number
from lvnav_trade.results.statistics.gaussian import gaussian
from lvnav_trade.results.statistics.probability import norm_quantile
from lvnav_trade.results.statistics.select import (
    SAME_TIME,
    at_time,
    cache_result,
    ends_of,
    history_of,
    lincov_rms,
    pick,
    rows_between,
)
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
    method: str  # "runs", "LinCov" or "runs, extrapolated"


@cache_result
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
    for (name, case), (window, errors) in _all_windows(tables).items():
        if not isinstance(errors, str):
            rows.append(_window_row(tables, name, case, window, errors))
    return pd.DataFrame(rows, columns=COLUMNS)


@cache_result
def unevaluated(tables: Tables) -> pd.DataFrame:
    """Return the requirements at an event whose window cannot be evaluated, case by case, with the reason."""
    rows = []
    for (name, case), (_, errors) in _all_windows(tables).items():
        if isinstance(errors, str):
            event = event_or_phase(_requirement_named(tables, name))
            rows.append({"requirement": name, "case": tables.labels[case], "event": event, "reason": errors})
    return pd.DataFrame(rows, columns=UNEVALUATED)


@cache_result
def _all_windows(tables: Tables) -> dict[tuple[str, str], tuple[RequirementWindow, WindowErrors | str]]:
    """Return window and error (or the reason why there is none) by name of the requirement and digest of the case."""
    windows_by_case = {}
    for requirement in tables.campaign.get("requirements") or ():
        if requirement.get("during") or statement_metric(requirement).has_single_value:
            continue
        for case in tables.labels:
            window = _find_window(tables, case, requirement)
            if window is not None:
                errors = _window_errors(tables, case, requirement, window)
                windows_by_case[str(requirement["name"]), case] = window, errors
    return windows_by_case


def _requirement_named(tables: Tables, name: str) -> Mapping[str, Any]:
    requirements: dict[str, Mapping[str, Any]] = {item["name"]: item for item in tables.campaign["requirements"]}
    return requirements[name]


def _find_window(tables: Tables, case: str, requirement: Mapping[str, Any]) -> RequirementWindow | None:
    """Return the window of a requirement; None if its event does not occur."""
    event = pick(tables.events, case=case, event=event_or_phase(requirement))
    if event.empty:
        return None
    settings = requirement.get("window") or {}
    duration_before = parse(str(settings["before"]), "s") if "before" in settings else BEFORE
    duration_after = parse(str(settings["after"]), "s") if "after" in settings else AFTER
    t = float(event.t_s.iloc[0])
    start, end = ends_of(tables, case)
    return RequirementWindow(t, max(t - duration_before, start), min(t + duration_after, end))


def _window_errors(
    tables: Tables, case: str, requirement: Mapping[str, Any], window: RequirementWindow
) -> WindowErrors | str:
    """Return the error of a requirement in its window, or the reason why it is not known."""
    metric = statement_metric(requirement)
    if isinstance(metric, ProtectionLevel):
        return _protection_levels(tables, case, requirement, window)
    exclusion_reason = why_not_applicable(tables, case) or disagreement_texts(tables).get(tables.labels[case], "")
    if not metric.has_history:
        return exclusion_reason or (_AXES_UNKNOWN if isinstance(metric, NormalisedError) else _AT_EVENTS)
    if not isinstance(metric, MissionError | NormalisedError):
        errors = _history_errors(tables, case, requirement, window, exclusion_reason)
    else:
        errors = exclusion_reason or _state_errors(tables, case, metric, requirement, window)
    if not isinstance(errors, str) and np.isnan(errors.size).all():
        return "its quantile is not known there"
    return errors


def _protection_levels(
    tables: Tables, case: str, requirement: Mapping[str, Any], window: RequirementWindow
) -> WindowErrors | str:
    """Return a protection level, which is equal in all runs."""
    quantity = str(requirement["metric"]).removesuffix("_protection_level")
    rows = rows_between(protection_series(tables, case, quantity), window.first, window.last)
    if rows.empty:
        return "no protection level is known there"
    unit, factor = tables.display_units[quantity, "3d"]
    si = str(pick(tables.outputs, case=case, quantity=quantity, axis="3d").unit.iloc[0])
    return WindowErrors(
        t=rows.t_s.to_numpy(),
        size=rows.level_si.to_numpy(dtype=float) * factor,
        limit=parse_number(requirement["below"], si) * factor,
        unit=unit,
        method=COVARIANCE,
    )


def _state_errors(
    tables: Tables,
    case: str,
    metric: MissionError | NormalisedError,
    requirement: Mapping[str, Any],
    window: RequirementWindow,
) -> WindowErrors | str:
    """Return an error of the orbit or impact point, or a normalised error, at the stored states."""
    probability = float(requirement["probability"])
    window_states = []
    window_laws = []
    for state, law in zip(states(tables, case), laws(tables, case), strict=True):
        if window.first - SAME_TIME <= state.t <= window.last + SAME_TIME:
            window_states.append(state)
            window_laws.append(law)
    if not window_states:
        return _NOT_STORED
    t = np.array([state.t for state in window_states])
    at_event = int(np.argmin(np.abs(t - window.t)))
    if isinstance(metric, NormalisedError):
        size = _normalised_quantiles(window_laws, _BLOCKS[metric.quantity], probability, at_event)
        return WindowErrors(t, size, parse_number(requirement["below"], SIGMAS), SIGMAS, COVARIANCE)
    quantiles = [
        _mission_quantile(state, law, metric.name, probability)
        for state, law in zip(window_states, window_laws, strict=True)
    ]
    reason = quantiles[at_event]
    if isinstance(reason, str):
        return reason
    factor = metric.label_factor
    return WindowErrors(
        t=t,
        size=np.array([np.nan if isinstance(quantile, str) else quantile * factor for quantile in quantiles]),
        limit=parse_number(requirement["below"], metric.unit) * factor,
        unit=metric.label_unit,
        method=COVARIANCE,
    )


def _normalised_quantiles(
    error_laws: Sequence[ErrorGaussian], block: slice, probability: float, at_event: int
) -> Floats:
    """Return the quantile (n,) of a normalised error, in formal sigmas.

    It is computed at the event and at the states with the largest RMS; it is NaN at the others, and where the formal
    covariance is singular.

    block : components of the error in the joint covariance
    at_event : index of the state at the event
    """
    moments_by_state = {}
    mean_square = np.full(len(error_laws), -1.0)
    for k, law in enumerate(error_laws):
        whitener = whitening(law.formal[block, block])
        if whitener is not None:
            mean = whitener @ law.mean[block]
            covariance = whitener @ law.true[block, block] @ whitener.T
            moments_by_state[k] = mean, covariance
            mean_square[k] = float(np.sum(np.square(mean)) + np.trace(covariance))
    quantiles = np.full(len(error_laws), np.nan)
    for k in {at_event, *np.argsort(-mean_square)[:_LARGEST].tolist()}:
        if k in moments_by_state:
            mean, covariance = moments_by_state[k]
            quantiles[k] = norm_quantile(mean, covariance, probability)
    return quantiles


def _mission_quantile(state: State, law: ErrorGaussian, metric: str, probability: float) -> float | str:
    """Return the quantile (SI) of a mission metric by linear covariance, or the reason why there is none."""
    gaussian_or_reason = mean_and_covariance(state, law, metric)
    if not isinstance(gaussian_or_reason, str):
        mean, covariance = gaussian_or_reason
        return norm_quantile(mean, covariance, probability)
    sample = magnitude_sample(state, law, metric)
    if sample is None:
        return gaussian_or_reason
    return float(np.quantile(sample, probability))


def _history_errors(
    tables: Tables, case: str, requirement: Mapping[str, Any], window: RequirementWindow, exclusion_reason: str
) -> WindowErrors | str:
    """Return an error with a stored history; `exclusion_reason`: reason why linear covariance does not count."""
    quantity, axis = split_metric(str(requirement["metric"]))
    probability = float(requirement["probability"])
    rows = rows_between(history_of(tables, case, quantity, axis), window.first, window.last)
    if rows.empty:
        return "the error is not reported"
    runs = int(rows.run_count.max())
    has_enough_runs = runs * (1.0 - probability) >= 1.0  # on average at least one beyond the quantile
    if has_enough_runs and (exclusion_reason or _has_run_verdict(tables, case, requirement)):
        method = RUNS
    else:
        method = EXTRAPOLATED if exclusion_reason else COVARIANCE
    if not runs and method != COVARIANCE:
        return exclusion_reason
    if method == COVARIANCE:
        size = _covariance_quantiles(tables, case, (quantity, axis), probability, window.t, rows)
    else:
        size = quantiles_of_runs(rows, axis, probability)
    unit, factor = tables.display_units[quantity, axis]
    si = str(pick(tables.outputs, case=case, quantity=quantity, axis=axis).unit.iloc[0])
    return WindowErrors(
        t=rows.t_s.to_numpy(),
        size=size * factor,
        limit=parse_number(requirement["below"], si) * factor,
        unit=unit,
        method=method,
    )


def _has_run_verdict(tables: Tables, case: str, requirement: Mapping[str, Any]) -> bool:
    """Whether the verdict on a requirement in a case is by runs."""
    rows = pick(verdicts(tables), requirement=requirement["name"], case=tables.labels[case])
    return bool((rows.by == RUNS).all())


def _window_row(
    tables: Tables, name: str, case: str, window: RequirementWindow, errors: WindowErrors
) -> dict[str, Any]:
    """Return the row of `windows` for a requirement and case."""
    requirement = _requirement_named(tables, name)
    at_event = int(np.argmin(np.abs(errors.t - window.t)))
    worst = int(np.nanargmax(errors.size))
    return {
        "requirement": name,
        "case": tables.labels[case],
        "event": event_or_phase(requirement),
        "t_s": window.t,
        "first_s": window.first,
        "last_s": window.last,
        "estimate": float(errors.size[at_event]),
        "worst": float(errors.size[worst]),
        "worst_s": float(errors.t[worst]),
        "limit": errors.limit,
        "unit": errors.unit,
        "probability": float(requirement["probability"]),
        "by": errors.method,
        "verdict_changes": bool(errors.size[at_event] < errors.limit <= errors.size[worst]),
    }


def quantiles_of_runs(rows: pd.DataFrame, axis: str, probability: float) -> Floats:
    """Return the quantile (n_time,) of |error| of the runs, SI, from the quantiles stored in the history.

    The stored quantiles are interpolated, and beyond the last extrapolated, linearly in the quantile of the norm of
    three standard normal components ("3d") or of one component.
    """
    freedom = 3 if axis == "3d" else 1
    normal_quantiles = np.sqrt(stats.chi2.ppf([*_STORED, probability], freedom))
    stored_places = normal_quantiles[:-1]
    place = normal_quantiles[-1]
    insertion = np.searchsorted(stored_places, place)
    upper = int(np.clip(insertion, 1, len(_STORED) - 1))
    stored_quantiles = [rows[name].to_numpy(dtype=float) for name in _STORED.values()]
    low = stored_quantiles[upper - 1]
    high = stored_quantiles[upper]
    low_place = stored_places[upper - 1]
    high_place = stored_places[upper]
    weight = (place - low_place) / (high_place - low_place)
    with np.errstate(invalid="ignore"):  # infinite where runs failed
        quantile = low + weight * (high - low)
    quantile_with_failures = np.where(weight > 0.0, np.inf, low)
    return np.where(np.isinf(high), quantile_with_failures, quantile)


def _covariance_quantiles(
    tables: Tables, case: str, metric: tuple[str, str], probability: float, t_event: float, rows: pd.DataFrame
) -> Floats:
    """Return the quantile (n_time,) by linear covariance, SI, at the event and at the times of the largest RMS.

    It is NaN at all other times.
    """
    t = rows.t_s.to_numpy()
    rms = lincov_rms(rows).to_numpy()
    at_event = int(np.argmin(np.abs(t - t_event)))
    quantiles = np.full(len(rows), np.nan)
    for k in {at_event, *np.argsort(-rms)[:_LARGEST].tolist()}:
        mean, covariance = _error_law(tables, case, metric, float(t[k]))
        mean_square = mean @ mean + np.trace(covariance)
        rms_of_law = float(np.sqrt(mean_square))
        scale = rms[k] / rms_of_law if rms_of_law > 0.0 else 0.0
        quantiles[k] = norm_quantile(mean, covariance, probability) * scale
    return quantiles


def _error_law(tables: Tables, case: str, metric: tuple[str, str], t: float) -> tuple[Floats, Floats]:
    """Return mean (k,) and covariance (k, k) of an error at a time.

    For velocity and position they are those of the nearest stored joint covariance, whose magnitude may differ; the
    caller scales the quantile. Components of attitude are assumed uncorrelated between events.
    """
    quantity, axis = metric
    for event in pick(tables.events, case=case).itertuples():
        if abs(event.t_s - t) < SAME_TIME:
            law = gaussian(tables, case, event.event, quantity, axis)
            if law is not None:
                return law.mean, law.covariance
    if axis == "3d" and quantity in _BLOCKS:
        joint_laws = laws(tables, case)
        if joint_laws:
            distance = [abs(state.t - t) for state in states(tables, case)]
            nearest = int(np.argmin(distance))
            block = _BLOCKS[quantity]
            law_at_state = joint_laws[nearest]
            return law_at_state.mean[block], law_at_state.true[block, block]
    axes = [axis]
    if axis == "3d":
        axes = [component for name, component in tables.display_units if name == quantity and component != "3d"]
    rows = [at_time(history_of(tables, case, quantity, component), t) for component in axes]
    mean = np.array([row.lincov_mean_si for row in rows])
    covariance = np.diag([row.lincov_true_si**2 for row in rows])
    return mean, covariance
