"""Reading of a campaign from its YAML file and assignments; all input errors are reported at once, one line each."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from lvnav_trade.campaign.definition import axes as design
from lvnav_trade.campaign.definition.schema import Axis, Campaign
from lvnav_trade.campaign.reading import checks
from lvnav_trade.campaign.reading.checks import WrittenAxis, narrowing, selection
from lvnav_trade.campaign.reading.expand import expand, expanded, splice
from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.reading.sampled import Rule, choice_of_runs, ruled, with_designs
from lvnav_trade.campaign.reading.spaced import spaced
from lvnav_trade.campaign.reading.written_cases import WrittenCases, first_cases
from lvnav_trade.campaign.syntax import fields, marked, tree
from lvnav_trade.campaign.syntax.card_lookup import Shelf, campaign_file, nowhere
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
    return _Loader(root, shelf).campaign(any(assignment.strip().startswith("axes") for assignment in sets))


def resolved(campaign: Campaign) -> str:
    """Return the campaign as YAML text with all defaults; `load` reads it back to an equal campaign."""
    stated = campaign.model_copy(update={"axes": campaign.rule})
    return tree.dump(stated.model_dump(mode="json", exclude_none=False))


Model = TypeVar("Model", bound=BaseModel)


class _Loader:
    """Converts one YAML tree into a campaign and collects input errors instead of stopping at the first."""

    def __init__(self, root: tree.Node, shelf: Shelf) -> None:
        self.root, self.shelf = root, shelf
        self.mistakes: list[Mistake] = []
        self.broken: list[str] = []  # paths at which the expansion of cards found an input error
        self.unread: set[tuple[int, int]] = set()  # axis and level whose expansion found an input error
        self.design = "grid"
        self.rule: Rule | None = None  # definition of a design space

    def campaign(self, is_narrowed: bool) -> Campaign:
        """Return the campaign or raise all input errors; `is_narrowed`: drop published numbers of removed levels."""
        self.rule, self.root = ruled(self.root)
        if self.rule is None:
            self.root, self.mistakes = spaced(self.root)
        self._raise()
        kind = tree.find(self.root, ["design"])
        self.design = str(kind.value) if kind else "grid"
        axes = self._axes()
        sizes = [len(varied.levels) for varied in axes]
        crossed = [place for place, varied in enumerate(axes) if varied.axis.crossed]
        beyond = [*checks.too_many(self.design, sizes, self.root, crossed), *checks.replaced(self.design, axes)]
        self.mistakes += beyond
        if beyond:  # before anything is built
            self._raise()
        self.root, in_sets = splice(self.root, self.shelf)
        self.mistakes += in_sets
        root = self._expand(self._with_base_from(axes), Campaign, "")
        found = self._validate(root, Campaign, "")
        base = root.value["base"]
        levels = [self._levels(base, axis, index) for index, axis in enumerate(axes) if base.is_map]
        sizes = [len(values) for values in levels]
        if self.design == "zip" and len(set(sizes)) > 1:
            message = f"design zip needs axes of equal length, not {sizes}"
            self.mistakes.append(tree.mistake_at(self.root, "axes", message))
        if not base.is_map:
            self._raise()
        cases = WrittenCases(base, axes, levels, found.base if found is not None else None)
        tried = self._tried(cases, axes, levels)
        self._raise()
        assert found is not None
        whole_axes = [
            self._whole(varied, [design.get(one, varied.axis.steps) for one in scenarios], index)
            for index, (varied, scenarios) in enumerate(zip(axes, tried, strict=True))
        ]
        whole = found.model_copy(update={"axes": tuple(whole_axes)})
        self._raise()
        if self.rule is not None:
            whole = self._with_designs(cases, whole)
        self.mistakes += [*choice_of_runs(whole, self.root), *narrowing(whole, root)]
        self._raise()
        if self.rule is None:
            self._check_cases(cases, whole)
        self._raise()
        self.mistakes += [*checks.requirements(whole, root), *checks.without_effect(whole, root)]
        self.mistakes += checks.equal_cases(whole, self.root) if self.rule is None else []
        if is_narrowed:
            whole = checks.narrowed(whole)
        self.mistakes += [*checks.references(whole, root), *selection(whole, root)]
        self._raise()
        whole._written = whole.probe._written = self._written(root, axes, levels)
        design.remember(whole.probe, cases.scenarios)
        return whole

    def _with_designs(self, cases: WrittenCases, ends: Campaign) -> Campaign:
        """Return the design space from the campaign of the ends of its axes, whose cases have been checked."""
        assert self.rule is not None
        whole = with_designs(ends, self.rule)
        # only the base must be valid: an end that breaks a rule alone may be valid together with other levels
        base = (None,) * len(ends.axes)
        scenario = self._case(cases, base)
        if scenario is not None:
            self.mistakes += checks.broken_rules(scenario, cases.node(base))
        self._raise()
        return whole

    def _written(self, root: tree.Node, axes: list[WrittenAxis], levels: list[list[tree.Node]]) -> tree.SourceTree:
        """Return the expanded tree, the levels of the axes, and the paths at which an axis filled the base."""
        paths = [varied.axis.steps for varied in axes]
        filled = [".".join(path) for path in paths if tree.find(self.root, ["base", *path]) is None]
        placed = [
            [(node, level.place) for node, level in zip(nodes, varied.levels, strict=True)]
            for nodes, varied in zip(levels, axes, strict=True)
        ]
        return tree.SourceTree(root, placed, filled)

    def _raise(self) -> None:
        refuse_all(sorted(dict.fromkeys(self.mistakes), key=lambda record: (record.file, record.line, record.column)))

    def _expand(self, node: tree.Node, kind: Any, path: str) -> tree.Node:
        """Return the tree with cards expanded; input errors are collected."""
        whole, mistakes = expand(node, kind, self.shelf, path)
        self.mistakes += mistakes
        self.broken += [record.path for record in mistakes]
        return whole

    def _validate(
        self, node: tree.Node, model: type[Model], path: str, make: Callable[[], Model] | None = None
    ) -> Model | None:
        """Return the model of an expanded tree, or None; input errors are collected.

        Fields whose expansion already failed are not reported again, and each place in the files only once.
        """
        try:
            return model.model_validate(tree.plain(node)) if make is None else make()
        except ValidationError as error:
            known = {(*record[1:],) for record in self.mistakes}
            for record in explain(error, node, model, path):
                is_broken = any(record.path == above or record.path.startswith(f"{above}.") for above in self.broken)
                if not is_broken and (*record[1:],) not in known:
                    self.mistakes.append(record)
            return None

    def _axes(self) -> list[WrittenAxis]:
        """Return the axes that are valid; validation of the whole campaign reports the errors of the others."""
        node = tree.find(self.root, ["axes"])
        found = []
        for index, child in enumerate(node.value if node is not None and node.is_list else []):
            try:
                axis = Axis.model_validate(tree.plain(child))
            except ValidationError:
                continue
            if axis.steps[0] in Scenario.model_fields:
                found.append(WrittenAxis(axis, child))
            else:
                message = _no_field(axis.path, Scenario, axis.steps[0], tree.hint(axis.path, Scenario.model_fields))
                self.mistakes.append(tree.mistake_at(self.root, f"axes.{index}.path", message))
        return found

    def _with_base_from(self, axes: list[WrittenAxis]) -> tree.Node:
        """Return the tree with the first level of an axis put in for each varied field that the base does not have."""
        base = tree.find(self.root, ["base"])
        if base is None:
            self._validate(self.root, Campaign, "")
            self._raise()
        if base is None or not base.is_map:
            return self.root
        for varied in axes:
            path = varied.axis.steps
            entry = len(path) == 2 and fields.entries(Scenario.model_fields[path[0]].annotation) is not None
            if (entry or len(path) == 1) and tree.find(base, path) is None:
                base = tree.put(base, path, varied.levels[0])
        return tree.put(self.root, ["base"], base)

    def _levels(self, base: tree.Node, varied: WrittenAxis, index: int) -> list[tree.Node]:
        """Return the levels of an axis with cards expanded; no levels if the path of the axis does not exist."""
        path = varied.axis.steps
        kind, _ = _kind_at(base, path)
        if kind is None:
            self.mistakes.append(tree.mistake_at(varied.node, "path", _unknown(base, path), f"axes.{index}"))
            return []
        found = []
        for number, level in enumerate(varied.levels):
            n_before = len(self.mistakes)
            found.append(self._expand(level, kind, ".".join(("base", *path))))
            if len(self.mistakes) > n_before:
                self.unread.add((index, number))
        return found

    def _tried(
        self, cases: WrittenCases, axes: list[WrittenAxis], levels: list[list[tree.Node]]
    ) -> list[list[dict[str, Any]]]:
        """Return for every level of every axis the validated section of a scenario with this level, as plain data."""
        first = first_cases(self.design, axes, [len(values) for values in levels])
        found: list[list[dict[str, Any]]] = []
        for place, (varied, values) in enumerate(zip(axes, levels, strict=True)):
            section = varied.axis.steps[0]
            found.append([])
            for index in range(len(values)):
                if (place, index) in self.unread:
                    continue
                scenario = self._having(cases, place, index, first.get((place, index)))
                if scenario is not None:
                    found[-1].append(scenario.model_dump(mode="json", include={section}))
        return found

    def _having(self, cases: WrittenCases, place: int, index: int, first: design.Chosen | None) -> Scenario | None:
        """Return a scenario with a level of an axis: of the first case that has the level or, if that is not valid, the
        base with this level alone, whose input errors are collected.
        """
        if first is not None and cases.is_whole:
            try:
                return cases.scenario(first)
            except (InputError, ValidationError):
                pass
        alone = tuple(index if axis == place else None for axis in range(len(cases.axes)))
        return self._case(cases, alone)

    def _whole(self, varied: WrittenAxis, plain: list[Any], index: int) -> Axis:
        """Return the axis with complete values in place of cards, and a label for every level."""
        axis = varied.axis
        names = [design.level_label(axis, number) for number in range(len(plain))]
        if axis.labels is None:  # different levels with equal labels get a number
            alike = [[other for other, name in enumerate(names) if name == label] for label in names]
            names = [
                name if all(plain[k] == plain[number] for k in same) else f"{name}#{same.index(number) + 1}"
                for number, (name, same) in enumerate(zip(names, alike, strict=True))
            ]
        self.mistakes += checks.bad_levels(self.design, varied, plain, names, index)
        return axis.model_copy(
            update={"path": ".".join(axis.steps), "cards": None, "values": tuple(plain), "labels": tuple(names)}
        )

    def _check_cases(self, cases: WrittenCases, whole: Campaign) -> None:
        """Check the rules between settings in every case; an error has the place of the field that breaks the rule."""
        for chosen in design.chosen_levels(whole):
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


def _kind_at(base: tree.Node, path: list[str]) -> tuple[Any, tree.Node | None]:
    """Return the annotation and the node at a path of the base; (None, None) if the path does not exist."""
    kind: Any = Scenario
    node: tree.Node | None = base
    for key in path:
        below = tree.find(node, [key]) if node is not None else None
        kind = None if fields.item(kind, 0) is not None and below is None else fields.child(kind, key, node)
        node = below
        if kind is None:
            return None, None
    return kind, node


def _unknown(base: tree.Node, path: list[str]) -> str:
    depth = next(depth for depth in range(len(path)) if _kind_at(base, path[: depth + 1])[0] is None)
    kind, node = _kind_at(base, path[:depth])
    return _no_field(".".join(path), kind, path[depth], tree.hint(path[depth], fields.names(kind, node)))


def _no_field(path: str, kind: Any, key: str, near: str) -> str:
    """Return the message for a path that does not exist: no such key, or the replacement of a former key."""
    old = fields.old_key(kind, key)
    return f"{quoted(path)}: {old}" if old else f"{quoted(path)} is not a field of the base{near}"


def apply(root: tree.Node, assignment: str, shelf: Shelf) -> tree.Node:
    """Return the campaign's tree with one assignment applied; InputError if the assignment is invalid."""
    text, equals, value = assignment.partition("=")
    if not equals or not text.strip():
        raise InputError(f"{tree.HERE} {quoted(assignment)}: should be path=value, such as monte_carlo.runs=500")
    path = full_path(text.strip(), tree.HERE)
    _refuse_varied(root, path)
    return _set(root, path, _value(value, path), Campaign, shelf, "")


def full_path(text: str, where: str) -> list[str]:
    """Return the steps of a dotted path from the top of the campaign; `base.` may be omitted."""
    path = text.split(".")
    if path[0] in Campaign.model_fields:
        return path
    if path[0] in Scenario.model_fields:
        return ["base", *path]
    known, old = (*Campaign.model_fields, *Scenario.model_fields), fields.old_key(Scenario, path[0])
    near = tree.hint(path[0], known) or f" (known: {', '.join(known)})"
    raise InputError(f"{where}: {text}: {old or f'unknown path{near}'}")


def _value(text: str, path: list[str]) -> tree.Node:
    """Return the YAML value of an assignment, which has no place in a file."""
    where = nowhere(tree.HERE)
    if not text.strip():
        raise tree.refuse(where, ".".join(path), "has no value after '='")
    try:
        return tree.from_plain(tree.plain(tree.parse(text, tree.HERE, where.folder)), where)
    except InputError as error:
        raise tree.refuse(where, ".".join(path), f"{quoted(text)}: {error.records[0].message}") from None


def _refuse_varied(root: tree.Node, path: list[str]) -> None:
    """Refuse to set a field that an axis varies: the axis would silently override the assignment."""
    axes = tree.find(root, ["axes"])
    if path[0] != "base" or axes is None or not axes.is_list:
        return
    for index, axis in enumerate(axes.value):
        varied = tree.find(axis, ["path"])
        steps = str(varied.value).removeprefix("base.").split(".") if varied else []
        if steps and steps == path[1 : 1 + len(steps)]:
            message = f"is varied by axis {index} ({varied.value if varied else ''}); set axes.{index} instead"
            raise tree.refuse(nowhere(tree.HERE), ".".join(path), message)


def _set(node: tree.Node, path: list[str], value: tree.Node, kind: fields.Kind, shelf: Shelf, at: str) -> tree.Node:
    """Return `node` with `value` at `path`; a card on the way is expanded first."""
    if not path:
        return value
    key, rest = path[0], path[1:]
    if fields.models(kind) and (isinstance(node.value, str) or tree.find(node, ["card"])):
        node = expanded(node, kind, shelf, at)
    if fields.item(kind, 0) is not None:
        items = node if node.is_list else tree.Node([], node.place)
        index = tree.index_of(key, items.value, value.place, at)
        item = _set(items.value[index], rest, value, fields.item(kind, index), shelf, tree.join(at, key))
        return tree.with_item(items, index, item)
    now = fields.member(kind, node) if len(fields.models(kind)) > 1 else None
    if now is not None and key in fields.names(kind) and key not in fields.by_key(now):  # it makes it another kind
        return tree.put(tree.Node({}, value.place), path, value)
    if key not in fields.names(kind) and fields.entries(kind) is None:
        near = fields.old_key(kind, key) or f"unknown path{tree.hint(key, fields.names(kind, node))}"
        raise tree.refuse(value.place, tree.join(at, key), near)
    start = node if node.is_map else tree.Node({}, value.place)
    old = start.value.get(key, tree.Node(None, value.place))
    below = fields.child(kind, key, start)
    found = _set(old, rest, value, below, shelf, tree.join(at, key))
    return tree.with_child(marked.unmarked_at(start, path), key, found, start.keys.get(key))
