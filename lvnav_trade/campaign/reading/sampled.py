"""Design spaces: the ends of the axes are read and checked; the designs follow from a rule when they are computed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.campaign.definition.schema import Axis, Campaign, SpaceDefinition
from lvnav_trade.campaign.reading.spaced import (
    SAMPLED,
    AxisEnds,
    expand_axis,
    interpolate,
    parse_ends,
    points,
    with_values,
)
from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.tree import Node, find, mistake_at, refuse
from lvnav_trade.quantities.errors import InputError, Mistake, quoted
from lvnav_trade.quantities.input_limits import CASES, DESIGNS
from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.statistics.display_units import split_quantity

ROWS = ("metrics", "events")
"""Values of `store` with one row per design."""
_RULES = ("grid", *SAMPLED[:2])


class Rule(NamedTuple):
    """Rule by which the designs of a campaign follow from its axes.

    store : Data stored for each design, one of `ROWS`.
    design : Design as written in the campaign.
    samples : Number of points; None for a grid.
    ends : For each axis the limits of the samples and whether these are equally spaced in the logarithm; None for an
        axis of levels.
    """

    store: str
    design: str
    samples: int | None
    ends: tuple[tuple[AxisEnds, bool] | None, ...]


def read_rule(root: Node) -> tuple[Rule | None, Node]:
    """Return the rule of a design space, and the tree of a campaign of the ends of its axes.

    A campaign is a design space if its setting `store` says so, or if it has more cases than can be stored completely.

    Parameters
    ----------
    root : Node
        Tree of the campaign.

    Returns
    -------
    Rule or None, Node
        The rule, and the tree with the two ends of every axis as levels, varied one at a time. For other campaigns
        None and the tree unchanged.

    Raises
    ------
    InputError
        The rule has an input error.
    """
    axes = find(root, ["axes"])
    store = _text(root, "store")
    design = _text(root, "design") or "grid"
    if store in ROWS and (axes is None or not axes.value):
        message = f"{store}: no effect: the campaign has no axes, so that its one case is stored whole"
        raise InputError(records=[mistake_at(root, "store", message)])
    if axes is None or not axes.is_list or store not in ("", *ROWS):
        return None, root
    if design not in _RULES:
        if store in ROWS:
            raise InputError(records=[mistake_at(root, "store", f"{store}: of the designs {', '.join(_RULES)}")])
        return None, root
    samples_node = find(root, ["samples"])
    samples = samples_node.value if samples_node is not None else None
    exceeds_cases = isinstance(samples, int) and not isinstance(samples, bool) and samples > CASES
    if not store and design != "grid" and not exceeds_cases:
        return None, root
    end_axes, ends = [], []
    for index, axis in enumerate(axes.value):
        end_axis, axis_ends = _ends(axis, index, design)
        end_axes.append(end_axis)
        ends.append(axis_ends)
    grid_size = math.prod(_level_count(axis) for axis in end_axes)
    if not store and design == "grid" and grid_size <= CASES:
        return None, root
    _check_count(root, design, samples, grid_size)
    rule = Rule(
        store=store or ROWS[0],
        design=design,
        samples=samples if design != "grid" else None,
        ends=tuple(ends),
    )
    place = axes.place
    root = tree.with_child(root, "axes", Node(end_axes, place), root.keys["axes"])
    root = tree.with_node(root, ["design"], Node("one_at_a_time", place))
    if samples_node is not None:
        root = tree.with_node(root, ["samples"], Node(None, place))
    return rule, root


def _text(root: Node, key: str) -> str:
    node = find(root, [key])
    return str(node.value) if node is not None and node.value is not None else ""


def _level_count(axis: Node) -> int:
    """Return the number of levels of an axis with a list of levels; 1 if the list cannot be read."""
    for key in ("values", "cards"):
        levels = find(axis, [key])
        if levels is not None and levels.is_list:
            return max(1, len(levels.value))
    return 1


def _check_count(root: Node, design: str, samples: Any, grid_size: int) -> None:
    """Refuse a number of samples or of combinations that is not possible for a design.

    Parameters
    ----------
    root : Node
        Tree of the campaign, for the place of the error.
    design : str
        Design of the campaign.
    samples : Any
        Number of samples as written; None if it is not given.
    grid_size : int
        Number of combinations of a grid.

    Raises
    ------
    InputError
        The number is not possible.
    """
    if design == "grid":
        if samples is not None:
            message = f"no effect: of the designs {' and '.join(_RULES[1:])} only"
            raise InputError(records=[mistake_at(root, "samples", message)])
        if grid_size > DESIGNS:
            message = f"{grid_size} cases; at most {DESIGNS} are computed"
            raise InputError(records=[mistake_at(root, "axes", message)])
        return
    if isinstance(samples, bool) or not isinstance(samples, int) or not 2 <= samples <= DESIGNS:
        message = f"{quoted(samples)} is no count; a whole number from 2 to {DESIGNS}"
        raise InputError(records=[mistake_at(root, "samples", message)])
    try:
        points(design, 1, samples, 0)
    except ValueError as error:
        raise InputError(records=[mistake_at(root, "samples", str(error))]) from None


def _ends(axis: Node, index: int, design: str) -> tuple[Node, tuple[AxisEnds, bool] | None]:
    """Return an axis with its limits or levels as a list, and the limits if it is sampled between them."""
    limits = find(axis, ["between"]) if axis.is_map else None
    if limits is None or limits.value is None or design == "grid":
        return expand_axis(axis, index), None
    log = find(axis, ["log"])
    is_log = bool(log is not None and log.value)
    try:
        limit_values = tree.plain_data(limits)
        if not isinstance(limit_values, list) or len(limit_values) != 2:
            raise ValueError("should be [least, largest]")
        ends = parse_ends(limit_values)._replace(is_integer=False)
        values = interpolate(np.array([0.0, 1.0]), ends, is_log)
    except ValueError as error:
        raise refuse(limits.place, f"axes.{index}.between", str(error)) from None
    texts = [ends.text(float(value)) for value in values]
    end_axis = with_values(axis, "between", texts)
    return end_axis, (ends, is_log)


def with_designs(ends_campaign: Campaign, rule: Rule) -> Campaign:
    """Return the design space of a rule from the campaign of the ends of its axes, which becomes its `probe`.

    Every sampled axis has one value per sample, in SI, and a label in the unit of the campaign file. The axes of a grid
    have their levels.
    """
    update: dict[str, Any] = {"design": rule.design, "samples": rule.samples, "store": rule.store}
    axes = tuple(ends_campaign.axes)
    if rule.samples is not None:
        unit_cube = points(rule.design, len(axes), rule.samples, ends_campaign.seed)
        coordinates = zip(axes, rule.ends, unit_cube.T, strict=True)
        update["axes"] = tuple(_sampled_axis(axis, ends, coordinate) for axis, ends, coordinate in coordinates)
    space = ends_campaign.model_copy(update=update)
    unconditional_axes = tuple(axis.model_copy(update={"when": {}}) for axis in axes)
    probe = ends_campaign.model_copy(update={"exclude": (), "constraints": (), "axes": unconditional_axes})
    rule_axes = []
    for axis, ends in zip(axes, rule.ends, strict=True):
        rule_axis = axis if ends is None else axis.model_copy(update=_written_fields(ends))
        rule_axes.append(rule_axis)
    space._space_definition = SpaceDefinition(tuple(rule_axes), probe)
    return space


def _written_fields(ends: tuple[AxisEnds, bool]) -> dict[str, Any]:
    """Return the fields of a sampled axis as written in the campaign file."""
    limits, is_log = ends
    return {
        "between": (limits.text(limits.first), limits.text(limits.last)),
        "log": is_log,
        "values": None,
        "labels": None,
    }


def _sampled_axis(axis: Axis, ends: tuple[AxisEnds, bool] | None, coordinate: Floats) -> Axis:
    """Return an axis with one value per sample.

    Parameters
    ----------
    axis : Axis
        Axis with its levels, or with the two limits as levels.
    ends : (AxisEnds, bool), optional
        Limits in the unit of the campaign file, and whether the axis is logarithmic; None if levels are sampled.
    coordinate : (n,) array
        Coordinates of the samples in the unit interval.
    """
    values: list[Any]
    labels: list[str]
    if ends is None:
        all_values = axis.values or ()
        all_labels = axis.labels or ()
        n_level = len(all_values)
        levels = np.minimum((coordinate * n_level).astype(int), n_level - 1).tolist()
        values = [all_values[level] for level in levels]
        labels = [all_labels[level] for level in levels]
    else:
        limits, is_log = ends
        values = interpolate(coordinate, limits, is_log).tolist()
        labels = [f"{value:.6g} {limits.unit}".rstrip() for value in values]
        lower_limit, upper_limit = axis.values or (0.0, 1.0)
        lower_limit_si = split_quantity(lower_limit)
        upper_limit_si = split_quantity(upper_limit)
        if lower_limit_si is not None and upper_limit_si is not None:  # quantities, not numbers without a unit
            unit = lower_limit_si[1]
            limits_si = AxisEnds(lower_limit_si[0], upper_limit_si[0], unit, False)
            values_si = interpolate(coordinate, limits_si, is_log).tolist()
            values = [f"{value!r} {unit}" for value in values_si]
    return axis.model_copy(update={"values": tuple(values), "labels": tuple(labels)})


def run_choice_errors(campaign: Campaign, root: Node) -> Iterator[Mistake]:
    """Yield the settings of `monte_carlo` that select cases and have no effect on this campaign.

    A design space ignores `selected`; other campaigns ignore `cases` and `most_cases`.
    """
    card = campaign.monte_carlo
    if card is None:
        return
    if campaign.is_space:
        if card.selected:
            yield mistake_at(root, "monte_carlo.selected", "of many designs `cases` says which have runs")
        return
    for name in ("cases", "most_cases"):
        if getattr(card, name) is not None:
            message = f"no effect: each case is stored whole and has runs; give `store: {ROWS[0]}` or `selected`"
            yield mistake_at(root, f"monte_carlo.{name}", message)
