"""Conversion of axes (linspace, logspace, range, samples between limits) to lists of values."""

import math
import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.tree import Node, find, mistake_at, refuse
from lvnav_trade.quantities.errors import InputError, Mistake, quoted
from lvnav_trade.quantities.input_files import DECIMAL
from lvnav_trade.quantities.input_limits import CASES, DESIGNS
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import with_ascii_minus

SAMPLED = ("latin_hypercube", "sobol", "box_behnken")
_QUANTITY = re.compile(rf"({DECIMAL})(?: (\S+))?")
_DIGITS = 10
_LEVELS = ("cards", "values")


class AxisEnds(NamedTuple):
    """Ends of an axis."""

    first: float  # first value, in `unit`
    last: float  # last value, in `unit`
    unit: str  # unit of both; empty for numbers without unit
    is_integer: bool  # whether both are whole numbers

    def text(self, value: float) -> Any:
        """Return a value as written in a campaign: a quantity with the unit, or a number."""
        if self.unit:
            return f"{value:.{_DIGITS}g} {self.unit}"
        if self.is_integer and math.isclose(value, round(value)):
            return round(value)
        return float(f"{value:.{_DIGITS}g}")


def expand_axes(root: Node) -> tuple[Node, list[Mistake]]:
    """Return the campaign's tree with a list of values in every axis, and the input errors.

    A sampled design becomes a zip of its points.
    """
    node = find(root, ["axes"])
    if node is None or not node.is_list:
        return root, []
    design_node = find(root, ["design"])
    design = str(design_node.value) if design_node is not None else "grid"
    axes = list(node.value)
    mistakes: list[Mistake] = []
    try:
        if design in SAMPLED:
            axes = _sampled_axes(root, design, axes)
            root = tree.with_node(root, ["design"], Node("zip", node.place))
            root = tree.without_key(root, "samples")
        else:
            samples = find(root, ["samples"])
            if samples is not None and samples.value is not None:
                message = f"no effect: of the designs {' and '.join(SAMPLED[:2])} only"
                raise refuse(samples.place, "samples", message)
            axes = [expand_axis(axis, index) for index, axis in enumerate(axes)]
    except InputError as error:
        mistakes += error.records
    complete_root = tree.with_child(root, "axes", Node(axes, node.place), root.keys["axes"])
    return complete_root, mistakes


def expand_axis(axis: Node, index: int) -> Node:
    """Return an axis with linspace, logspace or range replaced by a list of values.

    Parameters
    ----------
    axis : Node
        Axis as written.
    index : int
        Index of the axis in the campaign, for messages.

    Raises
    ------
    InputError
        The rule is not valid, or `between` is given without a sampled design.
    """
    if not axis.is_map:
        return axis
    has_levels = any(key in axis.value and axis.value[key].value is not None for key in _LEVELS)
    if not has_levels:
        for key, make_values in _RULES.items():
            rule = find(axis, [key])
            if rule is not None and rule.value is not None:
                return _with_rule_values(axis, index, key, rule, make_values)
    limits = find(axis, ["between"])
    if limits is not None and limits.value is not None:
        raise refuse(axis.place, f"axes.{index}.between", f"needs a sampled design: {', '.join(SAMPLED)}")
    return axis


def _with_rule_values(
    axis: Node, index: int, key: str, rule: Node, make_values: Callable[[Sequence[Any], AxisEnds], Floats]
) -> Node:
    """Return an axis with the values of a rule, such as ``linspace: [first, last, count]``.

    Parameters
    ----------
    axis : Node
        Axis as written.
    index : int
        Index of the axis in the campaign.
    key : str
        Name of the rule.
    rule : Node
        The three numbers of the rule.
    make_values : callable
        Function of the numbers and the ends of the axis, which returns the values (n,) in the unit of the ends.

    Raises
    ------
    InputError
        The rule is not valid.
    """
    try:
        numbers = tree.plain_data(rule)
        if not isinstance(numbers, list) or len(numbers) != 3:
            raise ValueError(f"should be [first, last, {'step' if key == 'range' else 'count'}]")
        ends = parse_ends(numbers[:2])
        values = make_values(numbers, ends)
    except ValueError as error:
        raise refuse(rule.place, f"axes.{index}.{key}", str(error)) from None
    return with_values(axis, key, [ends.text(float(value)) for value in values])


def with_values(axis: Node, key: str, values: Sequence[Any]) -> Node:
    """Return an axis with a list of values in place of the rule `key`, such as linspace."""
    place = axis.keys[key]
    children = Node([Node(value, place) for value in values], place)
    axis = tree.without_key(axis, key)
    if "log" in axis.value:
        axis = tree.without_key(axis, "log")
    return tree.with_child(axis, "values", children, place)


def parse_ends(limits: Sequence[Any]) -> AxisEnds:
    """Return the ends of an axis; ValueError unless they are two numbers or two quantities in the same unit."""
    first, last = (_quantity(end) for end in limits[:2])
    if first is None or last is None:
        raise ValueError("should begin and end with numbers, or quantities such as '0.1 deg'")
    (first_number, first_unit), (last_number, last_unit) = first, last
    if first_unit != last_unit:
        raise ValueError("begins and ends in different units; write both in one")
    if not math.isfinite(first_number) or not math.isfinite(last_number):
        raise ValueError("should begin and end with numbers that are not beyond all bounds")
    if first_number == last_number:
        raise ValueError("begins where it ends")
    return AxisEnds(first_number, last_number, first_unit, is_integer=all(isinstance(end, int) for end in limits))


def _quantity(value: Any) -> tuple[float, str] | None:
    """Return number and unit of a number or quantity; None for anything else."""
    match = None if isinstance(value, bool) else _QUANTITY.fullmatch(with_ascii_minus(str(value)))
    return None if match is None else (float(match[1]), match[2] or "")


def _count(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 2 <= value <= CASES:
        raise ValueError(f"{quoted(value)} is no count; a whole number from 2 to {CASES}")
    return value


def _linspace(numbers: Sequence[Any], ends: AxisEnds) -> Floats:
    return np.linspace(ends.first, ends.last, _count(numbers[2]))


def _logspace(numbers: Sequence[Any], ends: AxisEnds) -> Floats:
    return interpolate(np.linspace(0.0, 1.0, _count(numbers[2])), ends, is_log=True)


def _range(numbers: Sequence[Any], ends: AxisEnds) -> Floats:
    quantity = _quantity(numbers[2])
    if quantity is None or quantity[1] != ends.unit:
        unit = f" ({ends.unit})" if ends.unit else ""
        raise ValueError(f"needs a step in the unit of its ends{unit}")
    step, _ = quantity
    length = ends.last - ends.first
    if not math.isfinite(step) or step == 0.0 or length / step < 0.0:
        raise ValueError("a step that leads away from its last value")
    steps = length / step * (1.0 + 1e-12)  # so that rounding does not lose the last value
    if not 1.0 <= steps < CASES:
        n_value = math.floor(min(steps, 1e9)) + 1
        raise ValueError(f"{n_value} values; from 2 to {CASES} are possible")
    count = math.floor(steps) + 1
    return np.asarray(ends.first + step * np.arange(count))


_RULES: dict[str, Callable[[Sequence[Any], AxisEnds], Floats]] = {
    "linspace": _linspace,
    "logspace": _logspace,
    "range": _range,
}


def interpolate(fraction: Floats, ends: AxisEnds, is_log: bool) -> Floats:
    """Return the values at fractions of the interval between the ends, or of its logarithm.

    Parameters
    ----------
    fraction : (n,) array
        Fractions between 0 and 1.
    ends : AxisEnds
        Ends of the interval.
    is_log : bool
        Whether the fractions are those of the logarithm.

    Returns
    -------
    (n,) array
        Values, in the unit of the ends.

    Raises
    ------
    ValueError
        An end of a logarithmic interval is not above zero.
    """
    if not is_log:
        return ends.first + fraction * (ends.last - ends.first)
    if min(ends.first, ends.last) <= 0.0:
        raise ValueError("a logarithm needs ends above zero")
    return np.asarray(ends.first * (ends.last / ends.first) ** fraction)


# --- samples ----------------------------------------------------------------------------------------------------------


def points(design: str, dimensions: int, count: int, seed: int) -> Floats:
    """Return the points of a design in the unit cube.

    Parameters
    ----------
    design : str
        ``latin_hypercube``, ``sobol`` (scrambled) or ``box_behnken``.
    dimensions : int
        Number of axes.
    count : int
        Number of points: a power of two for Sobol, not used for Box-Behnken.
    seed : int
        Seed of the random design.

    Returns
    -------
    (n, dimensions) array
        Coordinates between 0 and 1.

    Raises
    ------
    ValueError
        There is no such design.
    """
    if design == "box_behnken":
        return _box_behnken(dimensions)
    from scipy.stats import qmc  # half a second of every process, for few campaigns

    if design == "sobol":
        is_power_of_two = count & (count - 1) == 0
        if not is_power_of_two:
            next_power = 2 ** count.bit_length()
            raise ValueError(f"{count} samples; Sobol's sequence is even for a power of two, such as {next_power}")
        sequence = qmc.Sobol(dimensions, scramble=True, seed=seed)
        exponent = count.bit_length() - 1
        return np.asarray(sequence.random_base2(exponent))
    hypercube = qmc.LatinHypercube(dimensions, seed=seed)
    return np.asarray(hypercube.random(count))


def _box_behnken(dimensions: int) -> Floats:
    """Return the centre, and every pair of axes at both ends with the others in the middle."""
    if dimensions < 3:
        raise ValueError("Box-Behnken needs three axes or more")
    centre = np.full(dimensions, 0.5)
    design = [centre]
    for i in range(dimensions):
        for j in range(i + 1, dimensions):
            for pair in ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)):
                point = centre.copy()
                point[[i, j]] = pair
                design.append(point)
    return np.array(design)


def _sampled_axes(root: Node, design: str, axes: Sequence[Node]) -> list[Node]:
    """Return the axes with one value per point of a sampled design."""
    samples = find(root, ["samples"])
    seed = find(root, ["seed"])
    try:
        if design == "box_behnken" and samples is not None:
            raise ValueError("no effect: the number of axes decides how many points a Box-Behnken design has")
        sample_count = samples.value if samples is not None else None
        if isinstance(sample_count, int) and CASES < sample_count <= DESIGNS:
            raise ValueError(f"{sample_count} cases; at most {CASES} are stored whole: give `store: metrics`")
        count = 2 if design == "box_behnken" else _count(sample_count)
        seed_number = seed.value if seed is not None and isinstance(seed.value, int) else 0
        unit_cube = points(design, len(axes), count, seed_number)
    except ValueError as error:
        raise InputError(records=[mistake_at(root, "samples", str(error))]) from None
    sampled_axes = []
    for index, axis in enumerate(axes):
        coordinates = unit_cube[:, index]
        sampled_axes.append(_sampled_axis(axis, index, coordinates))
    return sampled_axes


def _sampled_axis(axis: Node, index: int, fraction: Floats) -> Node:
    """Return an axis with one value per sample, at fractions (n,) of its interval or of its levels."""
    if not axis.is_map:
        return axis
    limits_node = find(axis, ["between"])
    if limits_node is not None and limits_node.value is not None:
        log = find(axis, ["log"])
        try:
            limits = tree.plain_data(limits_node)
            if not isinstance(limits, list) or len(limits) != 2:
                raise ValueError("should be [least, largest]")
            ends = parse_ends(limits)._replace(is_integer=False)
            is_log = bool(log is not None and log.value)
            values = interpolate(fraction, ends, is_log)
        except ValueError as error:
            raise refuse(limits_node.place, f"axes.{index}.between", str(error)) from None
        texts = [ends.text(float(value)) for value in values]
        return with_values(axis, "between", texts)
    axis = expand_axis(axis, index)
    key = "cards" if "cards" in axis.value else "values"
    levels = axis.value.get(key)
    if levels is None or not levels.is_list or not levels.value:
        return axis
    n_levels = len(levels.value)
    level_indices = np.minimum((fraction * n_levels).astype(int), n_levels - 1)
    sampled_levels = Node([levels.value[k] for k in level_indices], levels.place)
    sampled_axis = tree.with_child(axis, key, sampled_levels, axis.keys[key])
    labels = find(axis, ["labels"])
    if labels is None or not labels.is_list or len(labels.value) != n_levels:
        return sampled_axis
    sampled_labels = Node([labels.value[k] for k in level_indices], labels.place)
    return tree.with_child(sampled_axis, "labels", sampled_labels, axis.keys["labels"])
