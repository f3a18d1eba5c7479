"""Passes of linear covariance that designs share: those that differ in true sigmas alone, with the same filter."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.campaign.space.designs import Design, Designs, Part, made, number_of
from lvnav_trade.engines.lincov.history import covariance
from lvnav_trade.engines.lincov.shared_pass import (
    TOLERANCE,
    SharedPass,
    covariance_of,
    is_same_filter,
    largest_difference,
    shared_pass,
)
from lvnav_trade.engines.setup.prepare import Prepared, prepare
from lvnav_trade.errors import InputError
from lvnav_trade.records import CovHistory

HISTORY = 60.0  # s between history times, beside events, where nothing between events is asked
_FURTHER = 2  # passes beside one for each axis: that of the smallest sigmas, and one that is tried


class Passes:
    """Passes of linear covariance, counted.

    count : Passes so far.
    seconds : Their CPU time (s).
    """

    def __init__(self) -> None:
        self.count, self.seconds = 0, 0.0

    def __call__(self, prepared: Prepared) -> CovHistory:
        """Return the linear covariance of a case."""
        begun = time.process_time()
        found = covariance(prepared)
        self.count += 1
        self.seconds += time.process_time() - begun
        return found


class Together(NamedTuple):
    """Passes that the designs of a group share.

    prepared : A case of the group.
    axes : Places of the axes that vary true sigmas.
    passes : The passes.
    """

    prepared: Prepared
    axes: tuple[int, ...]
    passes: SharedPass

    def sigmas(self, design: Design) -> list[float]:
        """Return the sigmas of a design."""
        return [_sigma(design, axis) for axis in self.axes]


def _sigma(design: Design, axis: int) -> float:
    found = number_of(design.values[axis])
    return float("nan") if found is None else found[0]


def together_of(
    part: Part, designs: Sequence[Design], shared: Sequence[int], history: float, passes: Passes
) -> Together | None:
    """Return the passes that the designs of a group share; None where they are too few, or do not share them.

    Whether they do is tried: with all sigmas in the middle of their range, a pass of its own must be what the shared
    ones give.

    Parameters
    ----------
    part
        Part that the designs are of.
    designs
        Designs that differ in the axes `shared` alone.
    shared
        Places of axes that may vary true sigmas alone.
    history
        Step (s) of the history.
    passes
        Counts the passes.
    """
    values = np.array([[_sigma(one, axis) for axis in shared] for one in designs]).reshape(len(designs), len(shared))
    moving = [k for k in range(len(shared)) if np.isfinite(values[:, k]).all() and np.ptp(values[:, k]) > 0.0]
    fixed = [k for k in range(len(shared)) if k not in moving and len({one.values[shared[k]] for one in designs}) > 1]
    if not moving or fixed or len(designs) <= len(moving) + _FURTHER:
        return None
    axes = tuple(shared[k] for k in moving)
    least, largest = values[:, moving].min(axis=0), values[:, moving].max(axis=0)
    try:
        prepared, base = _passed(part, designs[0], axes, least.tolist(), history, passes)
        raised = [
            _passed(
                part, designs[0], axes, np.where(np.arange(len(axes)) == k, largest, least).tolist(), history, passes
            )
            for k in range(len(axes))
        ]
        found = shared_pass(
            prepared.model.gate_squared, least.tolist(), largest.tolist(), base, [one for _, one in raised]
        )
        middle = (0.5 * (least + largest)).tolist()
        _, tried = _passed(part, designs[0], axes, middle, history, passes)
    except (InputError, ValueError, ArithmeticError):
        return None
    sound = is_same_filter(base, tried) and largest_difference(covariance_of(found, middle), tried) < TOLERANCE
    return Together(prepared, axes, found) if sound else None


def _passed(
    part: Part, design: Design, axes: Sequence[int], sigmas: Sequence[float], history: float, passes: Passes
) -> tuple[Prepared, CovHistory]:
    """Return a design with other sigmas, prepared, and its linear covariance; ValueError where it is impossible."""
    values = list(design.values)
    for axis, sigma in zip(axes, sigmas, strict=True):
        found = number_of(values[axis])
        values[axis] = f"{float(sigma)!r} {found[1]}" if found is not None and found[1] else float(sigma)
    labels = tuple(design.levels.values())
    one = part._replace(numbers=(design.number,), values=(tuple(values),), labels=(labels,))
    (made_of,) = made(one)
    if made_of.case is None:
        raise ValueError(made_of.reason)
    prepared = prepare(made_of.case.scenario, history)
    return prepared, passes(prepared)


def shared_axes(designs: Designs, history: float) -> tuple[int, ...]:
    """Return the places of the axes that vary true sigmas alone in the first possible design.

    An axis is one where its smallest and its largest value give the same filter, the same mean and other true errors.
    Whether designs do share passes is tried again for each group (`together_of`).
    """
    count = min(len(designs), 1000)
    part = designs.part(range(count))
    first = next((one for one in made(part) if one.case is not None), None)
    if first is None:
        return ()
    found = []
    passes = Passes()
    for axis in range(len(part.axes.names)):
        numbers = [number_of(values[axis]) for values in part.values]
        known = [one[0] for one in numbers if one is not None]
        if len(known) < count or not min(known) < max(known):
            continue
        try:
            low, high = (_passed(part, first, (axis,), (end,), history, passes)[1] for end in (min(known), max(known)))
        except (InputError, ValueError, ArithmeticError):
            continue
        if is_same_filter(low, high):
            found.append(axis)
    return tuple(found)
