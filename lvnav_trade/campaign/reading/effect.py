"""Settings without effect: given in a campaign and read by no case."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

from lvnav_trade.campaign.definition.axes import Case, axis_names
from lvnav_trade.campaign.definition.schema import Axis, Campaign
from lvnav_trade.campaign.syntax import fields, tree
from lvnav_trade.campaign.syntax.tree import HERE, Node, Place, is_index, join
from lvnav_trade.quantities.errors import Mistake, quoted
from lvnav_trade.quantities.marks import MARKS
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.settings_read import EffectiveSettings

_DESCRIPTIONS = ("kind", "name", "source", "resources", *MARKS)
# States that no measurement affects are refused in a card too: the user of the filter expects them to be estimated.
_STATE_LISTS = re.compile(r"filter\.(extra_states|consider|as_noise)\.\d+")
# Sections that every case has: as a whole such a section always has an effect.
_REQUIRED_SECTIONS = frozenset(name for name, field in Scenario.model_fields.items() if field.is_required())
_UNREAD = "no effect: nothing that is computed for this campaign reads it"
_HINTS = (
    ("filter.sensor_models.*.latency", "without delay_compensation nothing is compensated"),
    (
        "filter.sensor_models.*.*",
        "no sensor that the filter uses has such an error, or no state of the filter is of it",
    ),
    ("filter.sensor_models.*", "it is not among the measurements, or no sensor of the scenario gives it"),
    ("filter.envelope*", "only a filter with imu among its measurements models the vehicle"),
    ("filter.imu.*", "no state of the filter is of it; name it among the extra states"),
    ("filter.clock", "only a filter that measures ranges has a clock"),
    ("filter.reference_satellite", "clock: differenced has one"),
    ("filter.corrections.ionosphere*", "ranges of two frequencies have no ionospheric delay of first order"),
    ("atmosphere.ionosphere*", "ranges of two frequencies have no ionospheric delay of first order"),
    ("filter.receiver.*", "no state or measurement of the filter is of it"),
    ("receiver.solution.*", "the filter does not take the receiver's solution"),
    ("receiver.tracking*", "it needs antennas, a link or loops"),
)
"""Reason why a setting is not read, by pattern of its path; the first matching pattern applies."""


class GivenSetting(NamedTuple):
    """A setting given by the user, with the settings within it.

    path : Dotted path below the scenario.
    place : File, line and column.
    children : Settings within it.
    read_path : Path whose reading counts as a reading of this setting.
    is_whole : Whether reading anything within counts as well.
    is_card : Whether the settings within are fields of a card.
    must_have_effect : Whether it must have an effect.
    is_override : Whether it overrides a field of a card.
    is_in_campaign : Whether it is given in the campaign itself, not in a card.
    """

    path: str
    place: Place
    children: tuple["GivenSetting", ...]
    read_path: str
    is_whole: bool
    is_card: bool
    must_have_effect: bool
    is_override: bool
    is_in_campaign: bool

    @property
    def message_path(self) -> str:
        """The path for messages; a word in a list has the path of the list."""
        parent_path, _, last = self.path.rpartition(".")
        return f"base.{parent_path if is_index(last) and not self.is_whole else self.path}"


class _SettingReader:
    """Converts expanded trees into given settings; only settings in `files` count as given by the user."""

    def __init__(self, files: Collection[str]) -> None:
        self.files = files

    def is_in_files(self, place: Place) -> bool:
        return place.file in self.files

    def given_setting(
        self,
        node: Node,
        annotation: Any,
        path: str,
        place: Place,
        read_path: str = "",
        is_optional: bool = True,
        is_override: bool = False,
    ) -> GivenSetting:
        """Return the setting of a node.

        read_path : path whose reading counts for the setting; is_optional : whether the setting could be omitted.
        """
        is_whole = _has_readable_content(node, annotation)
        is_in_campaign = self.is_in_files(place) or (not is_whole and self.is_in_files(node.place))
        is_required_section = is_whole and path in _REQUIRED_SECTIONS
        # a value of null says that there is no such thing, and so needs no effect
        must_have_effect = is_optional and is_in_campaign and node.value is not None and not is_required_section
        is_from_command_line = node.place.file == HERE and not is_whole
        children = self._children(node, annotation, path)
        return GivenSetting(
            path=path,
            place=node.place if is_from_command_line else place,
            children=tuple(child for child in children if child.must_have_effect or child.children),
            read_path=read_path or path,
            is_whole=is_whole,
            is_card=node.is_map and fields.entries(annotation) is None,
            must_have_effect=must_have_effect or _STATE_LISTS.fullmatch(path) is not None,
            is_override=is_override,
            is_in_campaign=is_in_campaign,
        )

    def _children(self, node: Node, annotation: Any, path: str) -> Iterator[GivenSetting]:
        if node.is_map:
            yield from self._fields(node, annotation, path)
        elif node.is_list:
            for number, child in enumerate(node.value):
                item_annotation = fields.item(annotation, number)
                item_path = join(path, number)
                if fields.models(item_annotation):
                    yield self.given_setting(child, item_annotation, item_path, child.place)
                elif fields.literals(item_annotation):
                    yield self.given_setting(child, item_annotation, item_path, child.place, read_path=path)

    def _fields(self, node: Node, annotation: Any, path: str) -> Iterator[GivenSetting]:
        """Yield the settings in a mapping: fields of a card, or entries with free keys."""
        entry_annotation = fields.entries(annotation)
        model = fields.member(annotation, node)
        is_inline = self.is_in_files(node.place)
        for key, child in node.value.items():
            child_annotation = entry_annotation
            if not child_annotation and model:
                child_annotation = fields.child(model, key)
            if child_annotation is None or (model is not None and key in _DESCRIPTIONS):
                continue
            info = fields.fields_by_key(model).get(key) if model is not None else None
            is_required = info is not None and info.is_required()
            is_in_same_file = is_inline and child.place.file == node.place.file  # not set on the command line
            is_field = entry_annotation is None or (child.is_map and fields.models(entry_annotation))
            yield self.given_setting(
                child,
                child_annotation,
                join(path, key),
                node.keys[key],
                read_path="" if is_field else path,
                is_optional=not (is_in_same_file and is_required),
                is_override=not is_inline,
            )


def _has_readable_content(node: Node, annotation: Any) -> bool:
    """Whether a node has content whose reading counts as a reading of the node.

    The word `kind` and entries of null do not count.
    """
    if node.is_map:
        entry = fields.entries(annotation)
        if entry is not None and not fields.models(entry):
            return False  # a mapping of plain values with free keys is read as a whole
        return any(child.value is not None for key, child in node.value.items() if key not in _DESCRIPTIONS)
    return node.is_list and bool(node.value) and bool(fields.models(fields.item(annotation, 0)))


class _Root(NamedTuple):
    """Settings of the base or of a level of an axis."""

    axis: int  # index of the axis; -1 for the base
    level: int
    setting: GivenSetting

    def checked_settings(self) -> Iterator[GivenSetting]:
        """Yield all settings that must have an effect."""
        open_settings = [self.setting]
        while open_settings:
            setting = open_settings.pop()
            open_settings += setting.children
            if setting.must_have_effect:
                yield setting


class Effects:
    """Settings given in a campaign, and the cases that have each of them.

    Given settings are those in the campaign file, on the command line, and in the levels of the axes. Fields of cards
    do not count: a card describes a thing, and nobody should have to delete fields of a card for a campaign. For the
    same reason the settings of a resolved campaign do not count, nor do required fields.
    """

    def __init__(self, campaign: Campaign, cases: Sequence[Case]) -> None:
        self.campaign = campaign
        self.cases = cases
        named_axes = list(zip(axis_names(campaign.axes), campaign.axes, strict=True))
        self.levels = {case.id: [_level(case, name, axis) for name, axis in named_axes] for case in cases}
        self.steps = [[*axis.steps] for axis in campaign.axes]
        self.roots = [*_roots(campaign)]

    def next_case(self, effective_by_case: Mapping[str, EffectiveSettings | None]) -> Case | None:
        """Return the case to prepare next: the case with most settings that have shown no effect yet.

        None if no further case can show an effect.

        effective_by_case : effective settings by digest of the prepared cases.
        """
        pending_settings = []
        for root in self.roots:
            for setting in root.checked_settings():
                prepared_settings = self._effective_settings(root, setting, effective_by_case)
                if not any(_has_effect(setting, effective) for effective in prepared_settings):
                    pending_settings.append((root, setting))
        best_case, most_settings = None, 0
        for case in self.cases:
            if case.id not in effective_by_case:
                n_settings = sum(self._has_setting(root, setting, case) for root, setting in pending_settings)
                if n_settings > most_settings:
                    best_case, most_settings = case, n_settings
        return best_case

    def mistakes(self, effective_by_case: Mapping[str, EffectiveSettings | None]) -> list[Mistake]:
        """Return an input error for every setting without effect on any case.

        effective_by_case : effective settings by digest of the prepared cases.
        """
        errors: list[Mistake] = []
        for root in self.roots:
            errors += self._ineffective_errors(root, root.setting, effective_by_case)
        return list(dict.fromkeys(errors))

    def _ineffective_errors(
        self, root: _Root, setting: GivenSetting, effective_by_case: Mapping[str, EffectiveSettings | None]
    ) -> list[Mistake]:
        """Return the errors of a setting without effect: one for the setting, or those of the settings within it."""
        child_errors: list[Mistake] = []
        for child in setting.children:
            child_errors += self._ineffective_errors(root, child, effective_by_case)
        message, is_idle = self._message(root, setting, effective_by_case)
        combines_fields = setting.is_card and len(child_errors) > 1
        if not message or (child_errors and not is_idle and not combines_fields):
            return child_errors
        return [tree.mistake(setting.place, setting.message_path, message)]

    def _message(
        self, root: _Root, setting: GivenSetting, effective_by_case: Mapping[str, EffectiveSettings | None]
    ) -> tuple[str, bool]:
        """Return the message if a setting has no effect, and whether it is read nevertheless; else an empty message.

        The message is also empty if a case with the setting has not been prepared.
        """
        if not setting.must_have_effect:
            return "", False
        cases = [case for case in self.cases if self._has_setting(root, setting, case)]
        if not cases:
            return self._replacement_message(root, setting), False
        idle_reason = ""
        for case in cases:
            effective = effective_by_case.get(case.id)
            if effective is None or _has_effect(setting, effective):
                return "", False
            idle_reason = idle_reason or _idle_reason(setting, effective)
        return idle_reason or _unread_message(setting.path, cases[0].scenario), bool(idle_reason)

    def _replacement_message(self, root: _Root, setting: GivenSetting) -> str:
        """Return the message if an axis replaces an overridden field of a card in every case, else an empty message.

        The varied field itself and settings without a card may be given in the base, since the base is complete.
        """
        has_case = root.axis < 0 or root.level in [indices[root.axis] for indices in self.levels.values()]
        if not has_case or not setting.is_override:
            return ""
        for axis in range(root.axis + 1, len(self.steps)):
            steps = self.steps[axis]
            if _is_within(setting.path, steps) and setting.path != ".".join(steps):
                path = quoted(self.campaign.axes[axis].path)
                return f"no case has it: the axis {path} replaces it; write it in the axis's values"
        return ""

    def _has_setting(self, root: _Root, setting: GivenSetting, case: Case) -> bool:
        """Whether a case has a setting.

        All values that an axis gives to one field are equivalent, because whether a field is read does not depend on
        its value. The exception is a zip, in which levels of several axes belong together.
        """
        level_indices = self.levels[case.id]
        if root.axis >= 0 and level_indices[root.axis] != root.level:
            varied_path = ".".join(self.steps[root.axis])
            is_value = not setting.is_whole and setting.path == varied_path
            if not is_value or level_indices[root.axis] is None or self.campaign.design == "zip":
                return False
        for axis in range(root.axis + 1, len(level_indices)):
            if level_indices[axis] is not None and _is_within(setting.path, self.steps[axis]):
                return False  # replaced by a later axis
        return True

    def _effective_settings(
        self, root: _Root, setting: GivenSetting, effective_by_case: Mapping[str, EffectiveSettings | None]
    ) -> Iterator[EffectiveSettings]:
        """Yield the effective settings of the prepared cases that have a setting."""
        for case in self.cases:
            effective = effective_by_case.get(case.id)
            if effective is not None and self._has_setting(root, setting, case):
                yield effective


def _is_within(path: str, steps: Sequence[str]) -> bool:
    """Whether a path is at or below the field with these steps."""
    leading_steps = path.split(".")[: len(steps)]
    return leading_steps == [*steps]


def _level(case: Case, name: str, axis: Axis) -> int | None:
    """Return the index of the level of an axis in a case; None for the value of the base."""
    labels = axis.labels or ()
    label = case.axes.get(name)
    return labels.index(label) if label in labels else None


def _roots(campaign: Campaign) -> Iterator[_Root]:
    """Yield the settings of the base and of each level of the axes."""
    source_tree = campaign.source_tree
    base = tree.find(source_tree.root, ["base"]) if source_tree.root is not None else None
    if base is None or source_tree.root is None:
        return
    has_all_sections = {*source_tree.root.value} >= {*Campaign.model_fields}
    is_resolved = has_all_sections and {*base.value} >= {*Scenario.model_fields}
    files = (HERE,) if is_resolved else (HERE, source_tree.root.place.file)
    reader = _SettingReader(files)
    base_setting = reader.given_setting(base, Scenario, "", base.place, is_optional=False)
    varied_paths = {".".join(axis.steps) for axis in campaign.axes}
    filled_paths = varied_paths & source_tree.filled_paths
    given_settings = tuple(_remaining_settings(base_setting.children, filled_paths))
    yield _Root(-1, 0, base_setting._replace(children=given_settings))
    axis_levels = zip(campaign.axes, source_tree.levels, strict=True)
    for number, (axis, levels) in enumerate(axis_levels):
        annotation = _annotation_at(base, axis.steps)
        path = ".".join(axis.steps)
        for level, (node, place) in enumerate(levels):
            setting = reader.given_setting(node, annotation, path, place)
            yield _Root(number, level, setting)


def _annotation_at(base: Node, steps: Sequence[str]) -> Any:
    """Return the annotation at a path of the base."""
    annotation: Any = Scenario
    node: Node | None = base
    for key in steps:
        annotation = fields.child(annotation, key, node)
        node = tree.find(node, [key]) if node is not None else None
    return annotation


def _remaining_settings(settings: Sequence[GivenSetting], paths: Collection[str]) -> Iterator[GivenSetting]:
    """Yield settings except those at `paths`, where the first level of an axis was put into the base."""
    for setting in settings:
        if setting.path not in paths:
            yield setting._replace(children=tuple(_remaining_settings(setting.children, paths)))


def _has_effect(setting: GivenSetting, effective: EffectiveSettings) -> bool:
    """Whether a setting has an effect on a case: it, or a setting within it, is read and not idle."""
    if _idle_reason(setting, effective):
        return False
    if any(_is_within(setting.path, path.split(".")) for path in effective.complete_settings):
        return True
    if not setting.is_whole and setting.read_path in effective.read:
        return True
    if not setting.is_whole and not setting.is_card:
        return False
    return any(path.startswith(f"{setting.path}.") for path in effective.read)


def _idle_reason(setting: GivenSetting, effective: EffectiveSettings) -> str:
    """Return the reason why a setting has no effect although it is read; empty if there is none."""
    steps = setting.path.split(".")
    for depth in range(1, len(steps) + 1):
        path = ".".join(steps[:depth])
        if path in effective.idle and (setting.is_in_campaign or path not in effective.exact):
            return effective.idle[path]
    return ""


def _unread_message(path: str, scenario: Scenario) -> str:
    """Return the message for a setting that is not read, with the reason if it is known."""
    steps = path.split(".")
    if steps[0] == "sensors" and len(steps) == 2:
        card = scenario.sensors.get(steps[1])
        if card is not None and card.measurement not in scenario.filter.measurements:
            return f"no effect: {card.measurement} is not among the measurements of any filter"
    for pattern, reason in _HINTS:
        if fnmatchcase(path, pattern):
            return f"no effect: {reason}"
    return _UNREAD
