"""Covariance passes shared by designs with the same filter that differ in true sigmas only."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.campaign.space.numbered_designs import Design, DesignBatch, DesignSpace, made, number_of
from lvnav_trade.covariance.history import covariance
from lvnav_trade.covariance.shared_pass import (
    TOLERANCE,
    SharedPass,
    covariance_of,
    is_same_filter,
    largest_difference,
    shared_pass,
)
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import CovHistory
from lvnav_trade.simulation.preparation.prepare import Prepared, prepare

HISTORY = 60.0  # s between history times if only events matter, which are history times too
_FURTHER = 2  # passes in addition to one per axis: with the smallest sigmas, and for the test


class CovariancePasses:
    """Computes covariance passes and counts them.

    count : Number of passes so far.
    seconds : Their CPU time (s).
    """

    def __init__(self) -> None:
        self.count, self.seconds = 0, 0.0

    def __call__(self, prepared: Prepared) -> CovHistory:
        """Return the linear covariance of a case."""
        begun = time.process_time()
        history = covariance(prepared)
        self.count += 1
        self.seconds += time.process_time() - begun
        return history


class GroupPasses(NamedTuple):
    """Covariance passes shared by the designs of a group.

    prepared : A prepared case of the group.
    axes : Indices of the axes that vary true sigmas.
    passes : The passes.
    """

    prepared: Prepared
    axes: tuple[int, ...]
    passes: SharedPass

    def sigmas(self, design: Design) -> list[float]:
        """Return the sigmas of a design."""
        return [_sigma(design, axis) for axis in self.axes]


def _sigma(design: Design, axis: int) -> float:
    number = number_of(design.values[axis])
    return float("nan") if number is None else number[0]


def together_of(
    part: DesignBatch, designs: Sequence[Design], shared: Sequence[int], history: float, passes: CovariancePasses
) -> GroupPasses | None:
    """Return the covariance passes shared by the designs of a group, or None.

    None is returned if there are too few designs, or if they cannot share passes. The latter is tested with all sigmas
    in the middle of their range: a separate pass must agree with the result of the shared passes.

    Parameters
    ----------
    part : DesignBatch
        Part of the designs.
    designs : sequence of Design
        Designs that differ only in the axes `shared`.
    shared : sequence of int
        Indices of axes that may vary true sigmas only.
    history : float
        Step (s) of the history.
    passes : CovariancePasses
        Computes and counts the passes.
    """
    values = np.array([[_sigma(design, axis) for axis in shared] for design in designs])
    values = values.reshape(len(designs), len(shared))
    moving = [k for k in range(len(shared)) if np.isfinite(values[:, k]).all() and np.ptp(values[:, k]) > 0.0]
    others = [k for k in range(len(shared)) if k not in moving]
    is_mixed = any(len({design.values[shared[k]] for design in designs}) > 1 for k in others)
    if not moving or is_mixed or len(designs) <= len(moving) + _FURTHER:
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
        common = shared_pass(
            prepared.model.gate_squared,
            least.tolist(),
            largest.tolist(),
            base,
            [history_of for _, history_of in raised],
        )
        middle = (0.5 * (least + largest)).tolist()
        _, tried = _passed(part, designs[0], axes, middle, history, passes)
    except (InputError, ValueError, ArithmeticError):
        return None
    agrees = is_same_filter(base, tried) and largest_difference(covariance_of(common, middle), tried) < TOLERANCE
    return GroupPasses(prepared, axes, common) if agrees else None


def _passed(
    part: DesignBatch,
    design: Design,
    axes: Sequence[int],
    sigmas: Sequence[float],
    history: float,
    passes: CovariancePasses,
) -> tuple[Prepared, CovHistory]:
    """Return a prepared design with other sigmas, and its linear covariance; ValueError if it is impossible."""
    values = list(design.values)
    for axis, sigma in zip(axes, sigmas, strict=True):
        number = number_of(values[axis])
        values[axis] = f"{float(sigma)!r} {number[1]}" if number is not None and number[1] else float(sigma)
    labels = tuple(design.levels.values())
    (changed,) = made(part._replace(numbers=(design.number,), values=(tuple(values),), labels=(labels,)))
    if changed.case is None:
        raise ValueError(changed.reason)
    prepared = prepare(changed.case.scenario, history)
    return prepared, passes(prepared)


def shared_axes(designs: DesignSpace, history: float) -> tuple[int, ...]:
    """Return the indices of the axes that vary only true sigmas in the first possible design.

    These are axes whose smallest and largest value give the same filter, the same mean error and different true errors.
    Whether designs can share passes is tested again for each group (`together_of`).
    """
    count = min(len(designs), 1000)
    part = designs.part(range(count))
    first = next((design for design in made(part) if design.case is not None), None)
    if first is None:
        return ()
    shared = []
    passes = CovariancePasses()
    for axis in range(len(part.axes.names)):
        numbers = [number_of(values[axis]) for values in part.values]
        known = [number[0] for number in numbers if number is not None]
        if len(known) < count or not min(known) < max(known):
            continue
        try:
            low, high = (_passed(part, first, (axis,), (end,), history, passes)[1] for end in (min(known), max(known)))
        except (InputError, ValueError, ArithmeticError):
            continue
        if is_same_filter(low, high):
            shared.append(axis)
    return tuple(shared)
