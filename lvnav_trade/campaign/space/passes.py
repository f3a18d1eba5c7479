"""Covariance passes shared by designs with the same filter that differ in true sigmas only."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.campaign.space.numbered_designs import Design, DesignBatch, DesignSpace, make_designs, number_of
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
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare

HISTORY = 60.0  # s between history times if only events matter, which are history times too
_INSPECTED = 1000  # designs whose values show which axes vary sigmas
_FURTHER = 2  # passes in addition to one per axis: with the smallest sigmas, and for the test


class CovariancePasses:
    """Computes covariance passes and counts them.

    count : Number of passes so far.
    seconds : Their CPU time (s).
    """

    def __init__(self) -> None:
        self.count = 0
        self.seconds = 0.0

    def __call__(self, prepared_case: PreparedCase) -> CovHistory:
        """Return the linear covariance of a case."""
        start_time = time.process_time()
        history = covariance(prepared_case)
        self.count += 1
        self.seconds += time.process_time() - start_time
        return history


class GroupPasses(NamedTuple):
    """Covariance passes shared by the designs of a group.

    prepared_case : A prepared case of the group.
    axes : Indices of the axes that vary true sigmas.
    passes : The passes.
    """

    prepared_case: PreparedCase
    axes: tuple[int, ...]
    passes: SharedPass

    def sigmas(self, design: Design) -> list[float]:
        """Return the sigmas of a design."""
        return [_sigma(design, axis) for axis in self.axes]


def _sigma(design: Design, axis: int) -> float:
    number = number_of(design.values[axis])
    return float("nan") if number is None else number[0]


def group_passes(
    batch: DesignBatch, designs: Sequence[Design], sigma_axes: Sequence[int], history: float, passes: CovariancePasses
) -> GroupPasses | None:
    """Return the covariance passes shared by the designs of a group, or None.

    None is returned if there are too few designs, or if they cannot share passes. The latter is tested with all sigmas
    in the middle of their range: a separate pass must agree with the result of the shared passes.

    Parameters
    ----------
    batch : DesignBatch
        Part of the designs.
    designs : sequence of Design
        Designs that differ only in the axes `sigma_axes`.
    sigma_axes : sequence of int
        Indices of axes that may vary true sigmas only.
    history : float
        Step (s) of the history.
    passes : CovariancePasses
        Computes and counts the passes.
    """
    rows = [[_sigma(design, axis) for axis in sigma_axes] for design in designs]
    sigmas = np.array(rows).reshape(len(designs), len(sigma_axes))
    varied_columns = []
    for k, axis in enumerate(sigma_axes):
        column = sigmas[:, k]
        if np.isfinite(column).all() and np.ptp(column) > 0.0:
            varied_columns.append(k)
        elif len({design.values[axis] for design in designs}) > 1:
            return None  # the axis varies a value that is not a sigma
    if not varied_columns or len(designs) <= len(varied_columns) + _FURTHER:
        return None
    axes = tuple(sigma_axes[k] for k in varied_columns)
    smallest = sigmas[:, varied_columns].min(axis=0)
    largest = sigmas[:, varied_columns].max(axis=0)
    middle = (0.5 * (smallest + largest)).tolist()
    design = designs[0]
    try:
        prepared_case, base_history = _single_pass(batch, design, axes, smallest.tolist(), history, passes)
        raised_histories = []  # one sigma at its largest, the others at their smallest value
        for k in range(len(axes)):
            is_raised = np.arange(len(axes)) == k
            raised_sigmas = np.where(is_raised, largest, smallest)
            _, raised_history = _single_pass(batch, design, axes, raised_sigmas.tolist(), history, passes)
            raised_histories.append(raised_history)
        gate_squared = prepared_case.model.gate_squared
        shared_passes = shared_pass(gate_squared, smallest.tolist(), largest.tolist(), base_history, raised_histories)
        _, separate_history = _single_pass(batch, design, axes, middle, history, passes)
    except (InputError, ValueError, ArithmeticError):
        return None
    if not is_same_filter(base_history, separate_history):
        return None
    interpolated_history = covariance_of(shared_passes, middle)
    difference = largest_difference(interpolated_history, separate_history)
    return GroupPasses(prepared_case, axes, shared_passes) if difference < TOLERANCE else None


def _single_pass(
    batch: DesignBatch,
    design: Design,
    axes: Sequence[int],
    sigmas: Sequence[float],
    history: float,
    passes: CovariancePasses,
) -> tuple[PreparedCase, CovHistory]:
    """Return a prepared design with other sigmas, and its linear covariance.

    Parameters
    ----------
    batch : DesignBatch
        Part of the design space with the design.
    design : Design
        The design.
    axes : sequence of int
        Indices of the axes to change.
    sigmas : sequence of float
        New value of each of these axes, in the unit of the axis.
    history : float
        Step of the history (s).
    passes : CovariancePasses
        Computes and counts the covariance passes.

    Raises
    ------
    ValueError
        The design is impossible with these values.
    """
    values = list(design.values)
    for axis, sigma in zip(axes, sigmas, strict=True):
        number = number_of(values[axis])
        unit = "" if number is None else number[1]
        values[axis] = f"{float(sigma)!r} {unit}" if unit else float(sigma)
    labels = tuple(design.levels.values())
    design_batch = batch._replace(numbers=(design.number,), values=(tuple(values),), labels=(labels,))
    (changed_design,) = make_designs(design_batch)
    if changed_design.case is None:
        raise ValueError(changed_design.reason)
    prepared_case = prepare(changed_design.case.scenario, history)
    return prepared_case, passes(prepared_case)


def shared_axes(designs: DesignSpace, history: float) -> tuple[int, ...]:
    """Return the indices of the axes that vary only true sigmas in the first possible design.

    These are axes whose smallest and largest value give the same filter, the same mean error and different true errors.
    Whether designs can share passes is tested again for each group (`group_passes`).

    Parameters
    ----------
    designs : DesignSpace
        The design space.
    history : float
        Step of the history (s).
    """
    count = min(len(designs), _INSPECTED)
    batch = designs.batch(range(count))
    possible_design = next((design for design in make_designs(batch) if design.case is not None), None)
    if possible_design is None:
        return ()
    sigma_axes = []
    passes = CovariancePasses()
    for axis in range(len(batch.axes.names)):
        quantities = [number_of(values[axis]) for values in batch.values]
        numbers = [quantity[0] for quantity in quantities if quantity is not None]
        if len(numbers) < count:
            continue
        smallest = min(numbers)
        largest = max(numbers)
        if not smallest < largest:
            continue
        try:
            _, smallest_history = _single_pass(batch, possible_design, (axis,), (smallest,), history, passes)
            _, largest_history = _single_pass(batch, possible_design, (axis,), (largest,), history, passes)
        except (InputError, ValueError, ArithmeticError):
            continue
        if is_same_filter(smallest_history, largest_history):
            sigma_axes.append(axis)
    return tuple(sigma_axes)
