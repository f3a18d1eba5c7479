"""What statements name and their campaign does not have: cases, axes, events."""

from collections.abc import Iterator, Mapping, Sequence

from lvnav_studies.cases import readings
from lvnav_studies.claims import Claims, Statement
from lvnav_trade.api.input import (
    Campaign,
    MeasuredMetric,
    axes_of_errors,
    hint,
    meant,
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
    """Yield what is claimed of cases and axes that the campaign does not have."""
    cases, axes = named_cases(campaign), axes_of_errors(campaign)
    for key in ("references", "flown"):
        yield from ((f"{key}.{path}", text) for path, text in reference_faults(campaign, getattr(claims, key)))
    for index, order in enumerate(claims.orderings):
        named = {axis: level for case in order.cases for axis, level in case.items()}
        yield from _below(f"orderings.{index}", pool_faults(order, named, cases))
        together = pooled_levels(order, cases)
        for place, case in enumerate(order.cases):
            if message := unknown_case(case | together, cases, True):
                yield f"orderings.{index}.cases.{place}", message
    for index, one in enumerate(claims.innovations):
        yield from _below(f"innovations.{index}", pool_faults(one, one.case, cases))
        if message := unknown_case(one.case, cases):
            yield f"innovations.{index}.case", message
    ids = [one.id for one in claims.statements]
    for index, statement in enumerate(claims.statements):
        if statement.id and statement.id in ids[:index]:
            yield f"statements.{index}.id", f"{quoted(statement.id)} is used twice; give another id"
        yield from _below(f"statements.{index}", _of_statement(statement, cases))
    for path, measured in _measured(claims):
        if message := unknown_axis(measured.metric, axes):
            yield f"{path}.metric", message


def faults_in_flight(claims: Claims, events: Mapping[str, Mapping[str, float]]) -> Iterator[Fault]:
    """Yield the events that a claim names and the flight of a case does not have; events: times by case and name."""
    for path, one in _measured(claims):
        for event in one.events:
            for times in events.values():
                if event not in times:
                    near = hint(event, times) or f" (it has {', '.join(times)})"
                    where = "during" if one.during else "at"
                    yield f"{path}.{where}", f"{event!r} is not an event of the trajectory{near}"


def _measured(claims: Claims) -> Iterator[tuple[str, MeasuredMetric]]:
    """Yield path and content of everything in a file that names a metric."""
    for key in ("references", "flown", "orderings"):
        yield from ((f"{key}.{index}", one) for index, one in enumerate(getattr(claims, key)))
    for index, statement in enumerate(claims.statements):
        yield from ((f"statements.{index}.terms.{name}", term) for name, term in statement.terms.items())


def _below(path: str, found: Iterator[Fault]) -> Iterator[Fault]:
    yield from ((f"{path}.{end}", message) for end, message in found)


def _of_statement(one: Statement, cases: Sequence[Mapping[str, str]]) -> Iterator[Fault]:
    """Yield what is wrong with the cases of a statement: each term has one, for some choice of the axes left open."""
    if one.along and (not cases or one.along not in cases[0]):
        yield "along", f"no axis {quoted(one.along)}{meant(one.along, list(cases[0]) if cases else [])}"
    wanted = {name: one.case_of(name) for name in one.terms}
    for name, term in one.terms.items():
        if term.over and cases and term.over not in cases[0]:
            yield f"terms.{name}.over", f"no axis {quoted(term.over)}{meant(term.over, cases[0])}"
        elif term.over and cases:
            wanted[name] |= {term.over: cases[0][term.over]}
        yield from _below(f"terms.{name}", pool_faults(term, one.case_of(name), cases))
        wanted[name] |= pooled_levels(term, cases)
        for key, other in (("minus", term.minus), ("sigma_of", term.sigma_of)):
            if other is not None and (message := unknown_case(wanted[name] | other, cases)):
                yield f"terms.{name}.{key}", message
    unknown = {name: message for name, levels in wanted.items() if (message := unknown_case(levels, cases))}
    if not unknown and not readings(cases, wanted):
        unknown = {name: unknown_case(levels, cases, True) for name, levels in wanted.items()}
        unknown = {name: text for name, text in unknown.items() if text} or {
            next(iter(one.terms)): "the terms have no case in common for any choice of the axes left out"
        }
    yield from ((f"terms.{name}.case", message) for name, message in unknown.items())
