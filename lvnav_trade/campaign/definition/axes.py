"""Cases of a campaign from its axes: designs (grid, zip, one at a time), labels and digests."""

import itertools
import operator
import re
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from lvnav_trade.campaign.definition.case_digest import case_id
from lvnav_trade.campaign.definition.schema import Axis, Campaign
from lvnav_trade.campaign.syntax.tree import is_index
from lvnav_trade.quantities import expression
from lvnav_trade.quantities.marks import without_field_marks
from lvnav_trade.scenario.rules import case_breaches
from lvnav_trade.scenario.scenario import Scenario

BASE_LABEL = "base"
_COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}
_LONG = re.compile(
    r"^[+-]?(?=[\d.]{8})\d*\.\d+(?:[eE][+-]?\d+)?(?= |$)"
)  # a number with many digits, followed by its unit


LevelIndices = tuple[int | None, ...]
"""Index of the level of every axis; None is the value of the base."""


class Case(NamedTuple):
    """One design point of a campaign."""

    id: str  # digest, 12 hexadecimal digits
    label: str  # such as "imu=tactical_fog, filter=tight"
    axes: dict[str, str]  # label of the level by name of the axis
    scenario: Scenario  # complete settings


def levels(design: str, sizes: Sequence[int], crossed_axes: Sequence[int] = ()) -> Iterator[LevelIndices]:
    """Yield for each case the level of every axis; None is the value of the base.

    In the design one_at_a_time, the axes with the indices `crossed_axes` take each of their levels in every case of the
    other axes.

    Parameters
    ----------
    design : str
        Design of the campaign, such as grid, zip or one_at_a_time.
    sizes : sequence of int
        Number of levels of each axis.
    crossed_axes : sequence of int
        Indices of the crossed axes.
    """
    if not sizes:
        yield ()
    elif design == "grid":
        yield from itertools.product(*(range(size) for size in sizes))
    elif design in ("zip", "latin_hypercube", "sobol"):
        for index in range(sizes[0]):
            yield (index,) * len(sizes)
    else:
        base_ranges: list[Sequence[int | None]] = [
            range(size) if axis in crossed_axes else (None,) for axis, size in enumerate(sizes)
        ]
        yield from itertools.product(*base_ranges)
        for axis, size in enumerate(sizes):
            if axis not in crossed_axes:
                case_ranges = [*base_ranges[:axis], range(size), *base_ranges[axis + 1 :]]
                yield from itertools.product(*case_ranges)


def combinations(
    design: str,
    axes: Sequence[Axis],
    exclude: Sequence[Mapping[str, str | Sequence[str]]] = (),
    constraints: Sequence[str] = (),
    base: Mapping[str, Any] | None = None,
) -> list[LevelIndices]:
    """Return for each case the level of every axis, as `levels`.

    Cases that are excluded or violate a constraint are omitted, and so are cases that equal another because of `when`.

    Parameters
    ----------
    design : str
        Design of the campaign.
    axes : sequence of Axis
        The axes.
    exclude : sequence of mapping
        Excluded combinations: label, or labels, by name of the axis.
    constraints : sequence of str
        Comparisons of expressions in the names of axes.
    base : mapping, optional
        Base scenario as plain data. Constraints use its value of an axis at level None.
    """
    names = axis_names(axes)  # once: a design space has up to 100 000 cases
    sizes = [len(axis.values or axis.cards or ()) for axis in axes]
    crossed_axes = [number for number, axis in enumerate(axes) if axis.crossed]
    remaining_levels: dict[LevelIndices, None] = {}
    for design_levels in levels(design, sizes, crossed_axes):
        effective_levels, labels = _applied_levels(axes, names, design_levels)
        if any(combination and _has_levels(labels, combination) for combination in exclude):
            continue
        if all(_satisfies(constraint, axes, effective_levels, base or {}) for constraint in constraints):
            remaining_levels.setdefault(effective_levels)
    return list(remaining_levels)


def _applied_levels(
    axes: Sequence[Axis], names: Sequence[str], design_levels: Sequence[int | None]
) -> tuple[LevelIndices, dict[str, str]]:
    """Return the levels of a case and their labels; an axis whose `when` is not satisfied has the value of the base."""
    labels = _labels(axes, names, design_levels)
    effective_levels: list[int | None] = []
    for axis, name, index in zip(axes, names, design_levels, strict=True):
        level = index if _has_levels(labels, axis.when) else None
        if level is None:
            labels[name] = BASE_LABEL
        effective_levels.append(level)
    return tuple(effective_levels), labels


def _has_levels(labels: Mapping[str, str], required_levels: Mapping[str, str | Sequence[str]]) -> bool:
    """Whether each axis in `required_levels` has the level given there, or one of the levels."""
    for name, permitted_labels in required_levels.items():
        if labels.get(name) not in ([permitted_labels] if isinstance(permitted_labels, str) else permitted_labels):
            return False
    return True


def sides(constraint: str) -> tuple[str, str, str]:
    """Return left side, comparison and right side of a constraint; ValueError if the text is not a comparison."""
    tokens = re.split(r"(<=|>=|<|>)", constraint)
    if len(tokens) != 3:
        raise ValueError("should compare two expressions, such as 'update_rate <= covariance_rate'")
    left_side, comparison, right_side = tokens
    for side in (left_side, right_side):
        expression.names(side)
    return left_side, comparison, right_side


def _satisfies(
    constraint: str, axes: Sequence[Axis], level_indices: Sequence[int | None], base: Mapping[str, Any]
) -> bool:
    """Whether a combination satisfies a constraint.

    Parameters
    ----------
    constraint : str
        Comparison of two expressions in the names of axes.
    axes : sequence of Axis
        The axes.
    level_indices : sequence of int or None
        Level of each axis; None is the value of the base.
    base : mapping
        Base scenario as plain data.

    Raises
    ------
    ValueError
        A named axis has no numbers.
    """
    left_side, comparison, right_side = sides(constraint)
    values = {}
    for name, axis, index in zip(axis_names(axes), axes, level_indices, strict=True):
        values[name] = get(base, axis.steps) if index is None else (axis.values or ())[index]
    names = (*expression.names(left_side), *expression.names(right_side))
    numbers = {name: _number(name, values) for name in names}
    left_value = float(expression.evaluate(left_side, numbers))
    right_value = float(expression.evaluate(right_side, numbers))
    return _COMPARISONS[comparison](left_value, right_value)


def _number(name: str, values: Mapping[str, Any]) -> float:
    """Return the number of an axis in SI."""
    if name not in values:
        raise ValueError(f"no axis {name!r}")
    text = str(values[name]).partition(" ")[0]
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"the axis {name!r} has no numbers") from None


def level_label(axis: Axis, index: int) -> str:
    """Return the label of a level: given by the user, or else the file name of the card, or else the value."""
    if axis.labels is not None:
        return axis.labels[index]
    if axis.cards is not None:
        return Path(axis.cards[index]).stem
    values = axis.values or ()
    value = values[index]
    if isinstance(value, Mapping):
        return str(value.get("name") or value.get("card") or index)
    return "none" if value is None else _rounded_texts(values)[index]


def _rounded_texts(values: Sequence[Any]) -> list[str]:
    """Return values as text, with numbers rounded to six digits unless this makes two values equal."""
    exact_texts = [str(value) for value in values]
    rounded_texts = [_LONG.sub(_six_digits, text) for text in exact_texts]
    return rounded_texts if len(set(rounded_texts)) == len(rounded_texts) else exact_texts


def _six_digits(match: re.Match[str]) -> str:
    return f"{float(match[0]):.6g}"


def axis_names(axes: Sequence[Axis]) -> tuple[str, ...]:
    """Return a short name for each axis: the last word of its path, or the whole path if that word is not unique."""
    last_words = [axis.path.rpartition(".")[2] for axis in axes]
    names = []
    for word, axis in zip(last_words, axes, strict=True):
        is_unique = last_words.count(word) == 1 and not is_index(word)
        names.append(word if is_unique else axis.path.removeprefix("base."))
    return tuple(names)


def choice(axes: Sequence[Axis], level_indices: Sequence[int | None]) -> dict[str, str]:
    """Return the label of the level of a case, by name of the axis."""
    return _labels(axes, axis_names(axes), level_indices)


def _labels(axes: Sequence[Axis], names: Sequence[str], level_indices: Sequence[int | None]) -> dict[str, str]:
    labels = {}
    for name, axis, index in zip(names, axes, level_indices, strict=True):
        labels[name] = BASE_LABEL if index is None else level_label(axis, index)
    return labels


def case_label(axes: Mapping[str, str]) -> str:
    """Return the label of a case."""
    varied_levels = [f"{name}={level}" for name, level in axes.items() if level != BASE_LABEL]
    return ", ".join(varied_levels) if varied_levels else BASE_LABEL


class _CaseCache:
    """Cached scenarios and cases of a loaded campaign, as long as the campaign is in use."""

    def __init__(self, campaign: Campaign, scenarios: "Scenarios | None" = None) -> None:
        identity = id(campaign)
        self.campaign = weakref.ref(campaign, lambda _: _CACHES.pop(identity, None))
        self.scenarios = scenarios
        self.cases: tuple[Case, ...] = ()


_CACHES: dict[int, _CaseCache] = {}  # by identity: a campaign is frozen, so its cases never change


def remember(campaign: Campaign, scenarios: "Scenarios") -> None:
    """Cache the scenarios validated while a campaign was read, so that `cases` need not validate them again."""
    _CACHES[id(campaign)] = _CaseCache(campaign, scenarios)


def cases(campaign: Campaign) -> list[Case]:
    """Return the cases of a loaded campaign in the order of its design; equal scenarios are one case."""
    cache = _CACHES.get(id(campaign))
    if cache is None or cache.campaign() is not campaign:
        cache = _CACHES[id(campaign)] = _CaseCache(campaign)
    if not cache.cases:
        cache.cases = tuple(_distinct_cases(campaign, cache.scenarios))
        cache.scenarios = None
    return list(cache.cases)


def probes(campaign: Campaign) -> list[Case]:
    """Return the cases in which input errors are looked for.

    These are all cases of a campaign. For a design space they are the base and the two ends of each axis alone, without
    those with contradictory settings.
    """
    probe_cases = cases(campaign.probe)
    if not campaign.is_space:
        return probe_cases
    return [case for case in probe_cases if not any(case_breaches(case.scenario))]


def _distinct_cases(campaign: Campaign, scenarios: "Scenarios | None") -> list[Case]:
    """Return the cases of a campaign, the first of those with equal digests."""
    base = campaign.base.model_dump(mode="json")
    if scenarios is None:
        scenarios = Scenarios([axis.steps[0] for axis in campaign.axes], campaign.base)
    contents: dict[int, tuple[BaseModel, Any]] = {}
    by_digest: dict[str, Case] = {}
    for level_indices in case_level_indices(campaign):
        scenario = scenarios.find(level_indices)
        if scenario is None:
            scenario = scenarios.validate(level_indices, _scenario_data(base, campaign.axes, level_indices))
        axes = choice(campaign.axes, level_indices)
        digest = case_id(scenario, campaign.seed, campaign.keep.history, contents)
        by_digest.setdefault(digest, Case(digest, case_label(axes), axes, scenario))
    return list(by_digest.values())


def _scenario_data(base: Mapping[str, Any], axes: Sequence[Axis], level_indices: LevelIndices) -> Any:
    """Return the base as plain data, with the chosen levels of the axes put in."""
    data: Any = base
    for axis, index in zip(axes, level_indices, strict=True):
        if index is not None:
            data = with_value(data, axis.steps, (axis.values or ())[index])
    return data


class Scenarios:
    """Scenarios of a design, each validated once; cases share the sections that they have in common.

    Parameters
    ----------
    varied_sections : sequence of str
        For each axis, the section of the scenario that it varies.
    base : Scenario, optional
        The scenario that the axes change; None if it is not valid without them.
    to_plain : callable
        Converts a section as written in a file into dictionaries, lists and scalars.
    """

    def __init__(
        self,
        varied_sections: Sequence[str],
        base: Scenario | None = None,
        to_plain: Callable[[Any], Any] = lambda section: section,
    ) -> None:
        self._varied_sections = varied_sections
        self._to_plain = to_plain
        self._scenarios: dict[LevelIndices, Scenario] = {}
        self._sections: dict[tuple[str, LevelIndices], BaseModel] = {}
        if base is not None:
            self._keep((None,) * len(varied_sections), base)

    def find(self, level_indices: LevelIndices) -> Scenario | None:
        """Return the validated scenario with these levels of the axes, or None if there is none yet."""
        return self._scenarios.get(level_indices)

    def validate(self, level_indices: LevelIndices, sections: Mapping[str, Any]) -> Scenario:
        """Validate the scenario with these levels from its sections as written; raises pydantic's ValidationError."""
        data = {}
        for name, section in sections.items():
            validated_section = self._sections.get((name, self._section_levels(name, level_indices)))
            data[name] = self._to_plain(section) if validated_section is None else validated_section
        try:
            scenario = Scenario.model_validate(data)
        except ValidationError:  # again from the written values, so that the message quotes these
            return Scenario.model_validate({name: self._to_plain(section) for name, section in sections.items()})
        self._keep(level_indices, scenario)
        return scenario

    def _keep(self, level_indices: LevelIndices, scenario: Scenario) -> None:
        """Store a validated scenario and its sections."""
        self._scenarios[level_indices] = scenario
        for name in type(scenario).model_fields:
            section = getattr(scenario, name)
            if isinstance(section, BaseModel):
                self._sections.setdefault((name, self._section_levels(name, level_indices)), section)

    def _section_levels(self, name: str, level_indices: LevelIndices) -> LevelIndices:
        """Return the levels of the axes that vary a section."""
        return tuple(
            index for section, index in zip(self._varied_sections, level_indices, strict=True) if section == name
        )


def case_level_indices(campaign: Campaign) -> list[LevelIndices]:
    """Return for each case of a loaded campaign the level of every axis."""
    base = campaign.base.model_dump(mode="json") if campaign.constraints else None
    return combinations(campaign.design, campaign.axes, campaign.exclude, campaign.constraints, base)


def with_value(data: Any, path: Sequence[str], value: Any) -> Any:
    """Return a copy of nested dictionaries and lists with `value` at `path`.

    Parameters
    ----------
    data : dict, list or None
        Nested data. None is a section that is not given.
    path : sequence of str
        Keys, and indices of lists, from the outside in.
    value : Any
        New value.
    """
    if not path:
        return value
    if isinstance(data, list):
        copy = list(data)
        copy[int(path[0])] = with_value(copy[int(path[0])], path[1:], value)
        return copy
    data = without_field_marks(data or {}, path)  # {}: a section not given; the marks of the replaced value are removed
    return {**data, path[0]: with_value(data.get(path[0]), path[1:], value)}


def get(data: Any, path: Sequence[str]) -> Any:
    """Return the value at a path of nested dictionaries and lists; None if there is none."""
    for key in path:
        if isinstance(data, list) and is_index(key) and int(key) < len(data):
            data = data[int(key)]
        else:
            data = data.get(key) if isinstance(data, dict) else None
    return data
