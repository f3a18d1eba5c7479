"""From a YAML file to a checked campaign: every mistake found at once, each in one line."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from lvnav_trade.campaign import axes as design
from lvnav_trade.campaign import checks, fields, tree
from lvnav_trade.campaign.cards import Shelf, campaign_file
from lvnav_trade.campaign.expand import Expander
from lvnav_trade.campaign.explain import explain
from lvnav_trade.campaign.overrides import apply
from lvnav_trade.campaign.schema import Axis, Campaign
from lvnav_trade.campaign.sets import splice
from lvnav_trade.campaign.tree import Node, mistake
from lvnav_trade.errors import InputError, Mistake
from lvnav_trade.scenario import Scenario


def load(file: str | Path, sets: Sequence[str] = ()) -> Campaign:
    """Return the campaign of a file with cards expanded and all defaults filled in.

    Parameters
    ----------
    file : path, or the name of a campaign that comes with the tool
    sets : assignments such as ``monte_carlo.runs=500`` laid on top

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
    return _Loader(root, shelf).campaign()


def resolved(campaign: Campaign) -> str:
    """Return the campaign as YAML, all defaults filled in; `load` reads it back to the same campaign."""
    return tree.dump(campaign.model_dump(mode="json", exclude_none=False))


class _Loader:
    """Turns one tree into a campaign; collects mistakes instead of stopping at the first."""

    def __init__(self, root: Node, shelf: Shelf) -> None:
        self.root = root
        self.shelf = shelf
        self.mistakes: list[Mistake] = []

    def campaign(self) -> Campaign:
        """Return the campaign or raise all mistakes."""
        axes = self._axes()
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
        whole_axes = [self._resolved(found, axis, values) for axis, values in zip(axes, levels, strict=True)]
        whole = found.model_copy(update={"axes": tuple(whole_axes)})
        self._check_cases(whole, base, axes, levels)
        self.mistakes.extend(checks.requirements(whole, root))
        self._raise()
        whole._written = tree.Written(root)
        return whole

    def _raise(self) -> None:
        unique = list(dict.fromkeys(self.mistakes))
        if unique:
            raise InputError(records=sorted(unique, key=lambda record: (record.file, record.line, record.column)))

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
                message = f"{axis.path!r}: {old}" if old else f"{axis.path!r} is not a field of the base{near}"
                self.mistakes.append(mistake(where, f"axes.{index}.path", message))
        return found

    def _refuse_unused(self, axes: list[tuple[Axis, Node]]) -> None:
        """Note the fields of a card that the base changes and no case has: an axis puts another card in its place."""
        kept = tree.find(self.root, ["design"])
        if kept is not None and kept.value == "one_at_a_time":
            return  # its first case is the base
        for axis, _ in axes:
            path = ["base", *axis.path.removeprefix("base.").split(".")]
            node = tree.find(self.root, path)
            if node is None or not node.is_map or "card" not in node.value:
                continue
            for key, where in node.keys.items():
                if key != "card":
                    message = f"no case has it: the axis {axis.path!r} replaces it; write it in the axis's values"
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
            path = axis.path.removeprefix("base.").split(".")
            entry = len(path) == 2 and fields.entries(_field(path[0])) is not None
            if (entry or (len(path) == 1 and path[0] in Scenario.model_fields)) and tree.find(base, path) is None:
                base = tree.put(base, path, _level_nodes(node)[0])
        return tree.put(self.root, ["base"], base)

    def _levels(self, base: Node, axis: Axis, node: Node, index: int) -> list[Node]:
        """Return the expanded value of every level of an axis, each tried alone in the base."""
        path = axis.path.removeprefix("base.").split(".")
        kind, _ = _kind_at(base, path)
        if kind is None:
            where = node.value["path"].place
            self.mistakes.append(mistake(where, f"axes.{index}.path", _unknown(base, path)))
            return []
        found = []
        for level in _level_nodes(node):
            expander = Expander(self.shelf)
            value = expander.expand(level, kind, ".".join(("base", *path)))
            self.mistakes.extend(expander.mistakes)
            if not expander.mistakes:
                self._validate(tree.put(base, path, value), Scenario, "base")
            found.append(value)
        return found

    def _resolved(self, campaign: Campaign, axis: tuple[Axis, Node], values: list[Node]) -> Axis:
        """Return the axis with whole values in place of cards, and a label for every level."""
        card = axis[0]
        path = card.path.removeprefix("base.").split(".")
        base = campaign.base.model_dump(mode="json")
        plain = []
        for value in values:
            scenario = Scenario.model_validate(design.put(base, path, tree.plain(value)))
            plain.append(_get(scenario.model_dump(mode="json"), path))
        labels = tuple(design.level_label(card, index) for index in range(len(values)))
        return Axis(path=".".join(path), values=tuple(plain), labels=_distinct(labels))

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
            for (axis, _), values, index in zip(axes, levels, chosen, strict=True):
                if index is not None:
                    node = tree.put(node, axis.path.removeprefix("base.").split("."), values[index])
            scenario = self._validate(node, Scenario, "base")
            if isinstance(scenario, Scenario):
                self.mistakes.extend(checks.rates(scenario, node))
                self.mistakes.extend(checks.measurements(scenario, node))


def _level_nodes(axis: Node) -> list[Node]:
    """Return the nodes of an axis's levels."""
    given = [axis.value[key] for key in ("cards", "values") if key in axis.value and axis.value[key].is_list]
    return list(given[0].value)


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
                return f"{'.'.join(path)!r}: {old}"
            near = tree.hint(path[depth - 1], fields.names(kind, node))
            return f"{'.'.join(path)!r} is not a field of the base{near}"
    return f"{'.'.join(path)!r} is not a field of the base"


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
