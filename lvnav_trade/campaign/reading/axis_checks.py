"""Cross-checks of the axes of a campaign: paths, levels, labels, numbers of cases, selections among cases."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from lvnav_trade.campaign.definition.axes import (
    BASE_LABEL,
    axis_names,
    case_label,
    choice,
    chosen_levels,
    combinations,
    level_label,
)
from lvnav_trade.campaign.definition.schema import Axis, Campaign
from lvnav_trade.campaign.reading.checks import meant, named_cases, unknown_case
from lvnav_trade.campaign.syntax.tree import Node, mistake, mistake_at, nearest
from lvnav_trade.quantities.errors import Mistake, quoted
from lvnav_trade.quantities.input_limits import AXES, CASES, DESIGNS

_LONGEST_LABEL = 200  # characters of a label


class WrittenAxis(NamedTuple):
    """An axis as written in the campaign file."""

    axis: Axis  # the axis after validation
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
    for later_number, (later, _) in enumerate(axes):
        earlier_axes = axes[:later_number]
        for number, (axis, node) in enumerate(earlier_axes):
            is_same = axis.steps == later.steps
            leading_steps = axis.steps[: len(later.steps)]
            is_below = leading_steps == later.steps
            varied_together = kind != "one_at_a_time" or axis.crossed
            if is_same or (is_below and varied_together):
                conflict = "varies the same field" if is_same else "replaces it; put that axis first"
                message = f"{quoted(axis.path)}: the later axis {quoted(later.path)} {conflict}"
                yield mistake_at(node, "path", message, f"axes.{number}")


def too_many(kind: str, sizes: Sequence[int], root: Node, crossed: Sequence[int] = ()) -> Iterator[Mistake]:
    """Yield an input error if a design with axes of these sizes has too many axes or cases.

    Parameters
    ----------
    kind : str
        Design of the campaign.
    sizes : sequence of int
        Number of levels of each axis.
    root : Node
        Tree of the campaign, for the place of the error.
    crossed : sequence of int
        Indices of the crossed axes.
    """
    if kind == "grid":
        count = math.prod(sizes)
    elif kind == "zip":
        count = max(sizes, default=1)
    else:  # one axis at a time, each with every combination of the crossed axes
        count = 1 + sum(size for axis, size in enumerate(sizes) if axis not in crossed)
        count *= math.prod(sizes[axis] for axis in crossed)
    if len(sizes) > AXES:
        yield mistake_at(root, "axes", f"{len(sizes)} axes; at most {AXES} are varied")
    elif count > CASES:
        is_possible_space = kind == "grid" and count <= DESIGNS
        limit = "are stored whole: give `store: metrics`" if is_possible_space else "are computed"
        yield mistake_at(root, "axes", f"{count} cases; at most {CASES} {limit}")


def bad_levels(
    kind: str, varied: WrittenAxis, values: Sequence[object], labels: Sequence[str], index: int
) -> Iterator[Mistake]:
    """Yield the input errors of the levels and labels of an axis.

    Two levels must not be equal, except in a zip. A label must not be empty, too long, not printable, the label of the
    base, or the label of a different level.

    Parameters
    ----------
    kind : str
        Design of the campaign.
    varied : WrittenAxis
        The axis as written in the file.
    values, labels : sequence
        Values and labels of its levels.
    index : int
        Index of the axis in the campaign.
    """
    path = f"axes.{index}.{varied.key}"
    for number, value in enumerate(values):
        if kind != "zip" and value in values[:number]:
            first = values.index(value)
            message = f"the same as level {first} of the axis {quoted(varied.axis.path)} (0 is the first)"
            yield mistake(varied.levels[number].place, f"{path}.{number}", message)
    place = nearest(varied.node, ["labels"])
    for label in labels:
        if not label.strip() or len(label) > _LONGEST_LABEL or not label.isprintable():
            message = f"{quoted(label)} is no label: 1 to {_LONGEST_LABEL} printable characters; give labels"
            yield mistake(place, path, message)
        elif kind == "one_at_a_time" and label == BASE_LABEL:
            yield mistake(place, path, f"{label!r} is the label of the base; give labels")
    value_of = dict(zip(labels, values, strict=True))
    for label, value in zip(labels, values, strict=True):
        if value_of[label] != value:
            yield mistake(place, path, "two levels have the same label; give labels")
            return


def equal_cases(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield an input error if two cases of a design have the same label, or two cases of a zip are equal."""
    axes = campaign.axes
    if campaign.design == "zip":
        columns = [axis.values or () for axis in axes]
        cases = list(zip(*columns, strict=True))
        for index, values in enumerate(cases):
            first = cases.index(values)
            if first < index:
                message = f"level {index} of every axis is the same as level {first} (0 is the first)"
                yield mistake_at(root, "axes", message)
    labels: set[str] = set()
    for chosen in chosen_levels(campaign):
        label = case_label(choice(axes, chosen))
        if label in labels:
            yield mistake_at(root, "axes", f"two cases have the label {quoted(label)}; give other labels")
            return
        labels.add(label)


def narrowing(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the input errors of `when`, `exclude` and `constraints`.

    Unknown axes and levels, invalid expressions, and selections that exclude no case or all cases.
    """
    errors = list(_selection_errors(campaign, root))
    if errors:
        yield from errors
    else:
        yield from _fruitless_selections(campaign, root)
        yield from _fruitless_conditions(campaign, root)


def _selection_errors(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the unknown axes and levels in `when` and `exclude`, and exclusions that name no axis."""
    levels_of = {}
    for name, axis in zip(axis_names(campaign.axes), campaign.axes, strict=True):
        n_level = len(axis.values or ())
        levels_of[name] = [level_label(axis, index) for index in range(n_level)]
    selections = [(f"axes.{k}.when", axis.when) for k, axis in enumerate(campaign.axes)]
    selections += [(f"exclude.{k}", levels) for k, levels in enumerate(campaign.exclude)]
    for path, levels in selections:
        for message in _unknown_levels(levels, levels_of):
            yield mistake_at(root, path, message)
    for k, levels in enumerate(campaign.exclude):
        if not levels:
            yield mistake_at(root, f"exclude.{k}", "names no axis")


def _fruitless_selections(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield each entry of `exclude` and `constraints` that alone excludes no case or all cases, or is not valid."""
    base = campaign.base.model_dump(mode="json")
    all_cases = combinations(campaign.design, campaign.axes, (), (), base)
    for key in ("exclude", "constraints"):
        for k, entry in enumerate(getattr(campaign, key)):
            exclude = (entry,) if key == "exclude" else ()
            constraints = (entry,) if key == "constraints" else ()
            try:
                remaining = combinations(campaign.design, campaign.axes, exclude, constraints, base)
            except ValueError as error:
                yield mistake_at(root, f"{key}.{k}", str(error))
                continue
            if not remaining:
                yield mistake_at(root, f"{key}.{k}", "leaves everything out")
            elif len(remaining) == len(all_cases):
                yield mistake_at(root, f"{key}.{k}", "leaves nothing out")


def _fruitless_conditions(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the axes whose `when` removes no case."""
    unconditional = [axis.model_copy(update={"when": {}}) for axis in campaign.axes]
    n_unconditional = len(combinations(campaign.design, unconditional))
    for k, axis in enumerate(campaign.axes):
        if not axis.when:
            continue
        only_this_condition = [*unconditional[:k], axis, *unconditional[k + 1 :]]
        n_conditional = len(combinations(campaign.design, only_this_condition))
        if n_conditional == n_unconditional:
            yield mistake_at(root, f"axes.{k}.when", "no effect: every case has these levels")


def _unknown_levels(wanted: Mapping[str, str | Sequence[str]], levels_of: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Yield a message for each axis and level wanted that does not exist; `levels_of`: labels by axis."""
    for name, labels in wanted.items():
        if name not in levels_of:
            yield f"no axis {quoted(name)}{meant(name, levels_of)}"
            continue
        levels = levels_of[name]
        for label in [labels] if isinstance(labels, str) else labels:
            if label not in (*levels, BASE_LABEL):
                yield f"no level {quoted(label)} of the axis {name}{meant(label, levels)}"


def selection(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield an input error if the cases selected for all runs are no case or all cases."""
    selected = campaign.monte_carlo.selected if campaign.monte_carlo is not None else {}
    if not selected:
        return
    cases = named_cases(campaign)
    message = unknown_case(selected, cases)
    if message:
        yield mistake_at(root, "monte_carlo.selected", message)
    elif all(case[axis] == level for case in cases for axis, level in selected.items()):
        yield mistake_at(root, "monte_carlo.selected", "no effect: every case has these levels")
