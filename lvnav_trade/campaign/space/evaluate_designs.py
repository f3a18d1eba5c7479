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
from lvnav_trade.campaign.space.numbered_designs import Design, DesignAxes, DesignBatch, made, number_of, reason_of
from lvnav_trade.campaign.space.passes import HISTORY as HISTORY
from lvnav_trade.campaign.space.passes import CovariancePasses, together_of
from lvnav_trade.covariance.shared_pass import covariance_of
from lvnav_trade.quantities.records import CovHistory, Floats, Ints
from lvnav_trade.results.evaluation.covariances import NOT_APPLICABLE, why_outside
from lvnav_trade.results.evaluation.designs import AXIS, at_event, requirement_columns, slug
from lvnav_trade.results.evaluation.resources import total_of
from lvnav_trade.results.metric import NAVIGATION_UNITS
from lvnav_trade.results.requirements.improvements import ABOVE_ONLY, asked_of
from lvnav_trade.results.requirements.margins import ORDER
from lvnav_trade.results.statistics.case_results import Gaussian
from lvnav_trade.results.tables.dictionary import unit_suffix
from lvnav_trade.simulation.preparation.prepare import Prepared, prepare

TEXTS = ("case", "label", "axes", "reason", "limiting_requirement", "verdict", "verdicts")
_LITRE = 1e-3


class EvaluationRequest(NamedTuple):
    """Data to evaluate for every design.

    requirements : The requirements, as in the campaign.
    history : Step (s) of the history; coarse if only events matter.
    shared : Indices of the axes that change true sigmas alone, so that designs differing in them share covariance
        passes.
    every_event : Whether a row has the errors at every event of the flight.
    """

    requirements: tuple[dict[str, Any], ...]
    history: float
    shared: tuple[int, ...] = ()
    every_event: bool = False


class EvaluatedDesigns(NamedTuple):
    """Evaluated designs.

    number : (n,). Number of each design.
    texts : Columns of text, by the names of `TEXTS`.
    numbers : Columns of numbers, (n,) each, SI.
    passes : Number of covariance passes that were computed.
    covariance_s : CPU time (s) of these passes.
    seconds : Total CPU time (s).
    """

    number: Ints
    texts: Mapping[str, tuple[str, ...]]
    numbers: Mapping[str, Floats]
    passes: int
    covariance_s: float
    seconds: float


def evaluate(question: EvaluationRequest, part: DesignBatch) -> EvaluatedDesigns:
    """Evaluate the designs of a part.

    Designs that differ only in the axes `shared` are evaluated from common covariance passes if there are enough of
    them. The row of an impossible design has a reason and no numbers.
    """
    begun, passes = time.process_time(), CovariancePasses()
    groups: dict[tuple[str, ...], list[Design]] = defaultdict(list)
    by_number: dict[int, dict[str, Any]] = {}
    for design in made(part):
        if design.case is None:
            by_number[design.number] = _row(design, part.axes) | {"reason": design.reason}
        else:
            groups[_others(design, question.shared)].append(design)
    for designs in groups.values():
        for design, row in _evaluated(question, part, designs, passes):
            by_number[design.number] = _row(design, part.axes) | row
    return _rows([by_number[number] for number in part.numbers], part.numbers, passes, time.process_time() - begun)


def _others(design: Design, shared: Sequence[int]) -> tuple[str, ...]:
    """Return the levels that are common to the designs of a group."""
    return tuple(level for k, level in enumerate(design.levels.values()) if k not in shared)


def _rows(
    rows: Sequence[Mapping[str, Any]], numbers: Sequence[int], passes: CovariancePasses, seconds: float
) -> EvaluatedDesigns:
    names = list(dict.fromkeys(name for row in rows for name, value in row.items() if not isinstance(value, str)))
    return EvaluatedDesigns(
        np.array(numbers, dtype=np.int64),
        {name: tuple(str(row.get(name, "")) for row in rows) for name in TEXTS},
        {name: np.array([row.get(name, np.nan) for row in rows], dtype=float) for name in names},
        passes.count,
        passes.seconds,
        seconds,
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
        number = number_of(value)
        if number is not None:
            row[f"{AXIS}{slug(name)}_{unit_suffix(number[1])}"] = number[0]
    if case is not None:
        row |= _totals(case)
    return row


_known_totals: dict[tuple[int, ...], tuple[Any, dict[str, float]]] = {}


def _totals(case: Case) -> dict[str, float]:
    """Return cost, mass, power and volume of the devices of a case, as far as they are given."""
    scenario = case.scenario
    devices = (scenario.imu, scenario.receiver, *scenario.sensors.values())
    key = tuple(map(id, devices))
    if key not in _known_totals:
        if len(_known_totals) > 200:
            _known_totals.clear()
        sensors = {name: card.model_dump(mode="json") for name, card in scenario.sensors.items() if card is not None}
        settings = {
            "imu": scenario.imu.model_dump(mode="json"),
            "receiver": scenario.receiver.model_dump(mode="json"),
            "sensors": sensors,
        }
        totals = total_of(settings)
        known = {
            name: totals[name] for name in ("cost", "mass_kg", "power_w") if totals and totals[name] == totals[name]
        }
        if totals and totals["volume_l"] == totals["volume_l"]:
            known["volume_m3"] = _LITRE * totals["volume_l"]
        _known_totals[key] = devices, known  # a reference to the devices, so that no new object gets their identity
    return _known_totals[key][1]


def metrics_of(question: EvaluationRequest, prepared: Prepared, history: CovHistory) -> dict[str, Any]:
    """Return the numbers and texts of a row from the linear covariance of a case."""
    results = CaseArrays(prepared, history)
    row = _navigation(prepared, results)
    outside = why_outside(
        prepared.options.rules is not None, results.largest_tilt(), history.t_epoch, history.false_rejection
    )
    ratios: dict[str, float] = {}
    words: dict[str, str] = {}
    reasons = [outside]
    for requirement in question.requirements:
        name = requirement["name"]
        error, probability, _ = requirement_columns(requirement)
        law = asked_of(results, requirement)
        if isinstance(law, str):
            words[name], ratios[name] = NOT_APPLICABLE, np.nan
            reasons.append(f"{name}: {law}")
            continue
        size, kept = law.quantile(law.probability), law.kept()
        row |= {error: size, probability: kept}
        ratios[name] = size / law.bound
        verdict = "met" if kept >= law.probability else "violated"
        # the probability at the worst time of a phase is an upper limit, which cannot show that the requirement is met
        is_bound = verdict == "met" and law.distribution.above_only
        words[name] = NOT_APPLICABLE if outside or is_bound else verdict
        if is_bound and not outside:
            reasons.append(f"{name}: {ABOVE_ONLY}")
    if question.every_event:
        row |= _at_events(results, question.requirements)
    return row | _together(ratios, words) | {"reason": "; ".join(filter(None, reasons))}


def _at_events(results: CaseArrays, requirements: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the navigation errors at every event, and the error of each requirement at an event, evaluated there."""
    row: dict[str, float] = {}
    for event in results.events():
        for quantity, unit in NAVIGATION_UNITS.items():
            law = results.gaussian(event, quantity, "3d")
            if law is not None:
                row[at_event(f"{quantity}_{unit_suffix(unit)}", event)] = _size(law)
        for requirement in requirements:
            law_there = asked_of(results, {**requirement, "at": event}) if requirement.get("at") else ""
            if not isinstance(law_there, str):
                quantile = law_there.quantile(law_there.probability)
                row[at_event(requirement_columns(requirement)[0], event)] = quantile
    return row


def _size(law: Gaussian) -> float:
    """Return the RMS of an error, sqrt(tr P + m' m)."""
    return float(np.sqrt(np.trace(law.covariance) + law.mean @ law.mean))


def _together(ratios: Mapping[str, float], words: Mapping[str, str]) -> dict[str, Any]:
    if not words:
        return {}
    known = not any(np.isnan(ratio) for ratio in ratios.values())
    limiting = max(ratios, key=lambda name: ratios[name]) if known else ""
    return {
        "error_ratio": ratios[limiting] if limiting else np.nan,
        "limiting_requirement": limiting,
        "verdict": min(words.values(), key=ORDER.index),
        "verdicts": json.dumps(words),
    }


def _navigation(prepared: Prepared, results: CaseArrays) -> dict[str, Any]:
    """Return the errors at injection (or the last event)."""
    events, history = results.events(), results.covariance
    event = "injection" if "injection" in events else next(reversed(events), "")
    row: dict[str, Any] = {}
    for quantity, unit in NAVIGATION_UNITS.items():
        law, formal = results.gaussian(event, quantity, "3d"), results.formal(event, quantity)
        if law is None or formal is None:
            continue
        end = unit_suffix(unit)
        row[f"{quantity}_{end}"] = _size(law)
        row[f"{quantity}_formal_{end}"] = float(np.sqrt(np.trace(formal)))
    if event:
        at = int(np.argmin(np.abs(history.t - events[event])))
        row["nees_per_state_ratio"] = float(history.expected_nees[at]) / prepared.layout.n_estimated
    return row


# --- passes -----------------------------------------------------------------------------------------------------------


def _evaluated(
    question: EvaluationRequest, part: DesignBatch, designs: Sequence[Design], passes: CovariancePasses
) -> Iterator[tuple[Design, dict[str, Any]]]:
    """Yield designs of a group with the metrics of each, or the reason why it has none."""
    together = together_of(part, designs, question.shared, question.history, passes)
    for design in designs:
        if together is None:
            yield design, _alone(question, design, passes)
        else:
            history = covariance_of(together.passes, together.sigmas(design))
            yield design, metrics_of(question, together.prepared, history)


def _alone(question: EvaluationRequest, design: Design, passes: CovariancePasses) -> dict[str, Any]:
    """Return the metrics of a design from its own covariance pass, or the reason why it has none."""
    assert design.case is not None
    try:
        prepared = prepare(design.case.scenario, question.history)
        return metrics_of(question, prepared, passes(prepared))
    except Exception as error:
        raise_if_interrupted(error)
        if isinstance(error, OSError):
            raise
        return {"reason": reason_of(error), "case": ""}
