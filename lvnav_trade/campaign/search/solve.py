"""Inverse problems: the largest value of a field with which a case meets its requirements."""

import math
import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, get_args

import numpy as np
import pandas as pd

from lvnav_trade.campaign.definition.axes import Case, cases, get
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.definition.searches import Solve, Total, Vary
from lvnav_trade.campaign.reading.spaced import AxisEnds, parse_ends
from lvnav_trade.campaign.running.pool import map_items
from lvnav_trade.campaign.search.crossings import PermittedValues, search
from lvnav_trade.campaign.search.point import (
    FROZEN,
    RETUNED,
    CovarianceVerdict,
    check_names,
    combined_remark,
    confirm,
    evaluate_requirements,
    frozen_filter,
    number_at,
    with_filter,
    with_values,
)
from lvnav_trade.quantities.errors import InputError, quoted
from lvnav_trade.quantities.records import Floats
from lvnav_trade.scenario.scenario import Scenario

ANSWERS = [
    "case",
    "tuning",
    "along",
    "along_unit",
    "answer",
    "unit",
    "limiting_requirement",
    "monotone",
    "base_value",
    "evaluations",
    "remark",
]
INTERVALS = ["case", "tuning", "along", "along_unit", "least", "largest", "unit"]
SCANNED = [
    "case",
    "tuning",
    "along",
    "along_unit",
    "value",
    "unit",
    "requirement",
    "estimate",
    "limit",
    "metric_unit",
    "ratio",
    "probability",
]
CONFIRMED = ["case", "tuning", "value", "unit", "requirement", "runs", "beyond", "expected", "verdict", "agree"]


class InverseSolution(NamedTuple):
    """Solution of an inverse problem."""

    answers: pd.DataFrame  # largest values, columns `ANSWERS`
    intervals: pd.DataFrame  # intervals in which the requirements are met, columns `INTERVALS`
    scanned: pd.DataFrame  # all evaluations, columns `SCANNED`
    confirmed: pd.DataFrame  # confirmation by runs, columns `CONFIRMED`
    names: tuple[str, ...]  # paths of the varied fields
    units: tuple[str, ...]  # their units
    seconds: float  # wall time, s


def solve(campaign: Campaign, problem: Solve, jobs: int = 1) -> InverseSolution:
    """Solve an inverse problem for every case of a campaign, by linear covariance.

    Each problem is solved with the filter re-tuned to every value, and with its models frozen at those of the case. If
    the campaign has Monte Carlo, runs on both sides of each solution confirm it.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    problem : Solve
        Definition of the problem.
    jobs : int
        Worker processes.

    Returns
    -------
    InverseSolution
        Tables of the solutions.

    Raises
    ------
    InputError
        A requirement or field is unknown, or no value of a field is possible.
    """
    start = time.monotonic()
    check_names(campaign, problem.meet)
    all_cases = cases(campaign)
    variations = tuple(_whole_numbers(vary, all_cases[0]) for vary in problem.vary)
    problem = problem.model_copy(update={"vary": variations})
    spans = [span(vary) for vary in variations]
    tunings = [RETUNED] if problem.vary[0].path.startswith("filter.") else [RETUNED, FROZEN]
    second_values: list[str | None] = [None]
    if len(spans) > 1:
        second_ends, second_grid = spans[1]
        second_values = [second_ends.text(float(value)) for value in second_grid]
    items = [
        (campaign, problem, case, tuning, second)
        for case in all_cases
        for tuning in tunings
        for second in second_values
    ]
    answer_rows, interval_rows, scanned_rows = [], [], []
    for answer_row, intervals, case_scan_rows in map_items(jobs, _solve_case, items, is_ordered=True):
        answer_rows.append(answer_row)
        interval_rows += intervals
        scanned_rows += case_scan_rows
    answers = pd.DataFrame(answer_rows, columns=ANSWERS)
    confirmation_rows: list[tuple[Any, ...]] = []
    for rows in map_items(jobs, _confirm, _confirmation_items(campaign, problem, all_cases, answers), is_ordered=True):
        confirmation_rows += rows
    return InverseSolution(
        answers=answers,
        intervals=pd.DataFrame(interval_rows, columns=INTERVALS),
        scanned=pd.DataFrame(scanned_rows, columns=SCANNED),
        confirmed=pd.DataFrame(confirmation_rows, columns=CONFIRMED),
        names=tuple(vary.path for vary in problem.vary),
        units=tuple(ends.unit for ends, _ in spans),
        seconds=time.monotonic() - start,
    )


def _confirmation_items(
    campaign: Campaign, problem: Solve, all_cases: Sequence[Case], answers: pd.DataFrame
) -> list[tuple[Any, ...]]:
    """Return the arguments of `_confirm` for every solution that a requirement limits, if runs confirm solutions."""
    runs = campaign.monte_carlo.runs if campaign.monte_carlo else 0
    if not runs or len(problem.vary) > 1:
        return []
    items = []
    for answer in answers.itertuples():
        if not np.isfinite(answer.answer) or not answer.limiting_requirement:
            continue
        for case in all_cases:
            if case.label == answer.case:
                values = _sides(answer.answer, problem)
                items += [(campaign, problem, case, answer.tuning, value, runs) for value in values]
    return items


def _whole_numbers(vary: Vary, case: Case) -> Vary:
    """Return the variation of an integer field as a list of whole numbers; any other variation unchanged."""
    steps = vary.path.removeprefix("base.").split(".")
    value = get(case.scenario.model_dump(mode="json"), steps)
    is_integer = isinstance(value, int) and not isinstance(value, bool)
    if vary.between is None or not is_integer:
        return vary
    ends, _ = span(vary)
    n_number = int(abs(ends.last - ends.first)) + 1
    spaced_numbers = np.linspace(ends.first, ends.last, min(n_number, 100))
    numbers = np.unique(np.round(spaced_numbers)).astype(int)
    return Vary(path=vary.path, values=tuple(numbers.tolist()))


def span(vary: Vary) -> tuple[AxisEnds, Floats]:
    """Return the ends and the grid values (n,) of a variation; InputError unless all have the same unit."""
    try:
        if vary.values is not None:
            pairs = [parse_ends((vary.values[0], value)) for value in vary.values[1:]]
            values = [pairs[0].first]
            values += [pair.last for pair in pairs]
            return pairs[0], np.array(values)
        ends = parse_ends(vary.between or ())
        fraction = np.linspace(0.0, 1.0, vary.points)
        if not vary.log:
            length = ends.last - ends.first
            return ends, ends.first + fraction * length
        if ends.first <= 0.0:
            raise ValueError("a logarithm needs ends above zero")
        ratio = ends.last / ends.first
        return ends, np.asarray(ends.first * ratio**fraction)
    except ValueError as error:
        raise InputError(f"solve.vary: {vary.path}: {error}") from None


def _sides(answer: float, problem: Solve) -> tuple[float, ...]:
    """Return values just below and above a solution, at which runs confirm it; empty for a list of values."""
    if problem.vary[0].values is not None:
        return ()
    factor = 1.0 + problem.margin
    return answer / factor, answer * factor


def _scenario(problem: Solve, case: Case, tuning: str, second: Any, value: float) -> Scenario:
    """Return the scenario of a case with values of the varied fields, and the filter of a tuning.

    Parameters
    ----------
    problem : Solve
        Settings of the search.
    case : Case
        The case.
    tuning : str
        Re-tuned or frozen filter.
    second : Any
        Value of the second varied field as written in a campaign; None without such a field.
    value : float
        Value of the first varied field, in the unit of its limits.
    """
    ends, _ = span(problem.vary[0])
    values = {problem.vary[0].path: ends.text(value)}
    if second is not None:
        values[problem.vary[1].path] = second
    scenario = with_values(case.scenario, values)
    varies_filter = any(vary.path.startswith("filter.") for vary in problem.vary)
    if tuning == FROZEN and not varies_filter:
        return with_filter(scenario, frozen_filter(case.scenario))
    return scenario


def _solve_case(
    campaign: Campaign, problem: Solve, case: Case, tuning: str, second: Any
) -> tuple[tuple[Any, ...], list[Any], list[Any]]:
    """Search the permitted values of a field for a case, a filter and a value of the second field.

    Parameters
    ----------
    campaign : Campaign
        Campaign with the requirements.
    problem : Solve
        Settings of the search.
    case : Case
        The case.
    tuning : str
        Re-tuned or frozen filter.
    second : Any
        Value of the second varied field as written in a campaign; None without such a field.

    Returns
    -------
    tuple, list, list
        Row of `ANSWERS`; rows of `INTERVALS`; rows of `SCANNED`.
    """
    vary = problem.vary[0]
    ends, grid = span(vary)
    verdicts_by_value: dict[float, dict[str, CovarianceVerdict]] = {}
    error_messages: list[str] = []

    def ratio(value: float) -> dict[str, float]:
        try:
            scenario = _scenario(problem, case, tuning, second, value)
            verdicts_by_value[value] = evaluate_requirements(campaign, scenario, problem.meet)
        except (InputError, ValueError) as error:
            error_messages.append(str(error).splitlines()[0])
            return {"": math.nan}
        return {name: verdict.ratio for name, verdict in verdicts_by_value[value].items()}

    solution = search(ratio, grid, vary.log, refine=vary.values is None)
    if not verdicts_by_value:
        raise InputError(f"solve: no value of {vary.path} is possible: {error_messages[0]}")
    second_number, second_unit = math.nan, ""
    if second is not None:
        second_number = float(str(second).partition(" ")[0])
        second_unit = span(problem.vary[1])[0].unit
    keys = (case.label, tuning, second_number, second_unit)
    answer_row = (
        *keys,
        solution.answer,
        ends.unit,
        solution.limiting_requirement,
        solution.monotone,
        number_at(case.scenario, vary.path, ends.unit),
        len(verdicts_by_value),
        _remark(solution, verdicts_by_value, error_messages),
    )
    interval_rows = [(*keys, smallest, largest, ends.unit) for smallest, largest in solution.intervals]
    return answer_row, interval_rows, _scanned_rows(keys, ends.unit, verdicts_by_value)


def _scanned_rows(
    keys: tuple[Any, ...], unit: str, verdicts_by_value: Mapping[float, Mapping[str, CovarianceVerdict]]
) -> list[tuple[Any, ...]]:
    """Return the rows of `SCANNED`, in the order of the values; `keys`: case, tuning and value of the second field."""
    rows = []
    for value in sorted(verdicts_by_value):
        for name, verdict in verdicts_by_value[value].items():
            row = (
                *keys,
                value,
                unit,
                name,
                verdict.estimate,
                verdict.limit,
                verdict.unit,
                verdict.ratio,
                verdict.probability,
            )
            rows.append(row)
    return rows


def _remark(
    solution: PermittedValues,
    verdicts_by_value: Mapping[float, Mapping[str, CovarianceVerdict]],
    error_messages: Sequence[str],
) -> str:
    """Return the remark on a solution: requirements and values without numbers, limits that were not reached."""
    first_verdicts = next(iter(verdicts_by_value.values()))
    not_available = [
        f"{name}: {verdict.missing_reason}" for name, verdict in first_verdicts.items() if verdict.missing_reason
    ]
    texts = []
    if not solution.intervals and not not_available:
        texts.append("met by no value")
    elif solution.intervals and not solution.limiting_requirement:
        texts.append("met up to the largest value")
    texts += not_available
    texts += error_messages[:1]
    all_verdicts = [verdict for verdicts in verdicts_by_value.values() for verdict in verdicts.values()]
    texts.append(combined_remark(verdict.validity_remark for verdict in all_verdicts))
    return "; ".join(filter(None, texts))


def _confirm(
    campaign: Campaign, problem: Solve, case: Case, tuning: str, value: float, runs: int
) -> list[tuple[Any, ...]]:
    """Confirm a solution by Monte Carlo runs at a value close to it.

    Parameters
    ----------
    campaign : Campaign
        Campaign with the requirements.
    problem : Solve
        Settings of the search.
    case : Case
        The case.
    tuning : str
        Re-tuned or frozen filter.
    value : float
        Value of the varied field, in the unit of its limits.
    runs : int
        Number of runs.

    Returns
    -------
    list of tuple
        Rows of `CONFIRMED`.
    """
    ends, _ = span(problem.vary[0])
    rows = confirm(campaign, _scenario(problem, case, tuning, None, value), problem.meet, runs)
    return [(case.label, tuning, value, ends.unit, *row) for row in rows]


def parse_problem(range_texts: Sequence[str], log: bool, meet: Sequence[str], total: str = "") -> Solve:
    """Return the inverse problem given on the command line.

    Parameters
    ----------
    range_texts : sequence of str
        One or two fields with their ranges, such as ``initial.heading=0.01 deg:2 deg``.
    log : bool
        Search in the logarithm.
    meet : sequence of str
        Names of the requirements; all if empty.
    total : str
        Total to minimise, in place of fields to vary.

    Returns
    -------
    Solve
        The problem.

    Raises
    ------
    InputError
        A text is not valid, or the arguments do not fit together.
    """
    ranges = []
    for text in range_texts:
        path, equals, limits = text.partition("=")
        low, colon, high = limits.partition(":")
        if not equals or not colon:
            raise InputError(
                f"--vary {quoted(text)}: should be PATH=LEAST:LARGEST, such as 'initial.heading=0.01 deg:2 deg'"
            )
        ranges.append(Vary(path=path.strip(), between=(low.strip(), high.strip()), log=log))
    if len(ranges) > 2:
        raise InputError("--vary: give one or two fields")
    if total not in ("", *get_args(Total)):
        raise InputError(f"--least {quoted(total)}: should be one of {', '.join(get_args(Total))}")
    if bool(ranges) == bool(total) or (total and log):
        raise InputError("give either --vary or --least; --log belongs to --vary")
    return Solve(vary=tuple(ranges), meet=tuple(meet), least=total or None)
