"""From axes to cases: grid, zip, one at a time; labels and digests."""

import hashlib
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel

from lvnav_trade.campaign.definition.schema import Axis, Campaign
from lvnav_trade.campaign.syntax import fields
from lvnav_trade.campaign.syntax.tree import is_index
from lvnav_trade.input_files import read_bytes
from lvnav_trade.limits import DATA_BYTES
from lvnav_trade.scenario import Scenario

RESULTS_VERSION = 1  # raised when the same scenario and seed no longer give the same numbers

BASE_LABEL = "base"


class Case(NamedTuple):
    """One design point: digest, label such as ``imu=tactical_fog, filter=tight``, level by axis, scenario."""

    id: str
    label: str
    axes: dict[str, str]
    scenario: Scenario


def levels(design: str, sizes: Sequence[int]) -> Iterator[tuple[int | None, ...]]:
    """Yield for each case the level of every axis; None leaves the base's own value."""
    if not sizes:
        yield ()
    elif design == "grid":
        yield from itertools.product(*(range(size) for size in sizes))
    elif design == "zip":
        yield from ((index,) * len(sizes) for index in range(sizes[0]))
    else:
        yield (None,) * len(sizes)
        for axis, size in enumerate(sizes):
            for level in range(size):
                yield tuple(level if index == axis else None for index in range(len(sizes)))


def level_label(axis: Axis, index: int) -> str:
    """Return the name of a level: the user's, else the card's last word, else the value itself."""
    if axis.labels is not None:
        return axis.labels[index]
    if axis.cards is not None:
        return Path(axis.cards[index]).stem
    value = (axis.values or ())[index]
    if isinstance(value, Mapping):
        return str(value.get("name") or value.get("card") or index)
    return "none" if value is None else str(value)


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


def cases(campaign: Campaign) -> list[Case]:
    """Return the cases of a loaded campaign in the order of its design; two equal scenarios are one case."""
    found: dict[str, Case] = {}
    base = campaign.base.model_dump(mode="json")
    for chosen in levels(campaign.design, [len(axis.values or ()) for axis in campaign.axes]):
        data = base
        for axis, index in zip(campaign.axes, chosen, strict=True):
            if index is not None:
                data = put(data, axis.steps, (axis.values or ())[index])
        scenario = Scenario.model_validate(data)
        axes = choice(campaign.axes, chosen)
        digest = case_id(scenario, campaign.seed, campaign.keep.history)
        found.setdefault(digest, Case(digest, case_label(axes), axes, scenario))
    return list(found.values())


def put(data: Any, path: Sequence[str], value: Any) -> Any:
    """Return a copy of nested dictionaries and lists with `value` at `path`."""
    if not path:
        return value
    if isinstance(data, list):
        copy = list(data)
        copy[int(path[0])] = put(copy[int(path[0])], path[1:], value)
        return copy
    data = data or {}  # a section that was left out
    return {**data, path[0]: put(data.get(path[0]), path[1:], value)}


def get(data: Any, path: Sequence[str]) -> Any:
    """Return what stands at a path of nested dictionaries and lists; None where nothing does."""
    for key in path:
        if isinstance(data, list) and is_index(key) and int(key) < len(data):
            data = data[int(key)]
        else:
            data = data.get(key) if isinstance(data, dict) else None
    return data


def case_id(scenario: Scenario, seed: int, history: float) -> str:
    """Return 12 hex digits that stand for the scenario, the seed, the history's step and the version of the numbers.

    The step counts because covariance steps are cut at history times. A file that the scenario names counts by its
    content, not by its path: the same question asked in another folder has the same digest, an edited almanac another.
    """
    data = {"scenario": _canonical(scenario), "seed": seed, "history": history, "results_version": RESULTS_VERSION}
    return hashlib.sha256(json.dumps(data, sort_keys=True, separators=(",", ":")).encode()).hexdigest()[:12]


def _canonical(model: BaseModel) -> dict[str, Any]:
    data = model.model_dump(mode="json")
    for name in type(model).model_fields:
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            data[name] = _canonical(value)
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            data[name] = [_canonical(item) for item in value]
        elif isinstance(value, dict):
            data[name] = {k: _canonical(one) if isinstance(one, BaseModel) else one for k, one in value.items()}
        elif fields.is_path(type(model), name) and isinstance(value, str):
            data[name] = _content(value)
        elif fields.is_path(type(model), name) and isinstance(value, tuple):
            data[name] = [_content(item) for item in value]
    return data


def _content(file: str) -> str:
    return hashlib.sha256(read_bytes(file, DATA_BYTES)).hexdigest()
