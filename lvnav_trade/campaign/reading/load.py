"""From a YAML file to a checked campaign: every mistake found at once, each in one line."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from lvnav_trade.campaign.definition import axes as design
from lvnav_trade.campaign.definition.schema import Axis, Campaign
from lvnav_trade.campaign.reading import checks, labels, statements
from lvnav_trade.campaign.reading.expand import Expander
from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.reading.overrides import apply
from lvnav_trade.campaign.reading.sets import splice
from lvnav_trade.campaign.syntax import fields, tree
from lvnav_trade.campaign.syntax.cards import Shelf, campaign_file
from lvnav_trade.campaign.syntax.tree import Node, mistake
from lvnav_trade.errors import InputError, Mistake, quoted
from lvnav_trade.scenario import Scenario


def load(file: str | Path, sets: Sequence[str] = ()) -> Campaign:
    """Return the campaign of a file with cards expanded and all defaults filled in.

    Parameters
    ----------
    file : path, or the name of a campaign that comes with the tool
    sets : assignments such as ``monte_carlo.runs=500`` laid on top; where one changes an axis, statements on levels
        that are gone are left out

    Raises
    ------
    InputError
        With a record for every mistake; nothing has been computed.
    """
    path = campaign_file(str(file))
    root = tree.read_mapping(path)
    shelf = Shelf.of(path.resolve().parent)
    for assignment in sets:
        root = apply(root, assignment, shelf)
    changed = any(assignment.strip().startswith("axes") for assignment in sets)
    return _Loader(root, shelf, changed).campaign()


def resolved(campaign: Campaign) -> str:
    """Return the campaign as YAML, all defaults filled in; `load` reads it back to the same campaign."""
    return tree.dump(campaign.model_dump(mode="json", exclude_none=False))


class _Loader:
    """Turns one tree into a campaign; collects mistakes instead of stopping at the first."""

    def __init__(self, root: Node, shelf: Shelf, narrowed: bool = False) -> None:
        self.root = root
        self.shelf = shelf
        self.narrowed = narrowed
        self.mistakes: list[Mistake] = []

    def campaign(self) -> Campaign:
        """Return the campaign or raise all mistakes."""
        axes = self._axes()
        self._bounded(axes)
        self.root, in_sets = splice(self.root, self.shelf)
        self.mistakes.extend(in_sets)
        self._refuse_unused(axes)
        root = self._with_base_from(axes)
        expander = Expander(self.shelf)
        root = expander.expand(root, Campaign, "")
        self.mistakes.extend(expander.mistakes)
        found = self._validate(root, Campaign, "")
        base = root.value["base"]
        levels = [self._levels(base, *axis, index) for index, axis in enumerate(axes) if base.is_map]
        self._raise()
        assert isinstance(found, Campaign)
        whole_axes = [
            self._resolved(found, axis, values, index)
            for index, (axis, values) in enumerate(zip(axes, levels, strict=True))
        ]
        whole = found.model_copy(update={"axes": tuple(whole_axes)})
        self._check_cases(whole, base, axes, levels)
        self._raise()
        self.mistakes.extend(checks.requirements(whole, root))
        if axes:
            self.mistakes.extend(labels.equal_cases(whole.design, whole.axes, self.root.value["axes"]))
        if self.narrowed:
            whole = statements.narrowed(whole)
        self.mistakes.extend(statements.mistakes(whole, root))
        self._raise()
        whole._written = tree.Written(root)
        return whole

    def _raise(self) -> None:
        unique = sorted(dict.fromkeys(self.mistakes), key=lambda record: (record.file, record.line, record.column))
        if unique:
            raise InputError(records=unique)

    def _validate(self, node: Node, model: type[BaseModel], path: str) -> BaseModel | None:
        """Return the model of an expanded tree; its mistakes are noted, save where expansion already found one."""
        try:
            return model.model_validate(tree.plain(node))
        except ValidationError as error:
            known = [record.path for record in self.mistakes]
            for record in explain(error, node, model, path):
                if not any(record.path == above or record.path.startswith(f"{above}.") for above in known):
                    self.mistakes.append(record)
            return None

    def _axes(self) -> list[tuple[Axis, Node]]:
        """Return the axes that can be read, with their nodes; other mistakes in them come out with the campaign's."""
        node = tree.find(self.root, ["axes"])
        found = []
        for index, child in enumerate(node.value if node is not None and node.is_list else []):
            try:
                axis = Axis.model_validate(tree.plain(child))
            except ValidationError:
                continue
            if axis.path.removeprefix("base.").partition(".")[0] in Scenario.model_fields:
                found.append((axis, child))
            else:
                where = child.value["path"].place
                near = tree.hint(axis.path, Scenario.model_fields)
                old = fields.old_key(Scenario, axis.path.removeprefix("base.").partition(".")[0])
                message = (
                    f"{quoted(axis.path)}: {old}" if old else f"{quoted(axis.path)} is not a field of the base{near}"
                )
                self.mistakes.append(mistake(where, f"axes.{index}.path", message))
        return found

    def _bounded(self, axes: list[tuple[Axis, Node]]) -> None:
        """Refuse more cases than are computed, before anything is built, and axes that others replace."""
        if not axes:
            return
        kind = tree.find(self.root, ["design"])
        sizes = [len(labels.level_nodes(node)) for _, node in axes]
        where = self.root.value["axes"]
        name = str(kind.value) if kind else "grid"
        found = [*labels.too_many(name, sizes, where), *labels.replaced(name, axes)]
        if found:
            self.mistakes.extend(found)
            self._raise()

    def _refuse_unused(self, axes: list[tuple[Axis, Node]]) -> None:
        """Note the fields of a card that the base changes and no case has: an axis puts another card in its place."""
        kept = tree.find(self.root, ["design"])
        if kept is not None and kept.value == "one_at_a_time":
            return  # its first case is the base
        for axis, _ in axes:
            path = ["base", *labels.steps(axis)]
            node = tree.find(self.root, path)
            if node is None or not node.is_map or "card" not in node.value:
                continue
            for key, where in node.keys.items():
                if key != "card":
                    message = f"no case has it: the axis {quoted(axis.path)} replaces it; write it in the axis's values"
                    self.mistakes.append(mistake(where, ".".join((*path, key)), message))

    def _with_base_from(self, axes: list[tuple[Axis, Node]]) -> Node:
        """Return the tree in which the first level of an axis stands in for a field that the base leaves out."""
        base = tree.find(self.root, ["base"])
        if base is None:
            self._validate(self.root, Campaign, "")
            self._raise()
        if base is None or not base.is_map:
            return self.root
        for axis, node in axes:
            path = labels.steps(axis)
            entry = len(path) == 2 and fields.entries(_field(path[0])) is not None
            if (entry or (len(path) == 1 and path[0] in Scenario.model_fields)) and tree.find(base, path) is None:
                base = tree.put(base, path, labels.level_nodes(node)[0])
        return tree.put(self.root, ["base"], base)

    def _levels(self, base: Node, axis: Axis, node: Node, index: int) -> list[Node]:
        """Return the expanded value of every level of an axis, each tried alone in the base."""
        path = labels.steps(axis)
        kind, _ = _kind_at(base, path)
        if kind is None:
            where = node.value["path"].place
            self.mistakes.append(mistake(where, f"axes.{index}.path", _unknown(base, path)))
            return []
        found = []
        for level in labels.level_nodes(node):
            expander = Expander(self.shelf)
            value = expander.expand(level, kind, ".".join(("base", *path)))
            self.mistakes.extend(expander.mistakes)
            if not expander.mistakes:
                self._validate(tree.put(base, path, value), Scenario, "base")
            found.append(value)
        return found

    def _resolved(self, campaign: Campaign, axis: tuple[Axis, Node], values: list[Node], index: int) -> Axis:
        """Return the axis with whole values in place of cards, and a label for every level."""
        card, node = axis
        path = labels.steps(card)
        base = campaign.base.model_dump(mode="json")
        plain = []
        for value in values:
            scenario = Scenario.model_validate(design.put(base, path, tree.plain(value)))
            plain.append(_get(scenario.model_dump(mode="json"), path))
        at = f"axes.{index}.{labels.level_key(node)}"
        self.mistakes.extend(labels.equal_levels(campaign.design, card, plain, labels.level_nodes(node), at))
        names = _distinct(tuple(design.level_label(card, number) for number in range(len(values))))
        self.mistakes.extend(labels.bad_labels(campaign.design, names, node, at))
        return card.model_copy(update={"path": ".".join(path), "cards": None, "values": tuple(plain), "labels": names})

    def _check_cases(
        self, campaign: Campaign, base: Node, axes: list[tuple[Axis, Node]], levels: list[list[Node]]
    ) -> None:
        """Cross-check every case; a mistake stands where the field that breaks the rule was written."""
        sizes = [len(values) for values in levels]
        if campaign.design == "zip" and len(set(sizes)) > 1:
            node = self.root.value["axes"]
            self.mistakes.append(mistake(node.place, "axes", f"design zip needs axes of equal length, not {sizes}"))
            return
        for chosen in design.levels(campaign.design, sizes):
            node = base
            try:
                for (axis, _), values, index in zip(axes, levels, chosen, strict=True):
                    if index is not None:
                        node = tree.put(node, labels.steps(axis), values[index])
            except InputError as error:  # a level of another axis has no such item
                self.mistakes.extend(error.records)
                continue
            scenario = self._validate(node, Scenario, "base")
            if isinstance(scenario, Scenario):
                self.mistakes.extend(checks.rates(scenario, node))
                self.mistakes.extend(checks.measurements(scenario, node))


def _kind_at(base: Node, path: list[str]) -> tuple[Any, Node | None]:
    """Return the annotation and the node at a path of the base, (None, None) where the path leads nowhere."""
    kind: Any = Scenario
    node: Node | None = base
    for key in path:
        if fields.item(kind, 0) is not None and (node is None or tree.find(node, [key]) is None):
            return None, None
        kind = fields.child(kind, key, node)
        node = tree.find(node, [key]) if node is not None else None
        if kind is None:
            return None, None
    return kind, node


def _field(key: str) -> Any:
    """Return the annotation of a field of the base, None where it has no such field."""
    return Scenario.model_fields[key].annotation if key in Scenario.model_fields else None


def _unknown(base: Node, path: list[str]) -> str:
    """Say which step of a path is unknown."""
    for depth in range(1, len(path) + 1):
        if _kind_at(base, path[:depth])[0] is None:
            kind, node = _kind_at(base, path[: depth - 1]) if depth > 1 else (Scenario, base)
            old = fields.old_key(kind, path[depth - 1])
            if old:
                return f"{quoted('.'.join(path))}: {old}"
            near = tree.hint(path[depth - 1], fields.names(kind, node))
            return f"{quoted('.'.join(path))} is not a field of the base{near}"
    return f"{quoted('.'.join(path))} is not a field of the base"


def _get(data: Any, path: Sequence[str]) -> Any:
    for key in path:
        data = data[int(key)] if isinstance(data, list) else data[key]
    return data


def _distinct(labels: tuple[str, ...]) -> tuple[str, ...]:
    """Return the labels with a number on those that would otherwise be equal."""
    return tuple(
        label if labels.count(label) == 1 else f"{label}#{labels[: index + 1].count(label)}"
        for index, label in enumerate(labels)
    )
