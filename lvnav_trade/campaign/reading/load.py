"""Reading of a campaign from its YAML file and assignments; all input errors are reported at once, one line each."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from lvnav_trade.campaign.definition import axes as design
from lvnav_trade.campaign.definition.schema import Axis, Campaign
from lvnav_trade.campaign.reading import checks
from lvnav_trade.campaign.reading.assignments import apply
from lvnav_trade.campaign.reading.axis_checks import (
    WrittenAxis,
    bad_levels,
    equal_cases,
    narrowing,
    replaced,
    selection,
    too_many,
)
from lvnav_trade.campaign.reading.expand import expand, splice
from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.reading.sampled import Rule, choice_of_runs, ruled, with_designs
from lvnav_trade.campaign.reading.spaced import spaced
from lvnav_trade.campaign.reading.written_cases import WrittenCases, first_cases
from lvnav_trade.campaign.syntax import fields, tree
from lvnav_trade.campaign.syntax.card_lookup import Shelf, campaign_file
from lvnav_trade.quantities.errors import InputError, Mistake, quoted, refuse_all
from lvnav_trade.scenario.scenario import Scenario


def load(file: str | Path, sets: Sequence[str] = ()) -> Campaign:
    """Read a campaign, expand its cards and fill in all defaults.

    Parameters
    ----------
    file : str or Path
        Campaign file, or the name of a campaign that comes with the tool.
    sets : sequence of str
        Assignments such as ``monte_carlo.runs=500``, applied to the file. If an assignment removes levels of an axis,
        the published numbers of these levels are dropped.

    Raises
    ------
    InputError
        With one record per input error; nothing has been computed.
    """
    path = campaign_file(str(file))
    root = tree.read_mapping(path)
    shelf = Shelf.of(path.resolve().parent)
    for assignment in sets:
        root = apply(root, assignment, shelf)
    changes_axes = any(assignment.strip().startswith("axes") for assignment in sets)
    return _Loader(root, shelf).campaign(is_narrowed=changes_axes)


def resolved(campaign: Campaign) -> str:
    """Return the campaign as YAML text with all defaults; `load` reads it back to an equal campaign."""
    as_written = campaign.model_copy(update={"axes": campaign.rule})
    return tree.dump(as_written.model_dump(mode="json", exclude_none=False))


Model = TypeVar("Model", bound=BaseModel)


class _Loader:
    """Converts one YAML tree into a campaign and collects input errors instead of stopping at the first."""

    def __init__(self, root: tree.Node, shelf: Shelf) -> None:
        self.root = root
        self.shelf = shelf
        self.mistakes: list[Mistake] = []
        self.broken: list[str] = []  # paths at which the expansion of cards found an input error
        self.unread: set[tuple[int, int]] = set()  # axis and level whose expansion found an input error
        self.design = "grid"
        self.rule: Rule | None = None  # definition of a design space

    def campaign(self, is_narrowed: bool) -> Campaign:
        """Return the campaign or raise all input errors; `is_narrowed`: drop published numbers of removed levels."""
        axes = self._read_axes()
        self.root, set_mistakes = splice(self.root, self.shelf)
        self.mistakes += set_mistakes
        complete_root = self._complete_base(axes)
        root = self._expand(complete_root, Campaign, "")
        validated = self._validate(root, Campaign, "")
        base = root.value["base"]
        levels: list[list[tree.Node]] = []
        if base.is_map:
            levels = [self._levels(base, axis, index) for index, axis in enumerate(axes)]
        sizes = [len(nodes) for nodes in levels]
        if self.design == "zip" and len(set(sizes)) > 1:
            message = f"design zip needs axes of equal length, not {sizes}"
            self.mistakes.append(tree.mistake_at(self.root, "axes", message))
        if not base.is_map:
            self._raise()
        base_scenario = validated.base if validated is not None else None
        cases = WrittenCases(base, axes, levels, base_scenario)
        sections = self._level_sections(cases, axes, levels)
        self._raise()
        assert validated is not None
        complete_axes = self._complete_axes(axes, sections)
        campaign = validated.model_copy(update={"axes": complete_axes})
        self._raise()
        campaign = self._checked(campaign, cases, root, is_narrowed)
        campaign._written = campaign.probe._written = self._written(root, axes, levels)
        design.remember(campaign.probe, cases.scenarios)
        return campaign

    def _read_axes(self) -> list[WrittenAxis]:
        """Return the axes with lists of levels; raise if there are too many cases, before anything is built."""
        self.rule, self.root = ruled(self.root)
        if self.rule is None:
            self.root, self.mistakes = spaced(self.root)
        self._raise()
        design_node = tree.find(self.root, ["design"])
        self.design = str(design_node.value) if design_node else "grid"
        axes = self._axes()
        sizes = [len(varied.levels) for varied in axes]
        crossed = [number for number, varied in enumerate(axes) if varied.axis.crossed]
        excess = [*too_many(self.design, sizes, self.root, crossed), *replaced(self.design, axes)]
        self.mistakes += excess
        if excess:
            self._raise()
        return axes

    def _checked(self, campaign: Campaign, cases: WrittenCases, root: tree.Node, is_narrowed: bool) -> Campaign:
        """Return the campaign after all checks, as a design space if it is one; raise all input errors."""
        if self.rule is not None:
            campaign = self._design_space(cases, campaign, self.rule)
        self.mistakes += choice_of_runs(campaign, self.root)
        self.mistakes += narrowing(campaign, root)
        self._raise()
        if self.rule is None:
            self._check_cases(cases, campaign)
        self._raise()
        self.mistakes += checks.requirements(campaign, root)
        self.mistakes += checks.without_effect(campaign, root)
        if self.rule is None:
            self.mistakes += equal_cases(campaign, self.root)
        if is_narrowed:
            campaign = checks.narrowed(campaign)
        self.mistakes += checks.references(campaign, root)
        self.mistakes += selection(campaign, root)
        self._raise()
        return campaign

    def _design_space(self, cases: WrittenCases, ends: Campaign, rule: Rule) -> Campaign:
        """Return the design space from the campaign of the ends of its axes, whose cases have been checked."""
        space = with_designs(ends, rule)
        # only the base must be valid: an end that breaks a rule alone may be valid together with other levels
        base = (None,) * len(ends.axes)
        scenario = self._case(cases, base)
        if scenario is not None:
            self.mistakes += checks.broken_rules(scenario, cases.node(base))
        self._raise()
        return space

    def _written(self, root: tree.Node, axes: list[WrittenAxis], levels: list[list[tree.Node]]) -> tree.SourceTree:
        """Return the expanded tree, the levels of the axes, and the paths at which an axis filled the base."""
        filled = []
        for varied in axes:
            path = varied.axis.steps
            if tree.find(self.root, ["base", *path]) is None:
                filled.append(".".join(path))
        placed_levels = []
        for nodes, varied in zip(levels, axes, strict=True):
            places = [level.place for level in varied.levels]
            placed_levels.append(list(zip(nodes, places, strict=True)))
        return tree.SourceTree(root, placed_levels, filled)

    def _raise(self) -> None:
        """Raise the input errors collected so far, in the order of their places."""
        distinct = dict.fromkeys(self.mistakes)
        refuse_all(sorted(distinct, key=lambda record: (record.file, record.line, record.column)))

    def _expand(self, node: tree.Node, kind: Any, path: str) -> tree.Node:
        """Return the tree with cards expanded; input errors are collected."""
        expanded_node, mistakes = expand(node, kind, self.shelf, path)
        self.mistakes += mistakes
        self.broken += [record.path for record in mistakes]
        return expanded_node

    def _validate(
        self, node: tree.Node, model: type[Model], path: str, make: Callable[[], Model] | None = None
    ) -> Model | None:
        """Return the model of an expanded tree, or None; input errors are collected.

        Fields whose expansion already failed are not reported again, and each place in the files only once.
        """
        try:
            return model.model_validate(tree.plain(node)) if make is None else make()
        except ValidationError as error:
            reported_places = {record[1:] for record in self.mistakes}  # all fields but the message
            for record in explain(error, node, model, path):
                if not self._is_broken(record.path) and record[1:] not in reported_places:
                    self.mistakes.append(record)
            return None

    def _is_broken(self, path: str) -> bool:
        """Whether the expansion of cards found an input error at or above a path."""
        return any(path == above or path.startswith(f"{above}.") for above in self.broken)

    def _axes(self) -> list[WrittenAxis]:
        """Return the axes that are valid; validation of the whole campaign reports the errors of the others."""
        node = tree.find(self.root, ["axes"])
        if node is None or not node.is_list:
            return []
        valid_axes = []
        for index, child in enumerate(node.value):
            try:
                axis = Axis.model_validate(tree.plain(child))
            except ValidationError:
                continue
            if axis.steps[0] in Scenario.model_fields:
                valid_axes.append(WrittenAxis(axis, child))
            else:
                suggestion = tree.hint(axis.path, Scenario.model_fields)
                message = _missing_field(axis.path, Scenario, axis.steps[0], suggestion)
                self.mistakes.append(tree.mistake_at(self.root, f"axes.{index}.path", message))
        return valid_axes

    def _complete_base(self, axes: list[WrittenAxis]) -> tree.Node:
        """Return the tree with the first level of an axis put in for each varied field that the base does not have."""
        base = tree.find(self.root, ["base"])
        if base is None:
            self._validate(self.root, Campaign, "")
            self._raise()
        if base is None or not base.is_map:
            return self.root
        for varied in axes:
            path = varied.axis.steps
            is_section = len(path) == 1
            # an entry of a mapping with free keys, such as a sensor
            is_entry = len(path) == 2 and fields.entries(Scenario.model_fields[path[0]].annotation) is not None
            if (is_section or is_entry) and tree.find(base, path) is None:
                base = tree.put(base, path, varied.levels[0])
        return tree.put(self.root, ["base"], base)

    def _levels(self, base: tree.Node, varied: WrittenAxis, index: int) -> list[tree.Node]:
        """Return the levels of an axis with cards expanded; no levels if the path of the axis does not exist."""
        path = varied.axis.steps
        kind, _ = _kind_at(base, path)
        if kind is None:
            message = _unknown_path_message(base, path)
            self.mistakes.append(tree.mistake_at(varied.node, "path", message, f"axes.{index}"))
            return []
        expanded_levels = []
        full_path = ".".join(("base", *path))
        for number, level in enumerate(varied.levels):
            n_before = len(self.mistakes)
            expanded_levels.append(self._expand(level, kind, full_path))
            if len(self.mistakes) > n_before:
                self.unread.add((index, number))
        return expanded_levels

    def _level_sections(
        self, cases: WrittenCases, axes: list[WrittenAxis], levels: list[list[tree.Node]]
    ) -> list[list[dict[str, Any]]]:
        """Return for every level of every axis the validated section of a scenario with this level, as plain data."""
        first = first_cases(self.design, axes, [len(nodes) for nodes in levels])
        sections: list[list[dict[str, Any]]] = []
        for number, (varied, nodes) in enumerate(zip(axes, levels, strict=True)):
            section_name = varied.axis.steps[0]
            of_axis = []
            for level in range(len(nodes)):
                if (number, level) in self.unread:
                    continue
                scenario = self._level_scenario(cases, number, level, first.get((number, level)))
                if scenario is not None:
                    of_axis.append(scenario.model_dump(mode="json", include={section_name}))
            sections.append(of_axis)
        return sections

    def _level_scenario(
        self, cases: WrittenCases, number: int, level: int, first: design.Chosen | None
    ) -> Scenario | None:
        """Return a scenario with a level of an axis: of the first case that has the level or, if that is not valid, the
        base with this level alone, whose input errors are collected.
        """
        if first is not None and cases.is_whole:
            try:
                return cases.scenario(first)
            except (InputError, ValidationError):
                pass
        level_alone: list[int | None] = [None] * len(cases.axes)
        level_alone[number] = level
        return self._case(cases, tuple(level_alone))

    def _complete_axes(self, axes: list[WrittenAxis], sections: list[list[dict[str, Any]]]) -> tuple[Axis, ...]:
        """Return the axes with complete values in place of cards, and a label for every level."""
        complete_axes = []
        for index, (varied, of_axis) in enumerate(zip(axes, sections, strict=True)):
            axis = varied.axis
            values = [design.get(section, axis.steps) for section in of_axis]
            labels = [design.level_label(axis, number) for number in range(len(values))]
            if axis.labels is None:
                labels = _distinct_labels(labels, values)
            self.mistakes += bad_levels(self.design, varied, values, labels, index)
            update = {
                "path": ".".join(axis.steps),
                "cards": None,
                "values": tuple(values),
                "labels": tuple(labels),
            }
            complete_axes.append(axis.model_copy(update=update))
        return tuple(complete_axes)

    def _check_cases(self, cases: WrittenCases, campaign: Campaign) -> None:
        """Check the rules between settings in every case; an error has the place of the field that breaks the rule."""
        for chosen in design.chosen_levels(campaign):
            scenario = self._case(cases, chosen)
            if scenario is not None:
                self.mistakes += checks.broken_rules(scenario, cases.node(chosen))

    def _case(self, cases: WrittenCases, chosen: design.Chosen) -> Scenario | None:
        """Return the scenario of a case, or None; input errors are collected."""
        try:
            node = cases.node(chosen)
        except InputError as error:  # a level of another axis has no such item
            self.mistakes += error.records
            return None
        return self._validate(node, Scenario, "base", lambda: cases.scenario(chosen))


def _distinct_labels(labels: list[str], values: list[Any]) -> list[str]:
    """Return the labels of levels, with a number where different levels have equal labels."""
    distinct = []
    for number, label in enumerate(labels):
        same_label = [k for k, other_label in enumerate(labels) if other_label == label]
        if any(values[k] != values[number] for k in same_label):
            label = f"{label}#{same_label.index(number) + 1}"
        distinct.append(label)
    return distinct


def _kind_at(base: tree.Node, path: list[str]) -> tuple[Any, tree.Node | None]:
    """Return the annotation and the node at a path of the base; (None, None) if the path does not exist."""
    kind: Any = Scenario
    node: tree.Node | None = base
    for key in path:
        below = tree.find(node, [key]) if node is not None else None
        if below is None and fields.item(kind, 0) is not None:
            return None, None  # no such item of a list
        kind = fields.child(kind, key, node)
        if kind is None:
            return None, None
        node = below
    return kind, node


def _unknown_path_message(base: tree.Node, path: list[str]) -> str:
    """Return the message for a path that does not exist in the base, with a suggestion for its first wrong step."""
    kind: Any = Scenario
    node: tree.Node | None = base
    for depth, key in enumerate(path):
        below_kind, below = _kind_at(base, path[: depth + 1])
        if below_kind is None:
            suggestion = tree.hint(key, fields.names(kind, node))
            return _missing_field(".".join(path), kind, key, suggestion)
        kind = below_kind
        node = below
    raise AssertionError(f"{'.'.join(path)} exists")


def _missing_field(path: str, kind: Any, key: str, suggestion: str) -> str:
    """Return the message for a path that does not exist: no such key, or the replacement of a former key."""
    replacement = fields.old_key(kind, key)
    if replacement:
        return f"{quoted(path)}: {replacement}"
    return f"{quoted(path)} is not a field of the base{suggestion}"
