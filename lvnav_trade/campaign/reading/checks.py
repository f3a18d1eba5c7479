"""Cross-checks of a campaign: its cases, reporting frame, case names, axes, levels."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from lvnav_trade.campaign.definition.axes import (
    BASE_LABEL,
    case_label,
    choice,
    chosen_levels,
    get,
)
from lvnav_trade.campaign.definition.metric_names import metric_of
from lvnav_trade.campaign.definition.published import Pooled, Published
from lvnav_trade.campaign.definition.schema import Axis, Campaign
from lvnav_trade.campaign.syntax.tree import Node, hint, mistake, mistake_at, nearest
from lvnav_trade.errors import Mistake, quoted
from lvnav_trade.layout import AXES as FRAME_AXES
from lvnav_trade.limits import AXES, CASES, DESIGNS
from lvnav_trade.metrics.families.errors import NORM, StateError
from lvnav_trade.rules import breaches_of_case
from lvnav_trade.scenario import Scenario


def broken_rules(scenario: Scenario, base: Node) -> Iterator[Mistake]:
    """Yield the rules between fields that a case breaks, each at the field to mend."""
    for path, reason in breaches_of_case(scenario):
        yield mistake_at(base, path, reason, "base")


def requirements(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the requirements that name an axis which the reporting frame does not have, or share a name."""
    names = [requirement.name for requirement in campaign.requirements]
    for index, (name, requirement) in enumerate(zip(names, campaign.requirements, strict=True)):
        if message := metric_of(requirement.metric).missing_in(campaign):
            yield mistake_at(root, f"requirements.{index}.metric", f"{requirement.metric!r}: {message}")
        if name in names[:index]:
            yield mistake_at(root, f"requirements.{index}.name", f"{name!r} is used twice; give another name")


_WITHOUT: tuple[tuple[str, Callable[[Campaign], bool], str], ...] = (
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
"""The campaign's own settings that mean nothing without another: path, whether it is so, message. Reading does not show
it: they are read once runs have been flown.
"""


def without_effect(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the campaign's own settings that have no effect."""
    for path, applies, message in _WITHOUT:
        if applies(campaign):
            yield mistake_at(root, path, message)


def references(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield what published numbers name and the campaign does not have."""
    for path, message in reference_faults(campaign, campaign.references):
        yield mistake_at(root, f"references.{path}", message)


def reference_faults(campaign: Campaign, published: Sequence[Published]) -> Iterator[tuple[str, str]]:
    """Yield path within a list of published numbers, and message, for what they name and the campaign does not have."""
    cases, axes = named_cases(campaign), axes_of_errors(campaign)
    for index, one in enumerate(published):
        yield from ((f"{index}.{path}", message) for path, message in pool_faults(one, one.case, cases))
        if message := unknown_case(one.case, cases):
            yield f"{index}.case", message
        if one.against is not None and (message := unknown_case(one.against | pooled_levels(one, cases), cases, True)):
            yield f"{index}.against", message
        if message := unknown_axis(one.metric, axes):
            yield f"{index}.metric", message


def unknown_axis(name: str, axes: Mapping[str, Sequence[str]]) -> str:
    """Say that a metric is of an axis that no frame of a campaign has (`axes_of_errors`); empty where one has."""
    metric = metric_of(name)
    if not isinstance(metric, StateError) or metric.quantity not in axes:
        return ""
    known = axes[metric.quantity]
    if metric.axis in (*known, NORM):
        return ""
    return f"{quoted(name)}: no such axis; {metric.quantity} has {', '.join(known)}"


def axes_of_errors(campaign: Campaign) -> dict[str, list[str]]:
    """Return the axes of attitude, velocity and position in any frame of a campaign."""
    frames = {str(v) for axis in campaign.axes if axis.path == "frame" for v in axis.values or ()}
    known = list(dict.fromkeys(name for frame in sorted({campaign.base.frame, *frames}) for name in FRAME_AXES[frame]))
    return {"attitude": ["roll", "pitch", "yaw"], "velocity": known, "position": known}


def pool_faults(
    one: Pooled, wanted: Mapping[str, str], cases: Sequence[Mapping[str, str]]
) -> Iterator[tuple[str, str]]:
    """Yield path and message for what is wrong with the axes whose levels a number takes together."""
    for axis in one.pool:
        if cases and axis not in cases[0]:
            yield "pool", f"no axis {quoted(axis)}{meant(axis, cases[0])}"
        elif axis in wanted:
            yield "pool", f"{axis} is pooled, and the case names one of its levels; choose one"


def pooled_levels(one: Pooled, cases: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return a level of each axis that is taken together, which stands for all of them."""
    return {axis: cases[0][axis] for axis in one.pool if cases and axis in cases[0]}


def narrowed(campaign: Campaign) -> Campaign:
    """Return a campaign whose axes an assignment has changed, without the published numbers of levels that are gone."""
    cases = named_cases(campaign)
    kept = (
        one
        for one in campaign.references
        if not any(unknown_case(wanted, cases) for wanted in (one.case, one.against or {}))
    )
    return campaign.model_copy(update={"references": tuple(kept)})


def of_study(part: Any, campaign: Campaign) -> Iterator[tuple[str, str]]:
    """Yield path within a part of a study and message for the cases and axes that the part names and its campaign does
    not have.
    """
    cases = named_cases(campaign)
    wanted = [(f"figures.{i}.case", figure.case) for i, figure in enumerate(part.figures)]
    wanted += [
        (f"figures.{i}.cases.{k}", one) for i, figure in enumerate(part.figures) for k, one in enumerate(figure.cases)
    ]
    wanted.append(("kml", part.kml or {}))
    for path, one in wanted:
        if message := unknown_case(one, cases):
            yield path, message
    for i, figure in enumerate(part.figures):
        if figure.flown and (message := unknown_case({figure.axis: figure.flown}, cases)):
            yield f"figures.{i}.flown", message
    if part.paired and part.paired not in cases[0]:
        yield "paired", f"no axis {quoted(part.paired)}{meant(part.paired, cases[0])}"


def named_cases(campaign: Campaign) -> list[dict[str, str]]:
    """Return the level of every axis of every case, by name; the axes of the campaign have labels.

    Where one axis is varied at a time, the base's own value is no case beside the base.
    """
    base = campaign.base.model_dump(mode="json")
    own = [get(base, axis.path.split(".")) for axis in campaign.axes]
    return [
        choice(campaign.axes, chosen)
        for chosen in chosen_levels(campaign)
        if campaign.design != "one_at_a_time"
        or not any(
            index is not None and not axis.crossed and (axis.values or ())[index] == value
            for index, axis, value in zip(chosen, campaign.axes, own, strict=True)
        )
    ]


def unknown_case(wanted: Mapping[str, str], cases: Sequence[Mapping[str, str]], single: bool = False) -> str:
    """Say why no case has the levels wanted, by axis; nothing where one has. `single`: where it is not exactly one."""
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
    """Return the name that is probably meant, else the first of those known."""
    shown = [quoted(one).strip("'\"") for one in known]
    listed = f" (known: {', '.join(shown[:12])}{', ...' if len(shown) > 12 else ''})" if shown else ""
    return hint(name, known) or listed


# --- axes and their labels --------------------------------------------------------------------------------------------

_LONGEST = 200  # characters of a label


class Varied(NamedTuple):
    """An axis as it was written, and its node."""

    axis: Axis
    node: Node

    @property
    def key(self) -> str:
        """The field that holds its levels: cards or values."""
        return "cards" if "cards" in self.node.value else "values"

    @property
    def levels(self) -> list[Node]:
        """The nodes of its levels."""
        return list(self.node.value["values" if self.axis.cards is None else "cards"].value)


def replaced(kind: str, axes: Sequence[Varied]) -> Iterator[Mistake]:
    """Yield the axes of which a later axis replaces the value: the same field, or settings that it is a field of.

    The other order is allowed: first the settings, then one of their fields. So is any order where one axis is varied
    at a time, but not the same field twice.
    """
    for later, (above, _) in enumerate(axes):
        for number, (axis, node) in enumerate(axes[:later]):
            is_same = axis.steps == above.steps
            if is_same or ((kind != "one_at_a_time" or axis.crossed) and axis.steps[: len(above.steps)] == above.steps):
                what = "varies the same field" if is_same else "replaces it; put that axis first"
                message = f"{quoted(axis.path)}: the later axis {quoted(above.path)} {what}"
                yield mistake_at(node, "path", message, f"axes.{number}")


def too_many(kind: str, sizes: Sequence[int], root: Node, crossed: Sequence[int] = ()) -> Iterator[Mistake]:
    """Yield a mistake where a design of axes of these sizes has more cases than are computed."""
    one = 1 + sum(size for axis, size in enumerate(sizes) if axis not in crossed)
    one *= math.prod(sizes[axis] for axis in crossed)
    count = {"grid": math.prod(sizes), "zip": max(sizes, default=1)}.get(kind, one)
    if len(sizes) > AXES:
        yield mistake_at(root, "axes", f"{len(sizes)} axes; at most {AXES} are varied")
    elif count > CASES:
        rest = "are stored whole: give `store: metrics`" if kind == "grid" and count <= DESIGNS else "are computed"
        yield mistake_at(root, "axes", f"{count} cases; at most {CASES} {rest}")


def bad_levels(
    kind: str, varied: Varied, values: Sequence[object], labels: Sequence[str], index: int
) -> Iterator[Mistake]:
    """Yield the levels of an axis whose whole value is that of an earlier one, as only the axes of a zip may have them,
    and the labels that are no labels: empty, too long, not printable, that of the base, or that of another level.
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
    """Yield a mistake where two cases of a design have the same label, or two pairs of a zip are equal."""
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
