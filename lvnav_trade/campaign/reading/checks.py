"""Cross-checks of a campaign: requirements, settings without effect, and names of cases, levels and axes."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from lvnav_trade.campaign.definition.axes import case_level_indices, choice, get
from lvnav_trade.campaign.definition.metric_names import metric_of
from lvnav_trade.campaign.definition.published_cards import Pooled, PublishedNumber
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.syntax.tree import Node, hint, mistake_at
from lvnav_trade.quantities.errors import Mistake, quoted
from lvnav_trade.quantities.state_layout import AXES as FRAME_AXES
from lvnav_trade.results.metrics.state_errors import NORM, StateError
from lvnav_trade.scenario.rules import case_breaches
from lvnav_trade.scenario.scenario import Scenario


def broken_rules(scenario: Scenario, base: Node) -> Iterator[Mistake]:
    """Yield an input error for each rule between settings that a case breaks, at the field to correct."""
    for path, reason in case_breaches(scenario):
        yield mistake_at(base, path, reason, "base")


def requirements(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the requirements whose metric a campaign does not have, and requirements with equal names."""
    names: set[str] = set()
    for index, requirement in enumerate(campaign.requirements):
        message = metric_of(requirement.metric).missing_in(campaign)
        if message:
            yield mistake_at(root, f"requirements.{index}.metric", f"{requirement.metric!r}: {message}")
        if requirement.name in names:
            message = f"{requirement.name!r} is used twice; give another name"
            yield mistake_at(root, f"requirements.{index}.name", message)
        names.add(requirement.name)


_DEPENDENT_SETTINGS: tuple[tuple[str, Callable[[Campaign], bool], str], ...] = (
    (
        "monte_carlo.stop",
        lambda c: c.monte_carlo is not None and c.monte_carlo.stop is not None and not c.requirements,
        "there is no requirement that could be decided",
    ),
    (
        "covariance.window",
        lambda c: c.covariance.window is not None and not c.covariance.observability,
        "no effect: observability is off",
    ),
    ("design", lambda c: c.design != "grid" and not c.axes, "no effect: the campaign has no axes"),
    (
        "axes",
        lambda c: c.design != "one_at_a_time" and any(axis.crossed for axis in c.axes),
        "crossed has no effect: it is of a design one_at_a_time",
    ),
)
"""Settings of the campaign itself that have no effect without another: path, condition, message.

They are listed because the check of what cases read does not cover them: they are used after the runs.
"""


def settings_without_effect(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the settings of the campaign itself that have no effect."""
    for path, is_idle, message in _DEPENDENT_SETTINGS:
        if is_idle(campaign):
            yield mistake_at(root, path, message)


def references(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the cases and axes that published numbers name and the campaign does not have."""
    for path, message in reference_faults(campaign, campaign.references):
        yield mistake_at(root, f"references.{path}", message)


def reference_faults(campaign: Campaign, published_numbers: Sequence[PublishedNumber]) -> Iterator[tuple[str, str]]:
    """Yield the errors of published numbers that name an unknown case or axis: path within the list, and message."""
    cases = named_cases(campaign)
    axes = error_axes(campaign)
    for index, number in enumerate(published_numbers):
        for path, message in pool_faults(number, number.case, cases):
            yield f"{index}.{path}", message
        message = unknown_case(number.case, cases)
        if message:
            yield f"{index}.case", message
        if number.against is not None:
            compared_levels = number.against | pooled_levels(number, cases)
            message = unknown_case(compared_levels, cases, single=True)
            if message:
                yield f"{index}.against", message
        message = unknown_axis(number.metric, axes)
        if message:
            yield f"{index}.metric", message


def unknown_axis(name: str, axes: Mapping[str, Sequence[str]]) -> str:
    """Return the message if a metric has an axis that no frame of the campaign has, else an empty text.

    axes : axes of the errors by quantity, from `error_axes`.
    """
    metric = metric_of(name)
    if not isinstance(metric, StateError) or metric.quantity not in axes:
        return ""
    axis_names = axes[metric.quantity]
    if metric.axis in (*axis_names, NORM):
        return ""
    return f"{quoted(name)}: no such axis; {metric.quantity} has {', '.join(axis_names)}"


def error_axes(campaign: Campaign) -> dict[str, list[str]]:
    """Return the axes of attitude, velocity and position errors in all reporting frames of a campaign."""
    frames: list[str] = [campaign.base.frame]
    for axis in campaign.axes:
        if axis.path == "frame":
            frames += map(str, axis.values or ())
    frame_axes = [name for frame in sorted(set(frames)) for name in FRAME_AXES[frame]]
    distinct_axes = list(dict.fromkeys(frame_axes))
    return {"attitude": ["roll", "pitch", "yaw"], "velocity": distinct_axes, "position": distinct_axes}


def pool_faults(
    statement: Pooled, required_levels: Mapping[str, str], cases: Sequence[Mapping[str, str]]
) -> Iterator[tuple[str, str]]:
    """Yield the errors of pooled axes, path and message: an unknown axis, or an axis whose level is also given.

    Parameters
    ----------
    statement : Pooled
        Statement with the pooled axes.
    required_levels : mapping of str to str
        Level by axis that the statement requires.
    cases : sequence of mapping
        Level by axis of every case.
    """
    for axis in statement.pool:
        if cases and axis not in cases[0]:
            yield "pool", f"no axis {quoted(axis)}{name_suggestion(axis, cases[0])}"
        elif axis in required_levels:
            yield "pool", f"{axis} is pooled, and the case names one of its levels; choose one"


def pooled_levels(statement: Pooled, cases: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return one level of each pooled axis, which represents all of its levels."""
    return {axis: cases[0][axis] for axis in statement.pool if cases and axis in cases[0]}


def with_valid_references(campaign: Campaign) -> Campaign:
    """Return a campaign without the published numbers of levels that an assignment has removed from its axes."""
    cases = named_cases(campaign)
    valid_references = []
    for number in campaign.references:
        if not unknown_case(number.case, cases) and not unknown_case(number.against or {}, cases):
            valid_references.append(number)
    return campaign.model_copy(update={"references": tuple(valid_references)})


def section_errors(section: Any, campaign: Campaign) -> Iterator[tuple[str, str]]:
    """Yield the errors of a section of a study that names unknown cases or axes: path within the section, message."""
    cases = named_cases(campaign)
    selections = [(f"figures.{i}.case", figure.case) for i, figure in enumerate(section.figures)]
    for i, figure in enumerate(section.figures):
        for k, case in enumerate(figure.cases):
            selections.append((f"figures.{i}.cases.{k}", case))
    selections.append(("kml", section.kml or {}))
    for i, figure in enumerate(section.figures):
        if figure.study_level:
            selections.append((f"figures.{i}.study_level", {figure.axis: figure.study_level}))
    for path, levels in selections:
        message = unknown_case(levels, cases)
        if message:
            yield path, message
    if section.paired and section.paired not in cases[0]:
        yield "paired", f"no axis {quoted(section.paired)}{name_suggestion(section.paired, cases[0])}"


def named_cases(campaign: Campaign) -> list[dict[str, str]]:
    """Return the label of the level of every axis, by name, for every case.

    In the design one_at_a_time a level equal to the value of the base is no further case.
    """
    base = campaign.base.model_dump(mode="json")
    base_values = [get(base, axis.path.split(".")) for axis in campaign.axes]

    def repeats_base(level_indices: Sequence[int | None]) -> bool:
        for index, axis, base_value in zip(level_indices, campaign.axes, base_values, strict=True):
            if index is not None and not axis.crossed and (axis.values or ())[index] == base_value:
                return True
        return False

    case_levels = []
    for level_indices in case_level_indices(campaign):
        if campaign.design != "one_at_a_time" or not repeats_base(level_indices):
            case_levels.append(choice(campaign.axes, level_indices))
    return case_levels


def unknown_case(required_levels: Mapping[str, str], cases: Sequence[Mapping[str, str]], single: bool = False) -> str:
    """Return the message if no case has the required levels; otherwise an empty text.

    Parameters
    ----------
    required_levels : mapping of str to str
        Required level by axis.
    cases : sequence of mapping
        Level by axis of every case.
    single : bool
        Whether a message is also returned if several cases have the levels.
    """
    axes = list(cases[0]) if cases else []
    for axis, level in required_levels.items():
        if axis not in axes:
            return f"no axis {quoted(axis)}{name_suggestion(axis, axes)}"
        labels = [case[axis] for case in cases]
        levels = list(dict.fromkeys(labels))
        if level not in levels:
            return f"no level {quoted(level)} of the axis {axis}{name_suggestion(level, levels)}"
    matching_cases = [case for case in cases if all(case[axis] == level for axis, level in required_levels.items())]
    if not matching_cases:
        return "no case has these levels together"
    if single and len(matching_cases) > 1:
        return f"{len(matching_cases)} cases have these levels; name one"
    return ""


def name_suggestion(name: str, known_names: Iterable[str]) -> str:
    """Return the suggestion of a similar name, or else a list of the first known names."""
    names = list(known_names)
    suggestion = hint(name, names)
    if suggestion or not names:
        return suggestion
    name_list = ", ".join(quoted(known_name).strip("'\"") for known_name in names[:_LIST_LENGTH])
    ellipsis = ", ..." if len(names) > _LIST_LENGTH else ""
    return f" (known: {name_list}{ellipsis})"


_LIST_LENGTH = 12  # names that a message lists
