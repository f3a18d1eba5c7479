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
    equal_case_errors,
    level_errors,
    narrowing_errors,
    replaced_axis_errors,
    run_selection_errors,
    size_errors,
)
from lvnav_trade.campaign.reading.expand import expand, splice
from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.reading.sampled import Rule, read_rule, run_choice_errors, with_designs
from lvnav_trade.campaign.reading.spaced import expand_axes
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
    shelf = Shelf.from_folder(path.resolve().parent)
    for assignment in sets:
        root = apply(root, assignment, shelf)
    changes_axes = any(assignment.strip().startswith("axes") for assignment in sets)
    return _Loader(root, shelf).campaign(is_narrowed=changes_axes)


def resolved_text(campaign: Campaign) -> str:
    """Return the campaign as YAML text with all defaults; `load` reads it back to an equal campaign."""
    written_campaign = campaign.model_copy(update={"axes": campaign.written_axes})
    return tree.dump(written_campaign.model_dump(mode="json", exclude_none=False))


Model = TypeVar("Model", bound=BaseModel)


class _Loader:
    """Converts one YAML tree into a campaign and collects input errors instead of stopping at the first."""

    def __init__(self, root: tree.Node, shelf: Shelf) -> None:
        self.root = root
        self.shelf = shelf
        self.mistakes: list[Mistake] = []
        self.broken_paths: list[str] = []  # paths at which the expansion of cards found an input error
        self.unread_levels: set[tuple[int, int]] = set()  # axis and level whose expansion found an input error
        self.design = "grid"
        self.rule: Rule | None = None  # definition of a design space

    def campaign(self, is_narrowed: bool) -> Campaign:
        """Return the campaign or raise all input errors; `is_narrowed`: drop published numbers of removed levels."""
        axes = self._read_axes()
        self.root, set_mistakes = splice(self.root, self.shelf)
        self.mistakes += set_mistakes
        complete_root = self._complete_base(axes)
        root = self._expand(complete_root, Campaign, "")
        parsed_campaign = self._validate(root, Campaign, "")
        base = root.value["base"]
        levels: list[list[tree.Node]] = []
        if base.is_map:
            levels = [self._levels(base, axis, index) for index, axis in enumerate(axes)]
        sizes = [len(nodes) for nodes in levels]
        if self.design == "zip" and len(set(sizes)) > 1:
            message = f"design zip needs axes of equal length, not {sizes}"
            self.mistakes.append(tree.mistake_at(self.root, "axes", message))
        if not base.is_map:
            self._raise_mistakes()
        base_scenario = parsed_campaign.base if parsed_campaign is not None else None
        cases = WrittenCases(base, axes, levels, base_scenario)
        sections = self._level_sections(cases, axes, levels)
        self._raise_mistakes()
        assert parsed_campaign is not None
        complete_axes = self._complete_axes(axes, sections)
        campaign = parsed_campaign.model_copy(update={"axes": complete_axes})
        self._raise_mistakes()
        campaign = self._checked_campaign(campaign, cases, root, is_narrowed)
        campaign._source_tree = campaign.probe._source_tree = self._source_tree(root, axes, levels)
        design.remember(campaign.probe, cases.scenarios)
        return campaign

    def _read_axes(self) -> list[WrittenAxis]:
        """Return the axes with lists of levels; raise if there are too many cases, before anything is built."""
        self.rule, self.root = read_rule(self.root)
        if self.rule is None:
            self.root, self.mistakes = expand_axes(self.root)
        self._raise_mistakes()
        design_node = tree.find(self.root, ["design"])
        self.design = str(design_node.value) if design_node else "grid"
        axes = self._axes()
        sizes = [len(written_axis.levels) for written_axis in axes]
        crossed_axes = [number for number, written_axis in enumerate(axes) if written_axis.axis.crossed]
        excess = [*size_errors(self.design, sizes, self.root, crossed_axes), *replaced_axis_errors(self.design, axes)]
        self.mistakes += excess
        if excess:
            self._raise_mistakes()
        return axes

    def _checked_campaign(
        self, campaign: Campaign, cases: WrittenCases, root: tree.Node, is_narrowed: bool
    ) -> Campaign:
        """Return the campaign after all checks, as a design space if it is one; raise all input errors."""
        if self.rule is not None:
            campaign = self._design_space(cases, campaign, self.rule)
        self.mistakes += run_choice_errors(campaign, self.root)
        self.mistakes += narrowing_errors(campaign, root)
        self._raise_mistakes()
        if self.rule is None:
            self._check_cases(cases, campaign)
        self._raise_mistakes()
        self.mistakes += checks.requirements(campaign, root)
        self.mistakes += checks.settings_without_effect(campaign, root)
        if self.rule is None:
            self.mistakes += equal_case_errors(campaign, self.root)
        if is_narrowed:
            campaign = checks.with_valid_references(campaign)
        self.mistakes += checks.references(campaign, root)
        self.mistakes += run_selection_errors(campaign, root)
        self._raise_mistakes()
        return campaign

    def _design_space(self, cases: WrittenCases, ends_campaign: Campaign, rule: Rule) -> Campaign:
        """Return the design space from the campaign of the ends of its axes, whose cases have been checked."""
        space = with_designs(ends_campaign, rule)
        # only the base must be valid: an end that breaks a rule alone may be valid together with other levels
        base = (None,) * len(ends_campaign.axes)
        scenario = self._case(cases, base)
        if scenario is not None:
            self.mistakes += checks.broken_rules(scenario, cases.node(base))
        self._raise_mistakes()
        return space

    def _source_tree(self, root: tree.Node, axes: list[WrittenAxis], levels: list[list[tree.Node]]) -> tree.SourceTree:
        """Return the expanded tree, the levels of the axes, and the paths at which an axis filled the base."""
        filled_paths = []
        for written_axis in axes:
            path = written_axis.axis.steps
            if tree.find(self.root, ["base", *path]) is None:
                filled_paths.append(".".join(path))
        placed_levels = []
        for nodes, written_axis in zip(levels, axes, strict=True):
            places = [level.place for level in written_axis.levels]
            placed_levels.append(list(zip(nodes, places, strict=True)))
        return tree.SourceTree(root, placed_levels, filled_paths)

    def _raise_mistakes(self) -> None:
        """Raise the input errors collected so far, in the order of their places."""
        distinct = dict.fromkeys(self.mistakes)
        refuse_all(sorted(distinct, key=lambda record: (record.file, record.line, record.column)))

    def _expand(self, node: tree.Node, annotation: Any, path: str) -> tree.Node:
        """Return the tree with cards expanded; input errors are collected."""
        expanded_node, mistakes = expand(node, annotation, self.shelf, path)
        self.mistakes += mistakes
        self.broken_paths += [record.path for record in mistakes]
        return expanded_node

    def _validate(
        self, node: tree.Node, model: type[Model], path: str, make: Callable[[], Model] | None = None
    ) -> Model | None:
        """Return the model of an expanded tree, or None; input errors are collected.

        Fields whose expansion already failed are not reported again, and each place in the files only once.
        """
        try:
            return model.model_validate(tree.plain_data(node)) if make is None else make()
        except ValidationError as error:
            reported_places = {record[1:] for record in self.mistakes}  # all fields but the message
            for record in explain(error, node, model, path):
                if not self._is_broken(record.path) and record[1:] not in reported_places:
                    self.mistakes.append(record)
            return None

    def _is_broken(self, path: str) -> bool:
        """Whether the expansion of cards found an input error at or above a path."""
        return any(path == broken_path or path.startswith(f"{broken_path}.") for broken_path in self.broken_paths)

    def _axes(self) -> list[WrittenAxis]:
        """Return the axes that are valid; validation of the whole campaign reports the errors of the others."""
        node = tree.find(self.root, ["axes"])
        if node is None or not node.is_list:
            return []
        valid_axes = []
        for index, child in enumerate(node.value):
            try:
                axis = Axis.model_validate(tree.plain_data(child))
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
            self._raise_mistakes()
        if base is None or not base.is_map:
            return self.root
        for written_axis in axes:
            path = written_axis.axis.steps
            is_section = len(path) == 1
            # an entry of a mapping with free keys, such as a sensor
            is_entry = len(path) == 2 and fields.entries(Scenario.model_fields[path[0]].annotation) is not None
            if (is_section or is_entry) and tree.find(base, path) is None:
                base = tree.with_node(base, path, written_axis.levels[0])
        return tree.with_node(self.root, ["base"], base)

    def _levels(self, base: tree.Node, written_axis: WrittenAxis, index: int) -> list[tree.Node]:
        """Return the levels of an axis with cards expanded; no levels if the path of the axis does not exist."""
        path = written_axis.axis.steps
        annotation, _ = _annotation_at(base, path)
        if annotation is None:
            message = _unknown_path_message(base, path)
            self.mistakes.append(tree.mistake_at(written_axis.node, "path", message, f"axes.{index}"))
            return []
        expanded_levels = []
        full_path = ".".join(("base", *path))
        for number, level in enumerate(written_axis.levels):
            n_mistake = len(self.mistakes)
            expanded_levels.append(self._expand(level, annotation, full_path))
            if len(self.mistakes) > n_mistake:
                self.unread_levels.add((index, number))
        return expanded_levels

    def _level_sections(
        self, cases: WrittenCases, axes: list[WrittenAxis], levels: list[list[tree.Node]]
    ) -> list[list[dict[str, Any]]]:
        """Return for every level of every axis the validated section of a scenario with this level, as plain data."""
        cases_by_level = first_cases(self.design, axes, [len(nodes) for nodes in levels])
        sections: list[list[dict[str, Any]]] = []
        for number, (written_axis, nodes) in enumerate(zip(axes, levels, strict=True)):
            section_name = written_axis.axis.steps[0]
            axis_sections = []
            for level in range(len(nodes)):
                if (number, level) in self.unread_levels:
                    continue
                scenario = self._level_scenario(cases, number, level, cases_by_level.get((number, level)))
                if scenario is not None:
                    axis_sections.append(scenario.model_dump(mode="json", include={section_name}))
            sections.append(axis_sections)
        return sections

    def _level_scenario(
        self, cases: WrittenCases, number: int, level: int, first_case: design.LevelIndices | None
    ) -> Scenario | None:
        """Return a scenario with a level of an axis: of the first case that has the level or, if that is not valid, the
        base with this level alone, whose input errors are collected.
        """
        if first_case is not None and cases.has_valid_base:
            try:
                return cases.scenario(first_case)
            except (InputError, ValidationError):
                pass
        single_level: list[int | None] = [None] * len(cases.axes)
        single_level[number] = level
        return self._case(cases, tuple(single_level))

    def _complete_axes(self, axes: list[WrittenAxis], sections: list[list[dict[str, Any]]]) -> tuple[Axis, ...]:
        """Return the axes with complete values in place of cards, and a label for every level."""
        complete_axes = []
        for index, (written_axis, axis_sections) in enumerate(zip(axes, sections, strict=True)):
            axis = written_axis.axis
            values = [design.get(section, axis.steps) for section in axis_sections]
            labels = [design.level_label(axis, number) for number in range(len(values))]
            if axis.labels is None:
                labels = _distinct_labels(labels, values)
            self.mistakes += level_errors(self.design, written_axis, values, labels, index)
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
        for level_indices in design.case_level_indices(campaign):
            scenario = self._case(cases, level_indices)
            if scenario is not None:
                self.mistakes += checks.broken_rules(scenario, cases.node(level_indices))

    def _case(self, cases: WrittenCases, level_indices: design.LevelIndices) -> Scenario | None:
        """Return the scenario of a case, or None; input errors are collected."""
        try:
            node = cases.node(level_indices)
        except InputError as error:  # a level of another axis has no such item
            self.mistakes += error.records
            return None
        return self._validate(node, Scenario, "base", lambda: cases.scenario(level_indices))


def _distinct_labels(labels: list[str], values: list[Any]) -> list[str]:
    """Return the labels of levels, with a number where different levels have equal labels."""
    distinct = []
    for number, label in enumerate(labels):
        same_label = [k for k, other_label in enumerate(labels) if other_label == label]
        if any(values[k] != values[number] for k in same_label):
            label = f"{label}#{same_label.index(number) + 1}"
        distinct.append(label)
    return distinct


def _annotation_at(base: tree.Node, path: list[str]) -> tuple[Any, tree.Node | None]:
    """Return the annotation and the node at a path of the base; (None, None) if the path does not exist."""
    annotation: Any = Scenario
    node: tree.Node | None = base
    for key in path:
        child = tree.find(node, [key]) if node is not None else None
        if child is None and fields.item(annotation, 0) is not None:
            return None, None  # no such item of a list
        annotation = fields.child(annotation, key, node)
        if annotation is None:
            return None, None
        node = child
    return annotation, node


def _unknown_path_message(base: tree.Node, path: list[str]) -> str:
    """Return the message for a path that does not exist in the base, with a suggestion for its first wrong step."""
    annotation: Any = Scenario
    node: tree.Node | None = base
    for depth, key in enumerate(path):
        child_annotation, child = _annotation_at(base, path[: depth + 1])
        if child_annotation is None:
            suggestion = tree.hint(key, fields.names(annotation, node))
            return _missing_field(".".join(path), annotation, key, suggestion)
        annotation = child_annotation
        node = child
    raise AssertionError(f"{'.'.join(path)} exists")


def _missing_field(path: str, annotation: Any, key: str, suggestion: str) -> str:
    """Return the message for a path that does not exist: no such key, or the replacement of a former key."""
    replacement = fields.old_key_message(annotation, key)
    if replacement:
        return f"{quoted(path)}: {replacement}"
    return f"{quoted(path)} is not a field of the base{suggestion}"
