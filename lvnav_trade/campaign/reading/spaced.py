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

    first: float
    last: float
    unit: str  # of both; empty for numbers without unit
    whole: bool  # whether both are whole numbers

    def text(self, value: float) -> Any:
        """Return a value as written in a campaign: a quantity with the unit, or a number."""
        if self.unit:
            return f"{value:.{_DIGITS}g} {self.unit}"
        return round(value) if self.whole and math.isclose(value, round(value)) else float(f"{value:.{_DIGITS}g}")


def spaced(root: Node) -> tuple[Node, list[Mistake]]:
    """Return the campaign's tree with a list of values in every axis, and the input errors.

    A sampled design becomes a zip of its points.
    """
    node = find(root, ["axes"])
    design = find(root, ["design"])
    kind = str(design.value) if design is not None else "grid"
    if node is None or not node.is_list:
        return root, []
    axes, mistakes = list(node.value), list[Mistake]()
    try:
        if kind in SAMPLED:
            axes = _sampled(root, kind, axes)
            root = tree.without(tree.put(root, ["design"], Node("zip", node.place)), "samples")
        else:
            if (count := find(root, ["samples"])) is not None and count.value is not None:
                raise refuse(count.place, "samples", f"no effect: of the designs {' and '.join(SAMPLED[:2])} only")
            axes = [written(axis, index) for index, axis in enumerate(axes)]
    except InputError as error:
        mistakes += error.records
    return tree.with_child(root, "axes", Node(axes, node.place), root.keys["axes"]), mistakes


def written(axis: Node, index: int) -> Node:
    """Return an axis with linspace, logspace or range replaced by a list of values; InputError if it is not valid."""
    made: dict[str, Callable[[Sequence[Any], AxisEnds], Floats]] = {
        "linspace": _linspace,
        "logspace": _logspace,
        "range": _range,
    }
    stated_too = axis.is_map and any(key in axis.value and axis.value[key].value is not None for key in _LEVELS)
    for key, make in made.items() if not stated_too else ():
        if axis.is_map and (stated := find(axis, [key])) is not None and stated.value is not None:
            path = f"axes.{index}.{key}"
            try:
                parts = tree.plain(stated)
                if not isinstance(parts, list) or len(parts) != 3:
                    raise ValueError(f"should be [first, last, {'step' if key == 'range' else 'count'}]")
                ends = ends_of(parts[:2])
                values = make(parts, ends)
            except ValueError as error:
                raise refuse(stated.place, path, str(error)) from None
            return with_values(axis, key, [ends.text(float(value)) for value in values])
    if axis.is_map and (limits := find(axis, ["between"])) is not None and limits.value is not None:
        raise refuse(axis.place, f"axes.{index}.between", f"needs a sampled design: {', '.join(SAMPLED)}")
    return axis


def with_values(axis: Node, key: str, values: Sequence[Any]) -> Node:
    """Return an axis with a list of values in place of the rule `key`, such as linspace."""
    place = axis.keys[key]
    children = Node([Node(value, place) for value in values], place)
    for name in (key, "log"):
        axis = tree.without(axis, name) if name in axis.value else axis
    return tree.with_child(axis, "values", children, place)


def ends_of(parts: Sequence[Any]) -> AxisEnds:
    """Return the ends of an axis; ValueError unless they are two numbers or two quantities in the same unit."""
    first, last = (
        _QUANTITY.fullmatch(with_ascii_minus(str(end))) if not isinstance(end, bool) else None for end in parts[:2]
    )
    if first is None or last is None:
        raise ValueError("should begin and end with numbers, or quantities such as '0.1 deg'")
    if first[2] != last[2]:
        raise ValueError("begins and ends in different units; write both in one")
    whole = all(isinstance(end, int) for end in parts)
    ends = AxisEnds(float(first[1]), float(last[1]), first[2] or "", whole)
    if not all(map(math.isfinite, ends[:2])):
        raise ValueError("should begin and end with numbers that are not beyond all bounds")
    if ends.first == ends.last:
        raise ValueError("begins where it ends")
    return ends


def _count(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 2 <= value <= CASES:
        raise ValueError(f"{quoted(value)} is no count; a whole number from 2 to {CASES}")
    return value


def _linspace(parts: Sequence[Any], ends: AxisEnds) -> Floats:
    return np.linspace(ends.first, ends.last, _count(parts[2]))


def _logspace(parts: Sequence[Any], ends: AxisEnds) -> Floats:
    return between(np.linspace(0.0, 1.0, _count(parts[2])), ends, log=True)


def _range(parts: Sequence[Any], ends: AxisEnds) -> Floats:
    read = _QUANTITY.fullmatch(with_ascii_minus(str(parts[2]))) if not isinstance(parts[2], bool) else None
    if read is None or (read[2] or "") != ends.unit:
        raise ValueError(f"needs a step in the unit of its ends{f' ({ends.unit})' if ends.unit else ''}")
    step = float(read[1])
    if not math.isfinite(step) or step == 0.0 or (ends.last - ends.first) / step < 0.0:
        raise ValueError("a step that leads away from its last value")
    steps = (ends.last - ends.first) / step * (1.0 + 1e-12)  # so that rounding does not lose the last value
    if not 1.0 <= steps < CASES:
        raise ValueError(f"{math.floor(min(steps, 1e9)) + 1} values; from 2 to {CASES} are possible")
    count = math.floor(steps) + 1
    return np.asarray(ends.first + step * np.arange(count))


def between(part: Floats, ends: AxisEnds, log: bool) -> Floats:
    """Return the values at fractions `part` (n,) of the interval between the ends, or of its logarithm."""
    if not log:
        return ends.first + part * (ends.last - ends.first)
    if min(ends.first, ends.last) <= 0.0:
        raise ValueError("a logarithm needs ends above zero")
    return np.asarray(ends.first * (ends.last / ends.first) ** part)


# --- samples ----------------------------------------------------------------------------------------------------------


def points(kind: str, dimensions: int, count: int, seed: int) -> Floats:
    """Return the points (n, dimensions) of a design in the unit cube: a Latin hypercube, a scrambled Sobol sequence
    (`count` a power of two), or Box and Behnken's (count is not used: every pair of axes at both ends, the others in
    the middle, and the centre once).

    ValueError where there is no such design.
    """
    if kind == "box_behnken":
        if dimensions < 3:
            raise ValueError("Box-Behnken needs three axes or more")
        found = [np.full(dimensions, 0.5)]
        for i in range(dimensions):
            for j in range(i + 1, dimensions):
                for a, b in ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)):
                    point = np.full(dimensions, 0.5)
                    point[[i, j]] = a, b
                    found.append(point)
        return np.array(found)
    from scipy.stats import qmc  # half a second of every process, for few campaigns

    if kind == "sobol":
        if count & (count - 1):
            raise ValueError(
                f"{count} samples; Sobol's sequence is even for a power of two, such as {2 ** (count.bit_length())}"
            )
        return np.asarray(qmc.Sobol(dimensions, scramble=True, seed=seed).random_base2(count.bit_length() - 1))
    return np.asarray(qmc.LatinHypercube(dimensions, seed=seed).random(count))


def _sampled(root: Node, kind: str, axes: Sequence[Node]) -> list[Node]:
    """Return the axes with one value per point of a sampled design."""
    stated, seed = find(root, ["samples"]), find(root, ["seed"])
    try:
        if kind == "box_behnken" and stated is not None:
            raise ValueError("no effect: the number of axes decides how many points a Box-Behnken design has")
        wanted = stated.value if stated is not None else None
        if isinstance(wanted, int) and CASES < wanted <= DESIGNS:
            raise ValueError(f"{wanted} cases; at most {CASES} are stored whole: give `store: metrics`")
        count = 2 if kind == "box_behnken" else _count(wanted)
        number = seed.value if seed is not None and isinstance(seed.value, int) else 0
        found = points(kind, len(axes), count, number)
    except ValueError as error:
        raise InputError(records=[mistake_at(root, "samples", str(error))]) from None
    return [_drawn(axis, index, found[:, index]) for index, axis in enumerate(axes)]


def _drawn(axis: Node, index: int, part: Floats) -> Node:
    """Return an axis with one value per sample, at the fractions `part` (n,) of its interval or of its levels."""
    if not axis.is_map:
        return axis
    log = find(axis, ["log"])
    if (stated := find(axis, ["between"])) is not None and stated.value is not None:
        try:
            limits = tree.plain(stated)
            if not isinstance(limits, list) or len(limits) != 2:
                raise ValueError("should be [least, largest]")
            ends = ends_of(limits)._replace(whole=False)
            values = between(part, ends, bool(log is not None and log.value))
        except ValueError as error:
            raise refuse(stated.place, f"axes.{index}.between", str(error)) from None
        return with_values(axis, "between", [ends.text(float(value)) for value in values])
    axis = written(axis, index)
    key = "cards" if "cards" in axis.value else "values"
    levels = axis.value.get(key)
    if levels is None or not levels.is_list or not levels.value:
        return axis
    at = np.minimum((part * len(levels.value)).astype(int), len(levels.value) - 1)
    chosen = tree.with_child(axis, key, Node([levels.value[k] for k in at], levels.place), axis.keys[key])
    labels = find(axis, ["labels"])
    if labels is None or not labels.is_list or len(labels.value) != len(levels.value):
        return chosen
    return tree.with_child(chosen, "labels", Node([labels.value[k] for k in at], labels.place), axis.keys["labels"])
