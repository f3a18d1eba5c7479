"""What statements name and their campaign does not have: cases, axes, events."""

from collections.abc import Iterator, Mapping, Sequence

from lvnav_studies.cases import readings
from lvnav_studies.claims import Claims, Ordering, Statement
from lvnav_trade.api.input import (
    Campaign,
    MeasuredMetric,
    error_axes,
    hint,
    name_suggestion,
    named_cases,
    pool_faults,
    pooled_levels,
    quoted,
    reference_faults,
    unknown_axis,
    unknown_case,
)

Fault = tuple[str, str]
"""Path within the file of a campaign's statements, and message."""


def faults(claims: Claims, campaign: Campaign) -> Iterator[Fault]:
    """Yield the claims on cases and axes that the campaign does not have."""
    cases = named_cases(campaign)
    axes = error_axes(campaign)
    for key in ("references", "missions"):
        yield from _prefixed_faults(key, reference_faults(campaign, getattr(claims, key)))
    for index, order in enumerate(claims.orderings):
        yield from _prefixed_faults(f"orderings.{index}", _ordering_faults(order, cases))
    for index, claim in enumerate(claims.innovations):
        yield from _prefixed_faults(f"innovations.{index}", pool_faults(claim, claim.case, cases))
        message = unknown_case(claim.case, cases)
        if message:
            yield f"innovations.{index}.case", message
    ids = [statement.id for statement in claims.statements]
    for index, statement in enumerate(claims.statements):
        earlier_ids = ids[:index]
        if statement.id and statement.id in earlier_ids:
            yield f"statements.{index}.id", f"{quoted(statement.id)} is used twice; give another id"
        yield from _prefixed_faults(f"statements.{index}", _statement_faults(statement, cases))
    for path, measured_metric in _measured_metrics(claims):
        message = unknown_axis(measured_metric.metric, axes)
        if message:
            yield f"{path}.metric", message


def _ordering_faults(order: Ordering, cases: Sequence[Mapping[str, str]]) -> Iterator[Fault]:
    named_levels = {}
    for levels in order.cases:
        named_levels.update(levels)
    yield from pool_faults(order, named_levels, cases)
    pool = pooled_levels(order, cases)
    for number, levels in enumerate(order.cases):
        message = unknown_case(levels | pool, cases, True)
        if message:
            yield f"cases.{number}", message


def faults_in_flight(claims: Claims, events: Mapping[str, Mapping[str, float]]) -> Iterator[Fault]:
    """Yield the events that a claim names and the flight of a case does not have; events: times by case and name."""
    for path, measured_metric in _measured_metrics(claims):
        for event in measured_metric.events:
            for times in events.values():
                if event not in times:
                    event_list = ", ".join(times)
                    near = hint(event, times) or f" (it has {event_list})"
                    field = "during" if measured_metric.during else "at"
                    yield f"{path}.{field}", f"{event!r} is not an event of the trajectory{near}"


def _measured_metrics(claims: Claims) -> Iterator[tuple[str, MeasuredMetric]]:
    """Yield path and content of everything in a file that names a metric."""
    for key in ("references", "missions", "orderings"):
        for index, measured_metric in enumerate(getattr(claims, key)):
            yield f"{key}.{index}", measured_metric
    for index, statement in enumerate(claims.statements):
        for name, term in statement.terms.items():
            yield f"statements.{index}.terms.{name}", term


def _prefixed_faults(path: str, path_faults: Iterator[Fault]) -> Iterator[Fault]:
    """Yield faults with their paths below another path."""
    for end, message in path_faults:
        yield f"{path}.{end}", message


def _statement_faults(statement: Statement, cases: Sequence[Mapping[str, str]]) -> Iterator[Fault]:
    """Yield the faults of the cases of a statement: each term has one, for some choice of the axes left open."""
    axis_name = statement.along
    axes = list(cases[0]) if cases else []
    if axis_name and axis_name not in axes:
        yield "along", f"no axis {quoted(axis_name)}{name_suggestion(axis_name, axes)}"
    term_levels = {name: statement.case_of(name) for name in statement.terms}
    for name, term in statement.terms.items():
        if term.over and cases and term.over not in cases[0]:
            yield f"terms.{name}.over", f"no axis {quoted(term.over)}{name_suggestion(term.over, cases[0])}"
        elif term.over and cases:
            term_levels[name] |= {term.over: cases[0][term.over]}
        yield from _prefixed_faults(f"terms.{name}", pool_faults(term, statement.case_of(name), cases))
        term_levels[name] |= pooled_levels(term, cases)
        for key, other_levels in (("minus", term.minus), ("sigma_of", term.sigma_of)):
            if other_levels is not None:
                levels = term_levels[name] | other_levels
                message = unknown_case(levels, cases)
                if message:
                    yield f"terms.{name}.{key}", message
    messages = _unknown_cases(term_levels, cases)
    if not messages and not readings(cases, term_levels):
        messages = _unknown_cases(term_levels, cases, single=True)
        if not messages:
            first_term = next(iter(statement.terms))
            message = "the terms have no case in common for any choice of the axes left out"
            messages = {first_term: message}
    for name, message in messages.items():
        yield f"terms.{name}.case", message


def _unknown_cases(
    term_levels: Mapping[str, Mapping[str, str]], cases: Sequence[Mapping[str, str]], single: bool = False
) -> dict[str, str]:
    """Return the messages of `unknown_case` by term, without the terms that have none."""
    messages = {}
    for name, levels in term_levels.items():
        message = unknown_case(levels, cases, single)
        if message:
            messages[name] = message
    return messages
