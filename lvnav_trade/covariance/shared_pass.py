"""Linear covariance of cases that differ in true sigmas only, from a few shared passes.

The gains of a filter depend on its own models. With the same gains, the true covariance is a sum over independent
sources, and each source enters with the square of its sigma. The covariance of a case is therefore that of the case
with the smallest sigmas, plus a fraction of the increase by each larger sigma.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.forward import false_rejection
from lvnav_trade.quantities.records import Bools, CovHistory, Floats, InjectionLaw

TOLERANCE = 1e-9
"""Largest difference between predicted and computed covariance, relative to the sigmas, that counts as equal."""
_LINEAR_FIELDS = ("true_cov", "budget", "expected_nees", "expected_nis", "expected_row_nis")
"""Fields that are sums over the sources, apart from a part that is the same in every case."""
_COMMON_FIELDS = ("formal_cov", "mean", "n_row", "t", "t_epoch", "decisions")
"""Fields that do not depend on true sigmas."""
_INJECTION_FIELDS = ("covariance", "knowledge", "execution")
"""Fields of the injection of a guided ascent that are sums over the sources."""


class SharedPass(NamedTuple):
    """Passes that cases share: one with the smallest sigmas, and the increase by each sigma at its largest.

    gate_squared : Limit of the filter's gate on a squared normalised innovation.
    smallest_sigmas : Smallest value of each varied sigma, (n_axis,).
    largest_sigmas : Largest value, (n_axis,).
    base : Linear covariance with all sigmas at their smallest value.
    increases : Increase by each sigma at its largest value: for each axis the fields of `_LINEAR_FIELDS`.
    injection_increases : Likewise for the fields of `_INJECTION_FIELDS`; empty for each axis without guidance.
    """

    gate_squared: float
    smallest_sigmas: Floats
    largest_sigmas: Floats
    base: CovHistory
    increases: tuple[tuple[Floats, ...], ...]
    injection_increases: tuple[tuple[Floats, ...], ...]


def shared_pass(
    gate_squared: float,
    smallest_sigmas: Sequence[float],
    largest_sigmas: Sequence[float],
    base: CovHistory,
    increased_histories: Sequence[CovHistory],
) -> SharedPass:
    """Return the shared passes of cases that differ in true sigmas.

    Parameters
    ----------
    gate_squared
        Limit of the filter's gate on a squared normalised innovation.
    smallest_sigmas, largest_sigmas
        (n_axis,). Smallest and largest value of each varied sigma.
    base
        Linear covariance with all sigmas at their smallest value.
    increased_histories
        For each axis, linear covariance with its sigma at its largest value.

    Raises
    ------
    ValueError
        If a raised sigma changes the formal covariance or the mean, on which it can have no effect.
    """
    for history in increased_histories:
        if not is_same_filter(base, history):
            raise ValueError("the filter is not the same")
    increases = []
    for history in increased_histories:
        increases.append(tuple(getattr(history, name) - getattr(base, name) for name in _LINEAR_FIELDS))
    return SharedPass(
        gate_squared=gate_squared,
        smallest_sigmas=np.asarray(smallest_sigmas, dtype=float),
        largest_sigmas=np.asarray(largest_sigmas, dtype=float),
        base=base,
        increases=tuple(increases),
        injection_increases=tuple(
            _injection_increase(base.injection, history.injection) for history in increased_histories
        ),
    )


def _injection_increase(base_law: InjectionLaw | None, increased_law: InjectionLaw | None) -> tuple[Floats, ...]:
    """Return the increase of the fields of `_INJECTION_FIELDS` by a raised sigma; ValueError if the sources differ."""
    if base_law is None or increased_law is None:
        return ()
    if base_law.reason != increased_law.reason or base_law.sources != increased_law.sources:
        raise ValueError("the injection is not that of the same sources")
    return tuple(getattr(increased_law, name) - getattr(base_law, name) for name in _INJECTION_FIELDS)


def is_same_filter(first: CovHistory, second: CovHistory) -> bool:
    """Return whether two passes have the same filter, mean and times, bit for bit."""
    return all(np.array_equal(getattr(first, name), getattr(second, name), equal_nan=True) for name in _COMMON_FIELDS)


def covariance_of(passes: SharedPass, sigmas: Sequence[float]) -> CovHistory:
    """Return the linear covariance of the case with given sigmas (n_axis,), in the units of those of `SharedPass`."""
    sigma = np.asarray(sigmas, dtype=float)
    base = passes.base
    # variances are linear in the squares of the sigmas
    increase_of_square = sigma**2 - passes.smallest_sigmas**2
    largest_increase = passes.largest_sigmas**2 - passes.smallest_sigmas**2
    fractions = increase_of_square / largest_increase
    fields = {}
    for index, name in enumerate(_LINEAR_FIELDS):
        total = getattr(base, name).copy()
        for fraction, axis_increase in zip(fractions, passes.increases, strict=True):
            total += fraction * axis_increase[index]
        fields[name] = total
    law = base.injection
    if law is not None:
        sums = {}
        for index, name in enumerate(_INJECTION_FIELDS):
            increase = sum(
                fraction * axis_increase[index]
                for fraction, axis_increase in zip(fractions, passes.injection_increases, strict=True)
            )
            sums[name] = getattr(law, name) + increase
        law = law._replace(**sums)
    variance = np.diagonal(fields["true_cov"], axis1=1, axis2=2)
    return base._replace(
        **fields,
        true_sigma=np.sqrt(np.maximum(0.0, variance)),
        false_rejection=false_rejection(passes.gate_squared, fields["expected_row_nis"]),
        injection=law,
    )


def largest_difference(predicted_history: CovHistory, computed_history: CovHistory) -> float:
    """Return the largest relative difference of two linear covariances.

    The true covariance is compared relative to the sigmas of its row and column, the other sums relative to themselves.
    """
    sigma = computed_history.true_sigma
    product = sigma[:, :, None] * sigma[:, None, :]
    scale = np.maximum(product, 1e-300)
    difference = np.abs(predicted_history.true_cov - computed_history.true_cov)
    relative = difference / scale
    differences = [float(np.max(relative, initial=0.0))]
    for name in ("expected_nees", "expected_nis", "expected_row_nis"):
        a = getattr(predicted_history, name)
        b = getattr(computed_history, name)
        if not np.array_equal(np.isnan(a), np.isnan(b)):
            return float("inf")
        is_comparable = np.isfinite(a) & np.isfinite(b) & (b != 0.0)
        differences.append(_relative_difference(a, b, is_comparable))
    first, second = predicted_history.injection, computed_history.injection
    if first is not None and second is not None and not second.reason:
        a = np.diagonal(first.covariance.sum(axis=0))
        b = np.diagonal(second.covariance.sum(axis=0))
        is_comparable = np.isfinite(b) & (b > 0.0)
        differences.append(_relative_difference(a, b, is_comparable))
    return max(differences)


def _relative_difference(a: Floats, b: Floats, is_valid: Bools) -> float:
    ratio = a[is_valid] / b[is_valid]
    return float(np.max(np.abs(ratio - 1.0), initial=0.0))
