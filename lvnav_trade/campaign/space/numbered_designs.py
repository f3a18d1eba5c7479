"""Designs of a design space by number; their scenarios are created by the worker that evaluates them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from lvnav_trade.campaign.definition.axes import (
    BASE_LABEL,
    Case,
    LevelIndices,
    axis_names,
    case_level_indices,
    with_value,
)
from lvnav_trade.campaign.definition.case_digest import case_id
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.statistics.display_units import split_quantity
from lvnav_trade.scenario.rules import case_breaches
from lvnav_trade.scenario.scenario import Scenario

_LABEL = "design "
_BATCH = 200  # designs that are made together when all cases are listed
_CACHED = 400  # largest number of sections whose digests are cached
_NUMBER = re.compile(r"(?<![A-Za-z_\d.])[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


class DesignAxes(NamedTuple):
    """Axes of a campaign.

    names : Name of each axis.
    steps : Steps of the path of each axis below the scenario.
    """

    names: tuple[str, ...]
    steps: tuple[tuple[str, ...], ...]


class DesignBatch(NamedTuple):
    """Some designs of a campaign, for one worker.

    base : Scenario that the axes vary.
    axes : The axes.
    numbers : Number of each design, from 0.
    values : Value of every axis in each design; `BaseValue` is the value of the base.
    labels : Label of every axis in each design.
    seed : Seed of the campaign.
    history : Step (s) of stored histories, which enters the digest of a case.
    """

    base: Scenario
    axes: DesignAxes
    numbers: tuple[int, ...]
    values: tuple[tuple[Any, ...], ...]
    labels: tuple[tuple[str, ...], ...]
    seed: int
    history: float


class BaseValue:
    """Value of an axis that does not change the base."""


class Design(NamedTuple):
    """A design.

    number : Number of the design, from 0.
    values : Value of every axis.
    case : The case; None if the design is impossible.
    levels : Label of the level of each axis.
    reason : Reason why the design is impossible, without numbers, so that similar reasons are equal; else empty.
    """

    number: int
    values: tuple[Any, ...]
    case: Case | None
    levels: dict[str, str]
    reason: str = ""


class DesignSpace:
    """The designs of a campaign.

    campaign : A loaded campaign that stores metrics.
    """

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign
        self.levels: list[LevelIndices] = case_level_indices(campaign)
        self.axes = DesignAxes(axis_names(campaign.axes), tuple(tuple(axis.steps) for axis in campaign.axes))

    def __len__(self) -> int:
        return len(self.levels)

    def values(self, number: int) -> tuple[Any, ...]:
        """Return the value of every axis in a design."""
        values: list[Any] = []
        for axis, index in zip(self.campaign.axes, self.levels[number], strict=True):
            value = BaseValue if index is None else (axis.values or ())[index]
            values.append(value)
        return tuple(values)

    def labels(self, number: int) -> tuple[str, ...]:
        """Return the label of every axis in a design."""
        labels = []
        for axis, index in zip(self.campaign.axes, self.levels[number], strict=True):
            label = BASE_LABEL if index is None else (axis.labels or ())[index]
            labels.append(label)
        return tuple(labels)

    def batch(self, numbers: Sequence[int]) -> DesignBatch:
        """Return the designs with these numbers as work for one worker."""
        return DesignBatch(
            base=self.campaign.base,
            axes=self.axes,
            numbers=tuple(numbers),
            values=tuple(self.values(number) for number in numbers),
            labels=tuple(self.labels(number) for number in numbers),
            seed=self.campaign.seed,
            history=self.campaign.keep.history,
        )

    def case(self, number: int) -> Case:
        """Return the case of a design; InputError if it is impossible."""
        (design,) = make_designs(self.batch([number]))
        if design.case is None:
            raise InputError(f"design {number}: {design.reason}")
        return design.case

    def cases(self) -> Iterator[Case]:
        """Yield the cases of all possible designs in order."""
        for first in range(0, len(self), _BATCH):
            numbers = range(first, min(first + _BATCH, len(self)))
            for design in make_designs(self.batch(numbers)):
                if design.case is not None:
                    yield design.case


def make_designs(batch: DesignBatch) -> Iterator[Design]:
    """Yield the designs of a batch; designs share the sections of the scenario that they have in common."""
    base = batch.base.model_dump(mode="json")
    base_sections = {}
    for name, plain_section in base.items():
        section = getattr(batch.base, name)
        base_sections[name] = section if isinstance(section, BaseModel) else plain_section
    # indices of the axes that vary each section
    axes_by_section: dict[str, list[int]] = {}
    for axis, steps in enumerate(batch.axes.steps):
        axes_by_section.setdefault(steps[0], []).append(axis)
    valid_sections: dict[tuple[str, tuple[str, ...]], Any] = {}
    digests: dict[int, tuple[BaseModel, Any]] = {}
    case_id(batch.base, batch.seed, batch.history, digests)
    base_digests = dict(digests)
    for number, values, labels in zip(batch.numbers, batch.values, batch.labels, strict=True):
        levels = dict(zip(batch.axes.names, labels, strict=True))
        data = dict(base_sections)
        keys = {}
        for name, axes in axes_by_section.items():
            level_texts = [labels[k] if isinstance(values[k], dict) else repr(values[k]) for k in axes]
            key = (name, tuple(level_texts))
            keys[name] = key
            data[name] = valid_sections.get(key) or _section(base, name, axes, batch.axes, values)
        try:
            scenario = Scenario.model_validate(data)
        except (ValidationError, InputError) as error:
            reason = reason_of(error)
            yield Design(number, values, None, levels, reason)
            continue
        breach = next(iter(case_breaches(scenario)), None)
        if breach is not None:
            path, message = breach
            reason = _without_numbers(f"{path}: {message}")
            yield Design(number, values, None, levels, reason)
            continue
        for name, key in keys.items():
            valid_sections.setdefault(key, getattr(scenario, name))
        digest = case_id(scenario, batch.seed, batch.history, digests)
        if len(digests) >= _CACHED:  # limits the memory of the cache
            digests = dict(base_digests)
        case = Case(digest, label_of(number), levels, scenario)
        yield Design(number, values, case, levels)


def label_of(number: int) -> str:
    """Return the label of a design, its number; the levels of all axes would be too long."""
    return f"{_LABEL}{number}"


def number_in(label: str) -> int | None:
    """Return the number of the design with a label; None if it is not a label of a design."""
    number = label.removeprefix(_LABEL)
    is_label = label.startswith(_LABEL) and number.isdecimal() and number.isascii()
    return int(number) if is_label else None


def _section(
    base: dict[str, Any], name: str, axis_indices: list[int], axes: DesignAxes, values: tuple[Any, ...]
) -> Any:
    """Return a section of a design as plain data.

    Parameters
    ----------
    base : dict
        Base scenario as plain data.
    name : str
        Name of the section.
    axis_indices : list of int
        Indices of the axes that vary it.
    axes : DesignAxes
        The axes.
    values : tuple
        Value of every axis; `BaseValue` is the value of the base.
    """
    section: Any = {name: base.get(name)}
    for k in axis_indices:
        if values[k] is not BaseValue:
            section = with_value(section, axes.steps[k], values[k])
    return section[name]


def number_of(value: Any) -> tuple[float, str] | None:
    """Return number and SI unit of the value of an axis; None if it is neither a number nor a quantity."""
    if value is BaseValue or isinstance(value, bool):
        return None
    if isinstance(value, int | float):
        return float(value), ""
    return split_quantity(value)


def reason_of(error: Exception) -> str:
    """Return the reason why a design is impossible: the first line of its error, without numbers."""
    if isinstance(error, ValidationError):
        first_error = error.errors()[0]
        path = ".".join(str(step) for step in first_error["loc"])
        text = f"{path}: {first_error['msg']}" if path else first_error["msg"]
    elif isinstance(error, InputError) and error.records:
        record = error.records[0]
        text = f"{record.path}: {record.message}" if record.path else record.message
    else:
        text = f"{type(error).__name__}: {error}"
    first_line = text.strip().partition("\n")[0]
    return _without_numbers(first_line.removeprefix("Value error, "))


def _without_numbers(text: str) -> str:
    return _NUMBER.sub("…", text)
