"""Evaluation of designs by linear covariance, one row each: errors at the last event, requirements, cost."""

from __future__ import annotations

import json
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.interrupts import raise_if_interrupted
from lvnav_trade.campaign.running.case_arrays import CaseArrays
from lvnav_trade.campaign.space.numbered_designs import (
    Design,
    DesignAxes,
    DesignBatch,
    make_designs,
    number_of,
    reason_of,
)
from lvnav_trade.campaign.space.passes import HISTORY as HISTORY
from lvnav_trade.campaign.space.passes import CovariancePasses, group_passes
from lvnav_trade.covariance.shared_pass import covariance_of
from lvnav_trade.quantities.records import CovHistory, Floats, Ints
from lvnav_trade.results.evaluation.covariances import NOT_APPLICABLE, why_outside
from lvnav_trade.results.evaluation.designs import AXIS, at_event, requirement_columns, slug
from lvnav_trade.results.evaluation.resources import device_totals
from lvnav_trade.results.metric import NAVIGATION_UNITS
from lvnav_trade.results.requirements.improvements import ABOVE_ONLY, evaluate_requirement
from lvnav_trade.results.requirements.margins import ORDER
from lvnav_trade.results.statistics.case_results import Gaussian
from lvnav_trade.results.tables.dictionary import unit_suffix
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare

TEXTS = ("case", "label", "axes", "reason", "limiting_requirement", "verdict", "verdicts")
_LITRE = 1e-3


class EvaluationRequest(NamedTuple):
    """Data to evaluate for every design.

    requirements : The requirements, as in the campaign.
    history_step : Step (s) of the history; coarse if only events matter.
    sigma_axes : Indices of the axes that change true sigmas alone, so that designs differing in them share covariance
        passes.
    has_event_errors : Whether a row has the errors at every event of the flight.
    """

    requirements: tuple[dict[str, Any], ...]
    history_step: float
    sigma_axes: tuple[int, ...] = ()
    has_event_errors: bool = False


class EvaluatedDesigns(NamedTuple):
    """Evaluated designs.

    design_number : (n,). Number of each design.
    texts : Columns of text, by the names of `TEXTS`.
    number_columns : Columns of numbers, (n,) each, SI.
    passes : Number of covariance passes that were computed.
    covariance_s : CPU time (s) of these passes.
    seconds : Total CPU time (s).
    """

    design_number: Ints
    texts: Mapping[str, tuple[str, ...]]
    number_columns: Mapping[str, Floats]
    passes: int
    covariance_s: float
    seconds: float


def evaluate(request: EvaluationRequest, batch: DesignBatch) -> EvaluatedDesigns:
    """Evaluate the designs of a batch.

    Designs that differ only in the axes `sigma_axes` are evaluated from common covariance passes if there are enough of
    them. The row of an impossible design has a reason and no numbers.

    Parameters
    ----------
    request : EvaluationRequest
        Data to evaluate.
    batch : DesignBatch
        The designs.
    """
    start_time = time.process_time()
    passes = CovariancePasses()
    groups: dict[tuple[str, ...], list[Design]] = defaultdict(list)
    rows: dict[int, dict[str, Any]] = {}
    for design in make_designs(batch):
        if design.case is None:
            rows[design.number] = _row(design, batch.axes) | {"reason": design.reason}
        else:
            common_levels = _other_levels(design, request.sigma_axes)
            groups[common_levels].append(design)
    for designs in groups.values():
        for design, metrics in _group_metrics(request, batch, designs, passes):
            rows[design.number] = _row(design, batch.axes) | metrics
    in_order = [rows[number] for number in batch.numbers]
    seconds = time.process_time() - start_time
    return _columns(in_order, batch.numbers, passes, seconds)


def _other_levels(design: Design, sigma_axes: Sequence[int]) -> tuple[str, ...]:
    """Return the levels that are common to the designs of a group."""
    return tuple(level for k, level in enumerate(design.levels.values()) if k not in sigma_axes)


def _columns(
    rows: Sequence[Mapping[str, Any]], numbers: Sequence[int], passes: CovariancePasses, seconds: float
) -> EvaluatedDesigns:
    """Return the rows of a part as columns.

    Parameters
    ----------
    rows : sequence of mapping
        Texts and numbers of each design.
    numbers : sequence of int
        Number of each design.
    passes : CovariancePasses
        Count of the covariance passes of the part.
    seconds : float
        Computing time of the part (s).

    Returns
    -------
    EvaluatedDesigns
        A number that a row does not have is NaN.
    """
    texts = {name: tuple(str(row.get(name, "")) for row in rows) for name in TEXTS}
    number_names: dict[str, None] = {}  # in the order in which they appear
    for row in rows:
        for name, value in row.items():
            if not isinstance(value, str):
                number_names[name] = None
    return EvaluatedDesigns(
        design_number=np.array(numbers, dtype=np.int64),
        texts=texts,
        number_columns={name: np.array([row.get(name, np.nan) for row in rows], dtype=float) for name in number_names},
        passes=passes.count,
        covariance_s=passes.seconds,
        seconds=seconds,
    )


# --- a row ------------------------------------------------------------------------------------------------------------


def _row(design: Design, axes: DesignAxes) -> dict[str, Any]:
    """Return the part of a row that needs no evaluation: levels of the axes, numbers in SI, cost."""
    case = design.case
    row: dict[str, Any] = {
        "case": "" if case is None else case.id,
        "label": ", ".join(f"{name}={level}" for name, level in design.levels.items()),
        "axes": json.dumps(design.levels),
    }
    for name, value in zip(axes.names, design.values, strict=True):
        quantity = number_of(value)
        if quantity is not None:
            number, unit = quantity
            row[f"{AXIS}{slug(name)}_{unit_suffix(unit)}"] = number
    if case is not None:
        row |= _totals(case)
    return row


_cached_totals: dict[tuple[int, ...], tuple[Any, dict[str, float]]] = {}
_MOST_TOTALS = 200  # cached sets of devices


def _totals(case: Case) -> dict[str, float]:
    """Return cost, mass, power and volume of the devices of a case, as far as they are given."""
    scenario = case.scenario
    devices = (scenario.imu, scenario.receiver, *scenario.sensors.values())
    key = tuple(map(id, devices))
    if key not in _cached_totals:
        if len(_cached_totals) > _MOST_TOTALS:
            _cached_totals.clear()
        # a reference to the devices is stored, so that no new object gets their identity
        _cached_totals[key] = devices, _total_columns(scenario)
    return _cached_totals[key][1]


def _total_columns(scenario: Scenario) -> dict[str, float]:
    """Return the columns of the totals of a scenario's devices; a total that is not given (NaN) has no column."""
    settings = {
        "imu": scenario.imu.model_dump(mode="json"),
        "receiver": scenario.receiver.model_dump(mode="json"),
        "sensors": {name: card.model_dump(mode="json") for name, card in scenario.sensors.items() if card is not None},
    }
    totals = device_totals(settings)
    if not totals:
        return {}
    columns = {name: totals[name] for name in ("cost", "mass_kg", "power_w") if not np.isnan(totals[name])}
    if not np.isnan(totals["volume_l"]):
        columns["volume_m3"] = _LITRE * totals["volume_l"]
    return columns


def metrics_of(request: EvaluationRequest, prepared_case: PreparedCase, history: CovHistory) -> dict[str, Any]:
    """Return the numbers and texts of a row from the linear covariance of a case.

    Parameters
    ----------
    request : EvaluationRequest
        Data to evaluate.
    prepared_case : PreparedCase
        The prepared case.
    history : CovHistory
        Its linear covariance.
    """
    results = CaseArrays(prepared_case, history)
    row = _navigation(prepared_case, results)
    validity_remark = why_outside(
        prepared_case.options.rules is not None, results.largest_tilt(), history.t_epoch, history.false_rejection
    )
    ratios: dict[str, float] = {}
    verdicts: dict[str, str] = {}
    reasons = [validity_remark]
    for requirement in request.requirements:
        name = requirement["name"]
        error_column, probability_column, _ = requirement_columns(requirement)
        law = evaluate_requirement(results, requirement)
        if isinstance(law, str):
            verdicts[name] = NOT_APPLICABLE
            ratios[name] = np.nan
            reasons.append(f"{name}: {law}")
            continue
        error = law.quantile(law.probability)
        probability = law.success_probability()
        row |= {error_column: error, probability_column: probability}
        ratios[name] = error / law.bound
        verdict = "met" if probability >= law.probability else "violated"
        # the probability at the worst time of a phase is an upper limit, which cannot show that the requirement is met
        is_bound = verdict == "met" and law.distribution.is_upper_limit
        verdicts[name] = NOT_APPLICABLE if validity_remark or is_bound else verdict
        if is_bound and not validity_remark:
            reasons.append(f"{name}: {ABOVE_ONLY}")
    if request.has_event_errors:
        row |= _event_errors(results, request.requirements)
    return row | _combined_verdict(ratios, verdicts) | {"reason": "; ".join(filter(None, reasons))}


def _event_errors(results: CaseArrays, requirements: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the navigation errors at every event, and the error of each requirement at an event, evaluated there."""
    at_any_event = [requirement for requirement in requirements if requirement.get("at")]
    row: dict[str, float] = {}
    for event in results.events():
        for quantity, unit in NAVIGATION_UNITS.items():
            law = results.gaussian(event, quantity, "3d")
            if law is not None:
                column = at_event(f"{quantity}_{unit_suffix(unit)}", event)
                row[column] = _rms(law)
        for requirement in at_any_event:
            error = evaluate_requirement(results, {**requirement, "at": event})
            if not isinstance(error, str):
                error_column, _, _ = requirement_columns(requirement)
                column = at_event(error_column, event)
                row[column] = error.quantile(error.probability)
    return row


def _rms(law: Gaussian) -> float:
    """Return the RMS of an error, sqrt(tr P + m' m)."""
    mean_square = np.trace(law.covariance) + law.mean @ law.mean
    return float(np.sqrt(mean_square))


def _combined_verdict(ratios: Mapping[str, float], verdicts: Mapping[str, str]) -> dict[str, Any]:
    """Return the columns on all requirements together: the limiting requirement and the worst verdict."""
    if not verdicts:
        return {}
    limiting = ""
    error_ratio = np.nan
    if not any(np.isnan(ratio) for ratio in ratios.values()):
        limiting = max(ratios, key=lambda name: ratios[name])
        error_ratio = ratios[limiting]
    return {
        "error_ratio": error_ratio,
        "limiting_requirement": limiting,
        "verdict": min(verdicts.values(), key=ORDER.index),
        "verdicts": json.dumps(verdicts),
    }


def _navigation(prepared_case: PreparedCase, results: CaseArrays) -> dict[str, Any]:
    """Return the errors at injection (or the last event)."""
    events = results.events()
    history = results.covariance
    event = "injection" if "injection" in events else next(reversed(events), "")
    row: dict[str, Any] = {}
    for quantity, unit in NAVIGATION_UNITS.items():
        law = results.gaussian(event, quantity, "3d")
        formal = results.formal(event, quantity)
        if law is None or formal is None:
            continue
        suffix = unit_suffix(unit)
        row[f"{quantity}_{suffix}"] = _rms(law)
        formal_square = np.trace(formal)
        row[f"{quantity}_formal_{suffix}"] = float(np.sqrt(formal_square))
    if event:
        hist = int(np.argmin(np.abs(history.t - events[event])))
        nees = float(history.expected_nees[hist])
        row["nees_per_state_ratio"] = nees / prepared_case.layout.n_estimated
    return row


# --- passes -----------------------------------------------------------------------------------------------------------


def _group_metrics(
    request: EvaluationRequest, batch: DesignBatch, designs: Sequence[Design], passes: CovariancePasses
) -> Iterator[tuple[Design, dict[str, Any]]]:
    """Yield designs of a group with the metrics of each, or the reason why it has none.

    Parameters
    ----------
    request : EvaluationRequest
        Data to evaluate.
    batch : DesignBatch
        Batch that contains the group.
    designs : sequence of Design
        Designs that differ only in the axes `sigma_axes` of the request.
    passes : CovariancePasses
        Computes and counts the covariance passes.
    """
    group = group_passes(batch, designs, request.sigma_axes, request.history_step, passes)
    for design in designs:
        if group is None:
            yield design, _single_metrics(request, design, passes)
        else:
            history = covariance_of(group.passes, group.sigmas(design))
            yield design, metrics_of(request, group.prepared_case, history)


def _single_metrics(request: EvaluationRequest, design: Design, passes: CovariancePasses) -> dict[str, Any]:
    """Return the metrics of a design from its own covariance pass, or the reason why it has none."""
    assert design.case is not None
    try:
        prepared_case = prepare(design.case.scenario, request.history_step)
        return metrics_of(request, prepared_case, passes(prepared_case))
    except Exception as error:
        raise_if_interrupted(error)
        if isinstance(error, OSError):
            raise
        return {"reason": reason_of(error), "case": ""}
