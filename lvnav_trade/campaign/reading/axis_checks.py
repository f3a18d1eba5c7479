"""Cross-checks of the axes of a campaign: paths, levels, labels, numbers of cases, selections among cases."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from lvnav_trade.campaign.definition.axes import (
    BASE_LABEL,
    axis_names,
    case_label,
    case_level_indices,
    choice,
    combinations,
    level_label,
)
from lvnav_trade.campaign.definition.schema import Axis, Campaign
from lvnav_trade.campaign.reading.checks import name_suggestion, named_cases, unknown_case
from lvnav_trade.campaign.syntax.tree import Node, mistake, mistake_at, nearest_place
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


def replaced_axis_errors(design: str, axes: Sequence[WrittenAxis]) -> Iterator[Mistake]:
    """Yield an input error for each axis whose value a later axis replaces.

    The later axis varies the same field, or settings above it. The opposite order is permitted: first the settings,
    then a field of them. In the design one_at_a_time any order is permitted, but not the same field twice.
    """
    for later_number, (later_axis, _) in enumerate(axes):
        earlier_axes = axes[:later_number]
        for number, (axis, node) in enumerate(earlier_axes):
            is_same = axis.steps == later_axis.steps
            leading_steps = axis.steps[: len(later_axis.steps)]
            is_below = leading_steps == later_axis.steps
            is_combined = design != "one_at_a_time" or axis.crossed
            if is_same or (is_below and is_combined):
                conflict = "varies the same field" if is_same else "replaces it; put that axis first"
                message = f"{quoted(axis.path)}: the later axis {quoted(later_axis.path)} {conflict}"
                yield mistake_at(node, "path", message, f"axes.{number}")


def size_errors(design: str, sizes: Sequence[int], root: Node, crossed_axes: Sequence[int] = ()) -> Iterator[Mistake]:
    """Yield an input error if a design with axes of these sizes has too many axes or cases.

    Parameters
    ----------
    design : str
        Design of the campaign.
    sizes : sequence of int
        Number of levels of each axis.
    root : Node
        Tree of the campaign, for the place of the error.
    crossed_axes : sequence of int
        Indices of the crossed axes.
    """
    if design == "grid":
        count = math.prod(sizes)
    elif design == "zip":
        count = max(sizes, default=1)
    else:  # one axis at a time, each with every combination of the crossed axes
        count = 1 + sum(size for axis, size in enumerate(sizes) if axis not in crossed_axes)
        count *= math.prod(sizes[axis] for axis in crossed_axes)
    if len(sizes) > AXES:
        yield mistake_at(root, "axes", f"{len(sizes)} axes; at most {AXES} are varied")
    elif count > CASES:
        is_possible_space = design == "grid" and count <= DESIGNS
        limit = "are stored whole: give `store: metrics`" if is_possible_space else "are computed"
        yield mistake_at(root, "axes", f"{count} cases; at most {CASES} {limit}")


def level_errors(
    design: str, written_axis: WrittenAxis, values: Sequence[object], labels: Sequence[str], index: int
) -> Iterator[Mistake]:
    """Yield the input errors of the levels and labels of an axis.

    Two levels must not be equal, except in a zip. A label must not be empty, too long, not printable, the label of the
    base, or the label of a different level.

    Parameters
    ----------
    design : str
        Design of the campaign.
    written_axis : WrittenAxis
        The axis as written in the file.
    values, labels : sequence
        Values and labels of its levels.
    index : int
        Index of the axis in the campaign.
    """
    path = f"axes.{index}.{written_axis.key}"
    for number, value in enumerate(values):
        if design != "zip" and value in values[:number]:
            first = values.index(value)
            message = f"the same as level {first} of the axis {quoted(written_axis.axis.path)} (0 is the first)"
            yield mistake(written_axis.levels[number].place, f"{path}.{number}", message)
    place = nearest_place(written_axis.node, ["labels"])
    for label in labels:
        if not label.strip() or len(label) > _LONGEST_LABEL or not label.isprintable():
            message = f"{quoted(label)} is no label: 1 to {_LONGEST_LABEL} printable characters; give labels"
            yield mistake(place, path, message)
        elif design == "one_at_a_time" and label == BASE_LABEL:
            yield mistake(place, path, f"{label!r} is the label of the base; give labels")
    value_by_label = dict(zip(labels, values, strict=True))
    for label, value in zip(labels, values, strict=True):
        if value_by_label[label] != value:
            yield mistake(place, path, "two levels have the same label; give labels")
            return


def equal_case_errors(campaign: Campaign, root: Node) -> Iterator[Mistake]:
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
    for level_indices in case_level_indices(campaign):
        label = case_label(choice(axes, level_indices))
        if label in labels:
            yield mistake_at(root, "axes", f"two cases have the label {quoted(label)}; give other labels")
            return
        labels.add(label)


def narrowing_errors(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the input errors of `when`, `exclude` and `constraints`.

    Unknown axes and levels, invalid expressions, and selections that exclude no case or all cases.
    """
    errors = list(_selection_errors(campaign, root))
    if errors:
        yield from errors
    else:
        yield from _ineffective_selections(campaign, root)
        yield from _ineffective_conditions(campaign, root)


def _selection_errors(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the unknown axes and levels in `when` and `exclude`, and exclusions that name no axis."""
    labels_by_axis = {}
    for name, axis in zip(axis_names(campaign.axes), campaign.axes, strict=True):
        n_level = len(axis.values or ())
        labels_by_axis[name] = [level_label(axis, index) for index in range(n_level)]
    selections = [(f"axes.{k}.when", axis.when) for k, axis in enumerate(campaign.axes)]
    selections += [(f"exclude.{k}", levels) for k, levels in enumerate(campaign.exclude)]
    for path, levels in selections:
        for message in _unknown_levels(levels, labels_by_axis):
            yield mistake_at(root, path, message)
    for k, levels in enumerate(campaign.exclude):
        if not levels:
            yield mistake_at(root, f"exclude.{k}", "names no axis")


def _ineffective_selections(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield each entry of `exclude` and `constraints` that alone excludes no case or all cases, or is not valid."""
    base = campaign.base.model_dump(mode="json")
    all_cases = combinations(campaign.design, campaign.axes, (), (), base)
    for key in ("exclude", "constraints"):
        for k, entry in enumerate(getattr(campaign, key)):
            exclude = (entry,) if key == "exclude" else ()
            constraints = (entry,) if key == "constraints" else ()
            try:
                remaining_cases = combinations(campaign.design, campaign.axes, exclude, constraints, base)
            except ValueError as error:
                yield mistake_at(root, f"{key}.{k}", str(error))
                continue
            if not remaining_cases:
                yield mistake_at(root, f"{key}.{k}", "leaves everything out")
            elif len(remaining_cases) == len(all_cases):
                yield mistake_at(root, f"{key}.{k}", "leaves nothing out")


def _ineffective_conditions(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the axes whose `when` removes no case."""
    unconditional_axes = [axis.model_copy(update={"when": {}}) for axis in campaign.axes]
    n_unconditional = len(combinations(campaign.design, unconditional_axes))
    for k, axis in enumerate(campaign.axes):
        if not axis.when:
            continue
        single_condition_axes = [*unconditional_axes[:k], axis, *unconditional_axes[k + 1 :]]
        n_conditional = len(combinations(campaign.design, single_condition_axes))
        if n_conditional == n_unconditional:
            yield mistake_at(root, f"axes.{k}.when", "no effect: every case has these levels")


def _unknown_levels(
    selected_levels: Mapping[str, str | Sequence[str]], labels_by_axis: Mapping[str, Sequence[str]]
) -> Iterator[str]:
    """Yield a message for each selected axis and level that does not exist."""
    for name, selected_labels in selected_levels.items():
        if name not in labels_by_axis:
            yield f"no axis {quoted(name)}{name_suggestion(name, labels_by_axis)}"
            continue
        known_labels = labels_by_axis[name]
        for label in [selected_labels] if isinstance(selected_labels, str) else selected_labels:
            if label not in (*known_labels, BASE_LABEL):
                yield f"no level {quoted(label)} of the axis {name}{name_suggestion(label, known_labels)}"


def run_selection_errors(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield an input error if the cases selected for all runs are no case or all cases."""
    selected_levels = campaign.monte_carlo.selected if campaign.monte_carlo is not None else {}
    if not selected_levels:
        return
    cases = named_cases(campaign)
    message = unknown_case(selected_levels, cases)
    if message:
        yield mistake_at(root, "monte_carlo.selected", message)
    elif all(case[axis] == level for case in cases for axis, level in selected_levels.items()):
        yield mistake_at(root, "monte_carlo.selected", "no effect: every case has these levels")
