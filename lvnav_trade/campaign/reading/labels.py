"""Axes that would make a label wrong: one that replaces what another varies, levels or labels that are equal."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from lvnav_trade.campaign.definition import axes as design
from lvnav_trade.campaign.definition.axes import BASE_LABEL
from lvnav_trade.campaign.definition.schema import Axis
from lvnav_trade.campaign.syntax.tree import Node, mistake, nearest
from lvnav_trade.errors import Mistake, quoted
from lvnav_trade.limits import AXES, CASES

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
            if is_same or (kind != "one_at_a_time" and axis.steps[: len(above.steps)] == above.steps):
                what = "varies the same field" if is_same else "replaces it; put that axis first"
                message = f"{quoted(axis.path)}: the later axis {quoted(above.path)} {what}"
                yield mistake(nearest(node, ["path"]), f"axes.{number}.path", message)


def too_many(kind: str, sizes: Sequence[int], node: Node) -> Iterator[Mistake]:
    """Yield a mistake where a design of axes of these sizes has more cases than are computed; `node` is the axes'."""
    if len(sizes) > AXES:
        yield mistake(node.place, "axes", f"{len(sizes)} axes; at most {AXES} are varied")
        return
    count = {"grid": math.prod(sizes), "zip": max(sizes, default=1)}.get(kind, 1 + sum(sizes))
    if count > CASES:
        yield mistake(node.place, "axes", f"{count} cases; at most {CASES} are computed")


def equal_levels(
    kind: str, axis: Axis, values: Sequence[object], nodes: Sequence[Node], path: str
) -> Iterator[Mistake]:
    """Yield the levels whose whole value is that of an earlier one, as only the axes of a zip may have them."""
    for index, value in enumerate(values):
        if kind != "zip" and value in values[:index]:
            message = f"the same as level {values.index(value)} of the axis {quoted(axis.path)} (0 is the first)"
            yield mistake(nodes[index].place, f"{path}.{index}", message)


def bad_labels(kind: str, labels: Sequence[str], node: Node, path: str) -> Iterator[Mistake]:
    """Yield the labels that are no labels: empty, too long, not printable, or that of the base."""
    place = nearest(node, ["labels"])
    for label in labels:
        if not label.strip() or len(label) > _LONGEST or not label.isprintable():
            message = f"{quoted(label)} is no label: 1 to {_LONGEST} printable characters; give labels"
            yield mistake(place, path, message)
        elif kind == "one_at_a_time" and label == BASE_LABEL:
            yield mistake(place, path, f"{label!r} is the label of the base; give labels")
    if len(set(labels)) < len(labels):
        yield mistake(place, path, "two levels have the same label; give labels")


def equal_cases(kind: str, axes: Sequence[Axis], node: Node) -> Iterator[Mistake]:
    """Yield a mistake where two cases of a design have the same label, or two pairs of a zip are equal; `node` is that
    of the axes.
    """
    sizes = [len(axis.values or ()) for axis in axes]
    pairs = list(zip(*(axis.values or () for axis in axes), strict=True)) if kind == "zip" else []
    for index, pair in enumerate(pairs):
        if pair in pairs[:index]:
            message = f"level {index} of every axis is the same as level {pairs.index(pair)} (0 is the first)"
            yield mistake(node.place, "axes", message)
    seen: set[str] = set()
    for chosen in design.levels(kind, sizes):
        label = design.case_label(design.choice(axes, chosen))
        if label in seen:
            yield mistake(node.place, "axes", f"two cases have the label {quoted(label)}; give other labels")
            return
        seen.add(label)
