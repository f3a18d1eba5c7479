"""Cases of a campaign from its axes: designs (grid, zip, one at a time), labels and digests."""

import hashlib
import itertools
import json
import re
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from lvnav_trade.campaign.definition.schema import Axis, Campaign
from lvnav_trade.campaign.syntax import fields
from lvnav_trade.campaign.syntax.tree import is_index
from lvnav_trade.quantities import expression
from lvnav_trade.quantities.input_files import read_bytes
from lvnav_trade.quantities.input_limits import DATA_BYTES
from lvnav_trade.quantities.marks import MARKS, unmarked
from lvnav_trade.quantities.shared_cards import Resources
from lvnav_trade.scenario.rules import breaches_of_case
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.trajectory.ascent.vehicle_cards import VehicleAscent

RESULTS_VERSION = 1  # raised when the same scenario and seed no longer give the same numbers

BASE_LABEL = "base"
_LONG = re.compile(
    r"^[+-]?(?=[\d.]{8})\d*\.\d+(?:[eE][+-]?\d+)?(?= |$)"
)  # a number with many digits, followed by its unit


class Case(NamedTuple):
    """One design point of a campaign."""

    id: str  # digest, 12 hexadecimal digits
    label: str  # such as "imu=tactical_fog, filter=tight"
    axes: dict[str, str]  # label of the level by name of the axis
    scenario: Scenario  # complete settings


def levels(design: str, sizes: Sequence[int], crossed: Sequence[int] = ()) -> Iterator[tuple[int | None, ...]]:
    """Yield for each case the level of every axis; None is the value of the base.

    In the design one_at_a_time, the axes with the indices `crossed` take each of their levels in every case of the
    other axes.
    """
    if not sizes:
        yield ()
    elif design == "grid":
        yield from itertools.product(*(range(size) for size in sizes))
    elif design in ("zip", "latin_hypercube", "sobol"):
        yield from ((index,) * len(sizes) for index in range(sizes[0]))
    else:
        at_base = [range(size) if axis in crossed else (None,) for axis, size in enumerate(sizes)]
        yield from itertools.product(*at_base)
        for axis, size in enumerate(sizes):
            if axis not in crossed:
                yield from itertools.product(*[range(size) if k == axis else each for k, each in enumerate(at_base)])


def combinations(
    design: str,
    axes: Sequence[Axis],
    exclude: Sequence[Mapping[str, str | Sequence[str]]] = (),
    constraints: Sequence[str] = (),
    base: Mapping[str, Any] | None = None,
) -> list[tuple[int | None, ...]]:
    """Return for each case the level of every axis, as `levels`.

    Cases that are excluded or violate a constraint are omitted, and so are cases that equal another because of `when`.

    base : the base scenario; constraints use its value of an axis at level None
    """
    names = axis_names(axes)
    found: dict[tuple[int | None, ...], None] = {}
    crossed = [place for place, axis in enumerate(axes) if axis.crossed]
    for chosen in levels(design, [len(axis.values or axis.cards or ()) for axis in axes], crossed):
        labels = choice(axes, chosen)
        nested: list[int | None] = []
        for axis, name, index in zip(axes, names, chosen, strict=True):
            nested.append(index if _has(labels, axis.when) else None)
            labels[name] = labels[name] if nested[-1] is not None else BASE_LABEL
        if not any(one and _has(labels, one) for one in exclude) and all(
            _keeps(one, axes, nested, base or {}) for one in constraints
        ):
            found.setdefault(tuple(nested))
    return list(found)


def _has(labels: Mapping[str, str], wanted: Mapping[str, str | Sequence[str]]) -> bool:
    """Whether every axis named has its level, or one of its levels."""
    return all(labels.get(name) in ([one] if isinstance(one, str) else one) for name, one in wanted.items())


def sides(constraint: str) -> tuple[str, str, str]:
    """Return left side, comparison and right side of a constraint; ValueError if the text is not a comparison."""
    parts = re.split(r"(<=|>=|<|>)", constraint)
    if len(parts) != 3:
        raise ValueError("should compare two expressions, such as 'update_rate <= covariance_rate'")
    left, comparison, right = parts
    for side in (left, right):
        expression.names(side)
    return left, comparison, right


def _keeps(constraint: str, axes: Sequence[Axis], chosen: Sequence[int | None], base: Mapping[str, Any]) -> bool:
    """Whether a combination satisfies a constraint; ValueError names an axis without numbers."""
    left, comparison, right = sides(constraint)
    values = {
        name: get(base, axis.steps) if index is None else (axis.values or ())[index]
        for name, axis, index in zip(axis_names(axes), axes, chosen, strict=True)
    }
    numbers = {name: _number(name, values) for name in (*expression.names(left), *expression.names(right))}
    a, b = (float(expression.evaluate(side, numbers)) for side in (left, right))
    return {"<=": a <= b, ">=": a >= b, "<": a < b, ">": a > b}[comparison]


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
    value = (axis.values or ())[index]
    if isinstance(value, Mapping):
        return str(value.get("name") or value.get("card") or index)
    return "none" if value is None else _rounded(axis.values or ())[index]


def _rounded(values: Sequence[Any]) -> list[str]:
    """Return values as text, with numbers rounded to six digits unless this makes two values equal."""
    texts = [_LONG.sub(lambda found: f"{float(found[0]):.6g}", str(value)) for value in values]
    return texts if len(set(texts)) == len(texts) else [str(value) for value in values]


def axis_names(axes: Sequence[Axis]) -> tuple[str, ...]:
    """Return a short name for each axis: the last word of its path, or the whole path if that word is not unique."""
    short = [axis.path.rpartition(".")[2] for axis in axes]
    return tuple(
        name if short.count(name) == 1 and not is_index(name) else axis.path.removeprefix("base.")
        for name, axis in zip(short, axes, strict=True)
    )


def choice(axes: Sequence[Axis], chosen: Sequence[int | None]) -> dict[str, str]:
    """Return the label of the level of a case, by name of the axis."""
    return {
        name: BASE_LABEL if index is None else level_label(axis, index)
        for name, axis, index in zip(axis_names(axes), axes, chosen, strict=True)
    }


def case_label(axes: Mapping[str, str]) -> str:
    """Return the label of a case."""
    if not axes or all(level == BASE_LABEL for level in axes.values()):
        return BASE_LABEL
    return ", ".join(f"{name}={level}" for name, level in axes.items() if level != BASE_LABEL)


Chosen = tuple[int | None, ...]
"""Index of the level of every axis; None is the value of the base."""


class _CaseCache:
    """Cached scenarios and cases of a loaded campaign, as long as the campaign is in use."""

    def __init__(self, campaign: Campaign, scenarios: "Scenarios | None" = None) -> None:
        place = id(campaign)
        self.campaign = weakref.ref(campaign, lambda _: _KNOWN.pop(place, None))
        self.scenarios = scenarios
        self.cases: tuple[Case, ...] = ()


_KNOWN: dict[int, _CaseCache] = {}  # by identity: a campaign is frozen, so its cases never change


def remember(campaign: Campaign, scenarios: "Scenarios") -> None:
    """Cache the scenarios validated while a campaign was read, so that `cases` need not validate them again."""
    _KNOWN[id(campaign)] = _CaseCache(campaign, scenarios)


def cases(campaign: Campaign) -> list[Case]:
    """Return the cases of a loaded campaign in the order of its design; equal scenarios are one case."""
    known = _KNOWN.get(id(campaign))
    if known is None or known.campaign() is not campaign:
        known = _KNOWN[id(campaign)] = _CaseCache(campaign)
    if not known.cases:
        known.cases = tuple(_cases(campaign, known.scenarios))
        known.scenarios = None
    return list(known.cases)


def probes(campaign: Campaign) -> list[Case]:
    """Return the cases in which input errors are looked for.

    These are all cases of a campaign. For a design space they are the base and the two ends of each axis alone, without
    those that break a rule between settings.
    """
    checked = cases(campaign.probe)
    if not campaign.is_space:
        return checked
    return [case for case in checked if not any(breaches_of_case(case.scenario))]


def _cases(campaign: Campaign, scenarios: "Scenarios | None") -> list[Case]:
    found: dict[str, Case] = {}
    base = campaign.base.model_dump(mode="json")
    made = Scenarios([axis.steps[0] for axis in campaign.axes], campaign.base) if scenarios is None else scenarios
    known: dict[int, tuple[BaseModel, Any]] = {}
    for chosen in chosen_levels(campaign):
        scenario = made.known(chosen)
        if scenario is None:
            scenario = made.validated(chosen, _changed(base, campaign.axes, chosen))
        axes = choice(campaign.axes, chosen)
        digest = case_id(scenario, campaign.seed, campaign.keep.history, known)
        found.setdefault(digest, Case(digest, case_label(axes), axes, scenario))
    return list(found.values())


def _changed(base: Mapping[str, Any], axes: Sequence[Axis], chosen: Chosen) -> Any:
    """Return the base as plain data, with the chosen levels of the axes put in."""
    data: Any = base
    for axis, index in zip(axes, chosen, strict=True):
        if index is not None:
            data = put(data, axis.steps, (axis.values or ())[index])
    return data


class Scenarios:
    """Scenarios of a design, each validated once; cases share the sections that they have in common.

    Parameters
    ----------
    varied : sequence of str
        For each axis, the section of the scenario that it varies.
    base : Scenario, optional
        The scenario that the axes change; None if it is not valid by itself.
    plain : callable
        Converts a section as written in a file into dictionaries, lists and scalars.
    """

    def __init__(
        self,
        varied: Sequence[str],
        base: Scenario | None = None,
        plain: Callable[[Any], Any] = lambda written: written,
    ) -> None:
        self._varied = varied
        self._plain = plain
        self._made: dict[Chosen, Scenario] = {}
        self._sections: dict[tuple[str, Chosen], BaseModel] = {}
        if base is not None:
            self._keep((None,) * len(varied), base)

    def known(self, chosen: Chosen) -> Scenario | None:
        """Return the validated scenario with these levels of the axes, or None if there is none yet."""
        return self._made.get(chosen)

    def validated(self, chosen: Chosen, written: Mapping[str, Any]) -> Scenario:
        """Validate the scenario with these levels from its sections as written; raises pydantic's ValidationError."""
        sections = {name: self._sections.get((name, self._levels(name, chosen))) for name in written}
        data = {
            name: self._plain(section) if sections[name] is None else sections[name]
            for name, section in written.items()
        }
        try:
            scenario = Scenario.model_validate(data)
        except ValidationError:  # again from the written values, so that the message quotes these
            return Scenario.model_validate({name: self._plain(section) for name, section in written.items()})
        self._keep(chosen, scenario)
        return scenario

    def _keep(self, chosen: Chosen, scenario: Scenario) -> None:
        self._made[chosen] = scenario
        for name in type(scenario).model_fields:
            section = getattr(scenario, name)
            if isinstance(section, BaseModel):
                self._sections.setdefault((name, self._levels(name, chosen)), section)

    def _levels(self, name: str, chosen: Chosen) -> Chosen:
        return tuple(index for section, index in zip(self._varied, chosen, strict=True) if section == name)


def chosen_levels(campaign: Campaign) -> list[tuple[int | None, ...]]:
    """Return for each case of a loaded campaign the level of every axis."""
    base = campaign.base.model_dump(mode="json") if campaign.constraints else None
    return combinations(campaign.design, campaign.axes, campaign.exclude, campaign.constraints, base)


def put(data: Any, path: Sequence[str], value: Any) -> Any:
    """Return a copy of nested dictionaries and lists with `value` at `path`."""
    if not path:
        return value
    if isinstance(data, list):
        copy = list(data)
        copy[int(path[0])] = put(copy[int(path[0])], path[1:], value)
        return copy
    data = unmarked(data or {}, path)  # {}: a section not given; the marks of the replaced value are removed
    return {**data, path[0]: put(data.get(path[0]), path[1:], value)}


def get(data: Any, path: Sequence[str]) -> Any:
    """Return the value at a path of nested dictionaries and lists; None if there is none."""
    for key in path:
        if isinstance(data, list) and is_index(key) and int(key) < len(data):
            data = data[int(key)]
        else:
            data = data.get(key) if isinstance(data, dict) else None
    return data


def case_id(
    scenario: Scenario, seed: int, history: float, known: dict[int, tuple[BaseModel, Any]] | None = None
) -> str:
    """Return the digest of a case: 12 hexadecimal digits.

    The digest covers the scenario, the seed, the step of the history (s) and the version of the results. The step is
    included because covariance steps are cut at history times. A file named in the scenario enters by its content and
    not by its path: a copy of the campaign in another folder has the same digest, an edited almanac gives another.

    known : cache of fields by identity, each with its content; extended here. It keeps a reference to the field, so
        that no new object gets the same identity
    """
    data = {
        "scenario": _undrawn(_canonical(scenario, known), scenario),
        "seed": seed,
        "history": history,
        "results_version": RESULTS_VERSION,
    }
    return hashlib.sha256(json.dumps(data, sort_keys=True, separators=(",", ":")).encode()).hexdigest()[:12]


def _undrawn(found: dict[str, Any], scenario: Scenario) -> dict[str, Any]:
    """Return the content of a scenario without vehicle dispersions that no run draws (nominal guidance)."""
    card = scenario.trajectory
    if not isinstance(card, VehicleAscent) or card.guidance != "nominal":
        return found
    flight = found["trajectory"]
    vehicle = {key: value for key, value in flight["vehicle"].items() if key != "dispersions"}
    return {**found, "trajectory": {**flight, "vehicle": vehicle}}


def _canonical(model: BaseModel, known: dict[int, tuple[BaseModel, Any]] | None = None) -> dict[str, Any]:
    kind, without, below = type(model), set(), {}
    for name in kind.model_fields:
        value = getattr(model, name)
        extra = kind.model_fields[name].json_schema_extra
        unset = isinstance(extra, dict) and extra.get("digest_if_set") and value == kind.model_fields[name].default
        if unset or name in MARKS or isinstance(value, Resources) or (name == "resources" and value is None):
            without.add(name)
        elif isinstance(value, BaseModel):
            _, found = (known or {}).get(id(value), (None, None))
            below[name] = _canonical(value) if found is None else found
            if known is not None:
                known[id(value)] = value, below[name]
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            below[name] = [_canonical(item) for item in value]
        elif isinstance(value, dict):
            below[name] = {k: _canonical(one) if isinstance(one, BaseModel) else one for k, one in value.items()}
        elif isinstance(value, str) and fields.is_path(kind, name):
            below[name] = _content(value)
        elif isinstance(value, tuple) and fields.is_path(kind, name):
            below[name] = [_content(item) for item in value]
    return model.model_dump(mode="json", exclude={*below, *without}) | below


def _content(file: str) -> str:
    return hashlib.sha256(read_bytes(file, DATA_BYTES)).hexdigest()
