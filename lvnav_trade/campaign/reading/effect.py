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
    within : Settings within it.
    counts : Path whose reading counts as a reading of this setting.
    is_whole : Whether reading anything within counts as well.
    is_card : Whether the settings within are fields of a card.
    must_act : Whether it must have an effect.
    is_override : Whether it overrides a field of a card.
    is_own : Whether it is given in the campaign itself, not in a card.
    """

    path: str
    place: Place
    within: tuple["GivenSetting", ...]
    counts: str
    is_whole: bool
    is_card: bool
    must_act: bool
    is_override: bool
    is_own: bool

    @property
    def shown(self) -> str:
        """The path for messages; a word in a list has the path of the list."""
        above, _, last = self.path.rpartition(".")
        return f"base.{above if is_index(last) and not self.is_whole else self.path}"


class _SettingReader:
    """Converts expanded trees into given settings; only settings in the files `own` count as given by the user."""

    def __init__(self, own: Collection[str]) -> None:
        self.own = own

    def is_own(self, place: Place) -> bool:
        return place.file in self.own

    def given_setting(
        self,
        node: Node,
        kind: Any,
        path: str,
        place: Place,
        counts: str = "",
        is_free: bool = True,
        is_override: bool = False,
    ) -> GivenSetting:
        """Return the setting of a node; counts: path whose reading counts for it; is_free: it could be omitted."""
        is_whole = _has_readable_content(node, kind)
        is_own = self.is_own(place) or (not is_whole and self.is_own(node.place))
        is_required_section = is_whole and path in _REQUIRED_SECTIONS
        # a value of null says that there is no such thing, and so needs no effect
        must_act = is_free and is_own and node.value is not None and not is_required_section
        is_from_command_line = node.place.file == HERE and not is_whole
        return GivenSetting(
            path=path,
            place=node.place if is_from_command_line else place,
            within=tuple(setting for setting in self._within(node, kind, path) if setting.must_act or setting.within),
            counts=counts or path,
            is_whole=is_whole,
            is_card=node.is_map and fields.entries(kind) is None,
            must_act=must_act or _STATE_LISTS.fullmatch(path) is not None,
            is_override=is_override,
            is_own=is_own,
        )

    def _within(self, node: Node, kind: Any, path: str) -> Iterator[GivenSetting]:
        if node.is_map:
            yield from self._fields(node, kind, path)
        elif node.is_list:
            for number, child in enumerate(node.value):
                item_kind = fields.item(kind, number)
                item_path = join(path, number)
                if fields.models(item_kind):
                    yield self.given_setting(child, item_kind, item_path, child.place)
                elif fields.literals(item_kind):
                    yield self.given_setting(child, item_kind, item_path, child.place, counts=path)

    def _fields(self, node: Node, kind: Any, path: str) -> Iterator[GivenSetting]:
        """Yield the settings in a mapping: fields of a card, or entries with free keys."""
        entry_kind = fields.entries(kind)
        model = fields.member(kind, node)
        is_inline = self.is_own(node.place)
        for key, child in node.value.items():
            child_kind = entry_kind
            if not child_kind and model:
                child_kind = fields.child(model, key)
            if child_kind is None or (model is not None and key in _DESCRIPTIONS):
                continue
            info = fields.by_key(model).get(key) if model is not None else None
            is_required = info is not None and info.is_required()
            is_in_same_file = is_inline and child.place.file == node.place.file  # not set on the command line
            is_field = entry_kind is None or (child.is_map and fields.models(entry_kind))
            yield self.given_setting(
                child,
                child_kind,
                join(path, key),
                node.keys[key],
                counts="" if is_field else path,
                is_free=not (is_in_same_file and is_required),
                is_override=not is_inline,
            )


def _has_readable_content(node: Node, kind: Any) -> bool:
    """Whether a node has content whose reading counts as a reading of the node.

    The word `kind` and entries of null do not count.
    """
    if node.is_map:
        entry = fields.entries(kind)
        if entry is not None and not fields.models(entry):
            return False  # a mapping of plain values with free keys is read as a whole
        return any(child.value is not None for key, child in node.value.items() if key not in _DESCRIPTIONS)
    return node.is_list and bool(node.value) and bool(fields.models(fields.item(kind, 0)))


class _Root(NamedTuple):
    """Settings of the base or of a level of an axis."""

    axis: int  # index of the axis; -1 for the base
    level: int
    setting: GivenSetting

    def demands(self) -> Iterator[GivenSetting]:
        """Yield all settings that must have an effect."""
        waiting = [self.setting]
        while waiting:
            setting = waiting.pop()
            waiting += setting.within
            if setting.must_act:
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

    def next(self, known: Mapping[str, EffectiveSettings | None]) -> Case | None:
        """Return the case to prepare next: the case with most settings that have shown no effect yet.

        None if no further case can show an effect. known : effective settings by digest of the prepared cases.
        """
        unproven = []
        for root in self.roots:
            for setting in root.demands():
                prepared_settings = self._effective_settings(root, setting, known)
                if not any(_acts(setting, effective) for effective in prepared_settings):
                    unproven.append((root, setting))
        best_case, most_settings = None, 0
        for case in self.cases:
            if case.id not in known:
                n_settings = sum(self._has_setting(root, setting, case) for root, setting in unproven)
                if n_settings > most_settings:
                    best_case, most_settings = case, n_settings
        return best_case

    def mistakes(self, known: Mapping[str, EffectiveSettings | None]) -> list[Mistake]:
        """Return an input error for every setting without effect on any case.

        known : effective settings by digest of the prepared cases.
        """
        errors: list[Mistake] = []
        for root in self.roots:
            errors += self._fruitless(root, root.setting, known)
        return list(dict.fromkeys(errors))

    def _fruitless(
        self, root: _Root, setting: GivenSetting, known: Mapping[str, EffectiveSettings | None]
    ) -> list[Mistake]:
        """Return the errors of a setting without effect: one for the setting, or those of the settings within it."""
        within: list[Mistake] = []
        for below in setting.within:
            within += self._fruitless(root, below, known)
        message, is_idle = self._message(root, setting, known)
        combines_fields = setting.is_card and len(within) > 1
        if not message or (within and not is_idle and not combines_fields):
            return within
        return [tree.mistake(setting.place, setting.shown, message)]

    def _message(
        self, root: _Root, setting: GivenSetting, known: Mapping[str, EffectiveSettings | None]
    ) -> tuple[str, bool]:
        """Return the message if a setting has no effect, and whether it is read nevertheless; else an empty message.

        The message is also empty if a case with the setting has not been prepared.
        """
        if not setting.must_act:
            return "", False
        cases = [case for case in self.cases if self._has_setting(root, setting, case)]
        if not cases:
            return self._replaced(root, setting), False
        idle_reason = ""
        for case in cases:
            effective = known.get(case.id)
            if effective is None or _acts(setting, effective):
                return "", False
            idle_reason = idle_reason or _idle_reason(setting, effective)
        return idle_reason or _unread_message(setting.path, cases[0].scenario), bool(idle_reason)

    def _replaced(self, root: _Root, setting: GivenSetting) -> str:
        """Return the message if an axis replaces an overridden field of a card in every case, else an empty message.

        The varied field itself and settings without a card may be given in the base, since the base is complete.
        """
        has_case = root.axis < 0 or any(chosen[root.axis] == root.level for chosen in self.levels.values())
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
        chosen = self.levels[case.id]
        if root.axis >= 0 and chosen[root.axis] != root.level:
            varied_path = ".".join(self.steps[root.axis])
            is_value = not setting.is_whole and setting.path == varied_path
            if not is_value or chosen[root.axis] is None or self.campaign.design == "zip":
                return False
        for axis in range(root.axis + 1, len(chosen)):
            if chosen[axis] is not None and _is_within(setting.path, self.steps[axis]):
                return False  # replaced by a later axis
        return True

    def _effective_settings(
        self, root: _Root, setting: GivenSetting, known: Mapping[str, EffectiveSettings | None]
    ) -> Iterator[EffectiveSettings]:
        """Yield the effective settings of the prepared cases that have a setting."""
        for case in self.cases:
            effective = known.get(case.id)
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
    written = campaign.written
    base = tree.find(written.root, ["base"]) if written.root is not None else None
    if base is None or written.root is None:
        return
    has_all_sections = {*written.root.value} >= {*Campaign.model_fields}
    is_resolved = has_all_sections and {*base.value} >= {*Scenario.model_fields}
    files = (HERE,) if is_resolved else (HERE, written.root.place.file)
    reader = _SettingReader(files)
    base_setting = reader.given_setting(base, Scenario, "", base.place, is_free=False)
    varied_paths = {".".join(axis.steps) for axis in campaign.axes}
    filled = varied_paths & written.filled
    unfilled = tuple(_without(base_setting.within, filled))
    yield _Root(-1, 0, base_setting._replace(within=unfilled))
    axis_levels = zip(campaign.axes, written.levels, strict=True)
    for number, (axis, levels) in enumerate(axis_levels):
        annotation = _kind_at(base, axis.steps)
        path = ".".join(axis.steps)
        for level, (node, place) in enumerate(levels):
            setting = reader.given_setting(node, annotation, path, place)
            yield _Root(number, level, setting)


def _kind_at(base: Node, steps: Sequence[str]) -> Any:
    """Return the annotation at a path of the base."""
    kind: Any = Scenario
    node: Node | None = base
    for key in steps:
        kind = fields.child(kind, key, node)
        node = tree.find(node, [key]) if node is not None else None
    return kind


def _without(settings: Sequence[GivenSetting], paths: Collection[str]) -> Iterator[GivenSetting]:
    """Yield settings except those at `paths`, where the first level of an axis was put into the base."""
    for setting in settings:
        if setting.path not in paths:
            yield setting._replace(within=tuple(_without(setting.within, paths)))


def _acts(setting: GivenSetting, effective: EffectiveSettings) -> bool:
    """Whether a setting has an effect on a case: it, or a setting within it, is read and not idle."""
    if _idle_reason(setting, effective):
        return False
    if any(_is_within(setting.path, path.split(".")) for path in effective.whole):
        return True
    if not setting.is_whole and setting.counts in effective.read:
        return True
    if not setting.is_whole and not setting.is_card:
        return False
    return any(path.startswith(f"{setting.path}.") for path in effective.read)


def _idle_reason(setting: GivenSetting, effective: EffectiveSettings) -> str:
    """Return the reason why a setting has no effect although it is read; empty if there is none."""
    steps = setting.path.split(".")
    for depth in range(1, len(steps) + 1):
        path = ".".join(steps[:depth])
        if path in effective.idle and (setting.is_own or path not in effective.exact):
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
