"""From axes to cases: grid, zip, one at a time; labels and digests."""

import hashlib
import itertools
import json
import re
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from lvnav_trade import expression
from lvnav_trade.campaign.definition.schema import Axis, Campaign
from lvnav_trade.campaign.syntax import fields
from lvnav_trade.campaign.syntax.tree import is_index
from lvnav_trade.input_files import read_bytes
from lvnav_trade.limits import DATA_BYTES
from lvnav_trade.marks import MARKS, unmarked
from lvnav_trade.resources import Resources
from lvnav_trade.rules import breaches_of_case
from lvnav_trade.scenario import Scenario
from lvnav_trade.world.ascent.vehicle import VehicleAscent

RESULTS_VERSION = 1  # raised when the same scenario and seed no longer give the same numbers

BASE_LABEL = "base"
_LONG = re.compile(
    r"^[+-]?(?=[\d.]{8})\d*\.\d+(?:[eE][+-]?\d+)?(?= |$)"
)  # a number with many digits, its unit behind it


class Case(NamedTuple):
    """One design point: digest, label such as ``imu=tactical_fog, filter=tight``, level by axis, scenario."""

    id: str
    label: str
    axes: dict[str, str]
    scenario: Scenario


def levels(design: str, sizes: Sequence[int], crossed: Sequence[int] = ()) -> Iterator[tuple[int | None, ...]]:
    """Yield for each case the level of every axis; None leaves the base's own value. Of one at a time the axes at the
    places `crossed` have each of their levels in every case of the others.
    """
    if not sizes:
        yield ()
    elif design == "grid":
        yield from itertools.product(*(range(size) for size in sizes))
    elif design in ("zip", "latin_hypercube", "sobol"):
        yield from ((index,) * len(sizes) for index in range(sizes[0]))
    else:
        every = [range(size) if axis in crossed else (None,) for axis, size in enumerate(sizes)]
        yield from itertools.product(*every)
        for axis, size in enumerate(sizes):
            if axis not in crossed:
                yield from itertools.product(*[range(size) if k == axis else one for k, one in enumerate(every)])


def combinations(
    design: str,
    axes: Sequence[Axis],
    exclude: Sequence[Mapping[str, str | Sequence[str]]] = (),
    constraints: Sequence[str] = (),
    base: Mapping[str, Any] | None = None,
) -> list[tuple[int | None, ...]]:
    """Return for each case the level of every axis, as `levels`, without those that are excluded, repeat another one
    because of a `when`, or break a constraint.

    base : the base scenario, whose own value an axis has at level None; constraints need it
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
    """Return left side, comparison and right side of a constraint; ValueError where it is none."""
    parts = re.split(r"(<=|>=|<|>)", constraint)
    if len(parts) != 3:
        raise ValueError("should compare two expressions, such as 'update_rate <= covariance_rate'")
    left, comparison, right = parts
    for side in (left, right):
        expression.names(side)
    return left, comparison, right


def _keeps(constraint: str, axes: Sequence[Axis], chosen: Sequence[int | None], base: Mapping[str, Any]) -> bool:
    """Whether a combination keeps a constraint; ValueError names what is no number."""
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
    """Return the name of a level: the user's, else the card's last word, else the value itself."""
    if axis.labels is not None:
        return axis.labels[index]
    if axis.cards is not None:
        return Path(axis.cards[index]).stem
    value = (axis.values or ())[index]
    if isinstance(value, Mapping):
        return str(value.get("name") or value.get("card") or index)
    return "none" if value is None else _rounded(axis.values or ())[index]


def _rounded(values: Sequence[Any]) -> list[str]:
    """Write values, their numbers with at most six digits where the values stay apart."""
    texts = [_LONG.sub(lambda found: f"{float(found[0]):.6g}", str(value)) for value in values]
    return texts if len(set(texts)) == len(texts) else [str(value) for value in values]


def axis_names(axes: Sequence[Axis]) -> tuple[str, ...]:
    """Return a short name for each axis: the last word of its path, or the whole path where that is not unique."""
    short = [axis.path.rpartition(".")[2] for axis in axes]
    return tuple(
        name if short.count(name) == 1 and not is_index(name) else axis.path.removeprefix("base.")
        for name, axis in zip(short, axes, strict=True)
    )


def choice(axes: Sequence[Axis], chosen: Sequence[int | None]) -> dict[str, str]:
    """Return axis name -> label of the level of a case."""
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
"""The level of every axis; None leaves the base's own value."""


class _Read:
    """What is known of a campaign that is still in use: its scenarios by their levels, and its cases once asked for."""

    def __init__(self, campaign: Campaign, scenarios: "Scenarios | None" = None) -> None:
        place = id(campaign)
        self.campaign = weakref.ref(campaign, lambda _: _KNOWN.pop(place, None))
        self.scenarios = scenarios
        self.cases: tuple[Case, ...] = ()


_KNOWN: dict[int, _Read] = {}  # by identity: a campaign is frozen, and what is read from it stays


def remember(campaign: Campaign, scenarios: "Scenarios") -> None:
    """Keep the scenarios that reading a campaign has validated: `cases` takes them."""
    _KNOWN[id(campaign)] = _Read(campaign, scenarios)


def cases(campaign: Campaign) -> list[Case]:
    """Return the cases of a loaded campaign in the order of its design; two equal scenarios are one case."""
    known = _KNOWN.get(id(campaign))
    if known is None or known.campaign() is not campaign:
        known = _KNOWN[id(campaign)] = _Read(campaign)
    if not known.cases:
        known.cases = tuple(_cases(campaign, known.scenarios))
        known.scenarios = None
    return list(known.cases)


def probes(campaign: Campaign) -> list[Case]:
    """Return the cases that stand for all where a mistake is looked for: all of them, or of many designs the base and
    each end of each axis alone, as far as these are possible.
    """
    found = cases(campaign.probe)
    if not campaign.is_space:
        return found
    return [case for case in found if not any(breaches_of_case(case.scenario))]


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
    """Return the plain data of the base with levels of the axes."""
    data: Any = base
    for axis, index in zip(axes, chosen, strict=True):
        if index is not None:
            data = put(data, axis.steps, (axis.values or ())[index])
    return data


class Scenarios:
    """The scenarios of a design, each validated once. A section that several cases have in common is one object.

    Parameters
    ----------
    varied
        For each axis, the section of the scenario in which it varies something.
    base
        The scenario that the axes change; None where it is not valid itself.
    plain
        Turns what a section is written as into dictionaries, lists and scalars.
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
        """Return the scenario with these levels of the axes, None where it was not asked for yet."""
        return self._made.get(chosen)

    def validated(self, chosen: Chosen, written: Mapping[str, Any]) -> Scenario:
        """Return the scenario whose sections are written so, which has these levels; ValidationError as pydantic's."""
        known = {name: self._sections.get((name, self._levels(name, chosen))) for name in written}
        data = {name: self._plain(one) if known[name] is None else known[name] for name, one in written.items()}
        try:
            found = Scenario.model_validate(data)
        except ValidationError:  # once more, to name what is written instead of what is made of it
            return Scenario.model_validate({name: self._plain(one) for name, one in written.items()})
        self._keep(chosen, found)
        return found

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
    data = unmarked(data or {}, path)  # a section that was left out; what a card says of the old value goes with it
    return {**data, path[0]: put(data.get(path[0]), path[1:], value)}


def get(data: Any, path: Sequence[str]) -> Any:
    """Return what stands at a path of nested dictionaries and lists; None where nothing does."""
    for key in path:
        if isinstance(data, list) and is_index(key) and int(key) < len(data):
            data = data[int(key)]
        else:
            data = data.get(key) if isinstance(data, dict) else None
    return data


def case_id(
    scenario: Scenario, seed: int, history: float, known: dict[int, tuple[BaseModel, Any]] | None = None
) -> str:
    """Return 12 hex digits that stand for the scenario, the seed, the history's step and the version of the numbers.

    known : the fields of earlier scenarios, by identity, each with its content; added to. It holds the field itself, so
        that no other one can have its identity.

    The step counts because covariance steps are cut at history times. A file that the scenario names counts by its
    content, not by its path: the same question asked in another folder has the same digest, an edited almanac another.
    """
    data = {
        "scenario": _undrawn(_canonical(scenario, known), scenario),
        "seed": seed,
        "history": history,
        "results_version": RESULTS_VERSION,
    }
    return hashlib.sha256(json.dumps(data, sort_keys=True, separators=(",", ":")).encode()).hexdigest()[:12]


def _undrawn(found: dict[str, Any], scenario: Scenario) -> dict[str, Any]:
    """Return the content of a scenario without the spreads of a vehicle that no run is dispersed by."""
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
