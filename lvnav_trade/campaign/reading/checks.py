"""Cross-checks of a campaign: cases, reporting frame, names, axes, levels, and the selections among cases."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from lvnav_trade.campaign.definition.axes import (
    BASE_LABEL,
    axis_names,
    case_label,
    choice,
    chosen_levels,
    combinations,
    get,
    level_label,
)
from lvnav_trade.campaign.definition.metric_names import metric_of
from lvnav_trade.campaign.definition.published_cards import Pooled, PublishedNumber
from lvnav_trade.campaign.definition.schema import Axis, Campaign
from lvnav_trade.campaign.syntax.tree import Node, hint, mistake, mistake_at, nearest
from lvnav_trade.quantities.errors import Mistake, quoted
from lvnav_trade.quantities.input_limits import AXES, CASES, DESIGNS
from lvnav_trade.quantities.state_layout import AXES as FRAME_AXES
from lvnav_trade.results.metrics.state_errors import NORM, StateError
from lvnav_trade.scenario.rules import breaches_of_case
from lvnav_trade.scenario.scenario import Scenario


def broken_rules(scenario: Scenario, base: Node) -> Iterator[Mistake]:
    """Yield an input error for each rule between settings that a case breaks, at the field to correct."""
    for path, reason in breaches_of_case(scenario):
        yield mistake_at(base, path, reason, "base")


def requirements(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the requirements whose metric a campaign does not have, and requirements with equal names."""
    names = [requirement.name for requirement in campaign.requirements]
    for index, (name, requirement) in enumerate(zip(names, campaign.requirements, strict=True)):
        if message := metric_of(requirement.metric).missing_in(campaign):
            yield mistake_at(root, f"requirements.{index}.metric", f"{requirement.metric!r}: {message}")
        if name in names[:index]:
            yield mistake_at(root, f"requirements.{index}.name", f"{name!r} is used twice; give another name")


_MEANINGLESS_ALONE: tuple[tuple[str, Callable[[Campaign], bool], str], ...] = (
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


def without_effect(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the settings of the campaign itself that have no effect."""
    for path, applies, message in _MEANINGLESS_ALONE:
        if applies(campaign):
            yield mistake_at(root, path, message)


def references(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the cases and axes that published numbers name and the campaign does not have."""
    for path, message in reference_faults(campaign, campaign.references):
        yield mistake_at(root, f"references.{path}", message)


def reference_faults(campaign: Campaign, published: Sequence[PublishedNumber]) -> Iterator[tuple[str, str]]:
    """Yield the errors of published numbers that name an unknown case or axis: path within the list, and message."""
    cases, axes = named_cases(campaign), axes_of_errors(campaign)
    for index, number in enumerate(published):
        yield from ((f"{index}.{path}", message) for path, message in pool_faults(number, number.case, cases))
        if message := unknown_case(number.case, cases):
            yield f"{index}.case", message
        if number.against is not None:
            against = number.against | pooled_levels(number, cases)
            if message := unknown_case(against, cases, single=True):
                yield f"{index}.against", message
        if message := unknown_axis(number.metric, axes):
            yield f"{index}.metric", message


def unknown_axis(name: str, axes: Mapping[str, Sequence[str]]) -> str:
    """Return the message if a metric has an axis that no frame of the campaign has, else an empty text.

    axes : axes by quantity, from `axes_of_errors`.
    """
    metric = metric_of(name)
    if not isinstance(metric, StateError) or metric.quantity not in axes:
        return ""
    known = axes[metric.quantity]
    if metric.axis in (*known, NORM):
        return ""
    return f"{quoted(name)}: no such axis; {metric.quantity} has {', '.join(known)}"


def axes_of_errors(campaign: Campaign) -> dict[str, list[str]]:
    """Return the axes of attitude, velocity and position errors in all reporting frames of a campaign."""
    frames = {str(v) for axis in campaign.axes if axis.path == "frame" for v in axis.values or ()}
    known = list(dict.fromkeys(name for frame in sorted({campaign.base.frame, *frames}) for name in FRAME_AXES[frame]))
    return {"attitude": ["roll", "pitch", "yaw"], "velocity": known, "position": known}


def pool_faults(
    statement: Pooled, wanted: Mapping[str, str], cases: Sequence[Mapping[str, str]]
) -> Iterator[tuple[str, str]]:
    """Yield the errors of pooled axes, path and message: an unknown axis, or an axis whose level is also given."""
    for axis in statement.pool:
        if cases and axis not in cases[0]:
            yield "pool", f"no axis {quoted(axis)}{meant(axis, cases[0])}"
        elif axis in wanted:
            yield "pool", f"{axis} is pooled, and the case names one of its levels; choose one"


def pooled_levels(statement: Pooled, cases: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return one level of each pooled axis, which represents all of its levels."""
    return {axis: cases[0][axis] for axis in statement.pool if cases and axis in cases[0]}


def narrowed(campaign: Campaign) -> Campaign:
    """Return a campaign without the published numbers of levels that an assignment has removed from its axes."""
    cases = named_cases(campaign)
    remaining = (
        number
        for number in campaign.references
        if not any(unknown_case(levels, cases) for levels in (number.case, number.against or {}))
    )
    return campaign.model_copy(update={"references": tuple(remaining)})


def of_study(part: Any, campaign: Campaign) -> Iterator[tuple[str, str]]:
    """Yield the errors of a section of a study that names unknown cases or axes: path within the section, message."""
    cases = named_cases(campaign)
    wanted = [(f"figures.{i}.case", figure.case) for i, figure in enumerate(part.figures)]
    wanted += [
        (f"figures.{i}.cases.{k}", case) for i, figure in enumerate(part.figures) for k, case in enumerate(figure.cases)
    ]
    wanted.append(("kml", part.kml or {}))
    for path, levels in wanted:
        if message := unknown_case(levels, cases):
            yield path, message
    for i, figure in enumerate(part.figures):
        if figure.flown and (message := unknown_case({figure.axis: figure.flown}, cases)):
            yield f"figures.{i}.flown", message
    if part.paired and part.paired not in cases[0]:
        yield "paired", f"no axis {quoted(part.paired)}{meant(part.paired, cases[0])}"


def named_cases(campaign: Campaign) -> list[dict[str, str]]:
    """Return the label of the level of every axis, by name, for every case.

    In the design one_at_a_time a level equal to the value of the base is no further case.
    """
    base = campaign.base.model_dump(mode="json")
    base_values = [get(base, axis.path.split(".")) for axis in campaign.axes]
    return [
        choice(campaign.axes, chosen)
        for chosen in chosen_levels(campaign)
        if campaign.design != "one_at_a_time"
        or not any(
            index is not None and not axis.crossed and (axis.values or ())[index] == value
            for index, axis, value in zip(chosen, campaign.axes, base_values, strict=True)
        )
    ]


def unknown_case(wanted: Mapping[str, str], cases: Sequence[Mapping[str, str]], single: bool = False) -> str:
    """Return the message if no case has the levels wanted (by axis), else an empty text.

    With `single` the message is also returned if several cases have them.
    """
    for axis, level in wanted.items():
        names = list(cases[0]) if cases else []
        if axis not in names:
            return f"no axis {quoted(axis)}{meant(axis, names)}"
        known = list(dict.fromkeys(case[axis] for case in cases))
        if level not in known:
            return f"no level {quoted(level)} of the axis {axis}{meant(level, known)}"
    count = sum(all(case[axis] == level for axis, level in wanted.items()) for case in cases)
    if not count:
        return "no case has these levels together"
    return f"{count} cases have these levels; name one" if single and count > 1 else ""


def meant(name: str, known: Iterable[str]) -> str:
    """Return the suggestion of a similar name, or else a list of the first known names."""
    shown = [quoted(name).strip("'\"") for name in known]
    listed = f" (known: {', '.join(shown[:12])}{', ...' if len(shown) > 12 else ''})" if shown else ""
    return hint(name, known) or listed


# --- axes and their labels --------------------------------------------------------------------------------------------

_LONGEST = 200  # characters of a label


class WrittenAxis(NamedTuple):
    """An axis as written in the campaign file."""

    axis: Axis
    node: Node  # its YAML tree

    @property
    def key(self) -> str:
        """The field with its levels: cards or values."""
        return "cards" if "cards" in self.node.value else "values"

    @property
    def levels(self) -> list[Node]:
        """The nodes of its levels."""
        return list(self.node.value["values" if self.axis.cards is None else "cards"].value)


def replaced(kind: str, axes: Sequence[WrittenAxis]) -> Iterator[Mistake]:
    """Yield the axes whose value a later axis replaces: the later axis varies the same field or settings above it.

    The opposite order is permitted: first the settings, then a field of them. In the design one_at_a_time any order is
    permitted, but not the same field twice.
    """
    for later, (above, _) in enumerate(axes):
        for number, (axis, node) in enumerate(axes[:later]):
            is_same = axis.steps == above.steps
            if is_same or ((kind != "one_at_a_time" or axis.crossed) and axis.steps[: len(above.steps)] == above.steps):
                what = "varies the same field" if is_same else "replaces it; put that axis first"
                message = f"{quoted(axis.path)}: the later axis {quoted(above.path)} {what}"
                yield mistake_at(node, "path", message, f"axes.{number}")


def too_many(kind: str, sizes: Sequence[int], root: Node, crossed: Sequence[int] = ()) -> Iterator[Mistake]:
    """Yield an input error if a design with axes of these sizes has too many axes or cases."""
    one_at_a_time = 1 + sum(size for axis, size in enumerate(sizes) if axis not in crossed)
    one_at_a_time *= math.prod(sizes[axis] for axis in crossed)
    count = {"grid": math.prod(sizes), "zip": max(sizes, default=1)}.get(kind, one_at_a_time)
    if len(sizes) > AXES:
        yield mistake_at(root, "axes", f"{len(sizes)} axes; at most {AXES} are varied")
    elif count > CASES:
        rest = "are stored whole: give `store: metrics`" if kind == "grid" and count <= DESIGNS else "are computed"
        yield mistake_at(root, "axes", f"{count} cases; at most {CASES} {rest}")


def bad_levels(
    kind: str, varied: WrittenAxis, values: Sequence[object], labels: Sequence[str], index: int
) -> Iterator[Mistake]:
    """Yield the input errors of the levels and labels of an axis.

    Two levels must not be equal, except in a zip. A label must not be empty, too long, not printable, the label of the
    base, or the label of a different level.
    """
    path = f"axes.{index}.{varied.key}"
    for number, value in enumerate(values):
        if kind != "zip" and value in values[:number]:
            same = f"the same as level {values.index(value)} of the axis {quoted(varied.axis.path)} (0 is the first)"
            yield mistake(varied.levels[number].place, f"{path}.{number}", same)
    place = nearest(varied.node, ["labels"])
    for label in labels:
        if not label.strip() or len(label) > _LONGEST or not label.isprintable():
            message = f"{quoted(label)} is no label: 1 to {_LONGEST} printable characters; give labels"
            yield mistake(place, path, message)
        elif kind == "one_at_a_time" and label == BASE_LABEL:
            yield mistake(place, path, f"{label!r} is the label of the base; give labels")
    named = dict(zip(labels, values, strict=True))
    if any(named[label] != value for label, value in zip(labels, values, strict=True)):
        yield mistake(place, path, "two levels have the same label; give labels")


def equal_cases(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield an input error if two cases of a design have the same label, or two cases of a zip are equal."""
    kind, axes = campaign.design, campaign.axes
    pairs = list(zip(*(axis.values or () for axis in axes), strict=True)) if kind == "zip" else []
    for index, pair in enumerate(pairs):
        if pair in pairs[:index]:
            same = f"level {index} of every axis is the same as level {pairs.index(pair)} (0 is the first)"
            yield mistake_at(root, "axes", same)
    labels = [case_label(choice(axes, chosen)) for chosen in chosen_levels(campaign)]
    twice = next((label for index, label in enumerate(labels) if label in labels[:index]), None)
    if twice is not None:
        yield mistake_at(root, "axes", f"two cases have the label {quoted(twice)}; give other labels")


def narrowing(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the input errors of `when`, `exclude` and `constraints`.

    Unknown axes and levels, invalid expressions, and selections that exclude no case or all cases.
    """
    known = {
        name: [level_label(axis, index) for index in range(len(axis.values or ()))]
        for name, axis in zip(axis_names(campaign.axes), campaign.axes, strict=True)
    }
    wanted = [(f"axes.{k}.when", axis.when) for k, axis in enumerate(campaign.axes)]
    wanted += [(f"exclude.{k}", levels) for k, levels in enumerate(campaign.exclude)]
    errors = [mistake_at(root, path, message) for path, levels in wanted for message in _unknown_levels(levels, known)]
    errors += [
        mistake_at(root, f"exclude.{k}", "names no axis") for k, levels in enumerate(campaign.exclude) if not levels
    ]
    if errors:
        yield from errors
        return
    base = campaign.base.model_dump(mode="json")
    whole = combinations(campaign.design, campaign.axes, (), (), base)
    for key in ("exclude", "constraints"):
        for k, selection in enumerate(getattr(campaign, key)):
            alone = {"exclude": (), "constraints": ()} | {key: (selection,)}
            try:
                remaining = combinations(campaign.design, campaign.axes, alone["exclude"], alone["constraints"], base)
            except ValueError as error:
                yield mistake_at(root, f"{key}.{k}", str(error))
                continue
            if len(remaining) in (0, len(whole)):
                yield mistake_at(root, f"{key}.{k}", f"leaves {'nothing' if remaining else 'everything'} out")
    unlimited = combinations(campaign.design, [axis.model_copy(update={"when": {}}) for axis in campaign.axes])
    for k, axis in enumerate(campaign.axes):
        if axis.when and len(unlimited) == len(
            combinations(
                campaign.design,
                [other if other is axis else other.model_copy(update={"when": {}}) for other in campaign.axes],
            )
        ):
            yield mistake_at(root, f"axes.{k}.when", "no effect: every case has these levels")


def _unknown_levels(wanted: Mapping[str, str | Sequence[str]], known: Mapping[str, Sequence[str]]) -> Iterator[str]:
    for name, levels in wanted.items():
        if name not in known:
            yield f"no axis {quoted(name)}{meant(name, known)}"
            continue
        for level in [levels] if isinstance(levels, str) else levels:
            if level not in (*known[name], BASE_LABEL):
                yield f"no level {quoted(level)} of the axis {name}{meant(level, known[name])}"


def selection(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield an input error if the cases selected for all runs are no case or all cases."""
    chosen = campaign.monte_carlo.selected if campaign.monte_carlo is not None else {}
    if not chosen:
        return
    cases = named_cases(campaign)
    if message := unknown_case(chosen, cases):
        yield mistake_at(root, "monte_carlo.selected", message)
    elif all(case[axis] == level for case in cases for axis, level in chosen.items()):
        yield mistake_at(root, "monte_carlo.selected", "no effect: every case has these levels")
