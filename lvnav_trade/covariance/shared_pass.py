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
_LINEAR = ("true_cov", "budget", "expected_nees", "expected_nis", "row_ratio")
"""Fields that are sums over the sources, apart from a part that is the same in every case."""
_SAME = ("formal_cov", "mean", "n_row", "t", "t_epoch", "decisions")
"""Fields that do not depend on true sigmas."""
_OF_INJECTION = ("covariance", "knowledge", "execution")
"""Fields of the injection of a guided ascent that are sums over the sources."""


class SharedPass(NamedTuple):
    """Passes that cases share: one with the smallest sigmas, and the increase by each sigma at its largest.

    gate_squared : Limit of the filter's gate on a squared normalised innovation.
    least : Smallest value of each varied sigma, (n_axis,).
    largest : Largest value, (n_axis,).
    base : Linear covariance with all sigmas at their smallest value.
    added : Increase by each sigma at its largest value: for each axis the fields of `_LINEAR`.
    injected : Likewise for the fields of `_OF_INJECTION`; empty for each axis without guidance.
    """

    gate_squared: float
    least: Floats
    largest: Floats
    base: CovHistory
    added: tuple[tuple[Floats, ...], ...]
    injected: tuple[tuple[Floats, ...], ...]


def shared_pass(
    gate_squared: float,
    least: Sequence[float],
    largest: Sequence[float],
    base: CovHistory,
    raised: Sequence[CovHistory],
) -> SharedPass:
    """Return the shared passes of cases that differ in true sigmas.

    Parameters
    ----------
    gate_squared
        Limit of the filter's gate on a squared normalised innovation.
    least, largest
        (n_axis,). Smallest and largest value of each varied sigma.
    base
        Linear covariance with all sigmas at their smallest value.
    raised
        For each axis, linear covariance with its sigma at its largest value.

    Raises
    ------
    ValueError
        If a raised sigma changes the formal covariance or the mean, on which it can have no effect.
    """
    for history in raised:
        if not is_same_filter(base, history):
            raise ValueError("the filter is not the same")
    added = []
    for history in raised:
        added.append(tuple(getattr(history, name) - getattr(base, name) for name in _LINEAR))
    return SharedPass(
        gate_squared=gate_squared,
        least=np.asarray(least, dtype=float),
        largest=np.asarray(largest, dtype=float),
        base=base,
        added=tuple(added),
        injected=tuple(_added_injection(base.injection, history.injection) for history in raised),
    )


def _added_injection(base: InjectionLaw | None, raised: InjectionLaw | None) -> tuple[Floats, ...]:
    """Return the increase of the fields of `_OF_INJECTION` by a raised sigma; ValueError if the sources differ."""
    if base is None or raised is None:
        return ()
    if base.why != raised.why or base.sources != raised.sources:
        raise ValueError("the injection is not that of the same sources")
    return tuple(getattr(raised, name) - getattr(base, name) for name in _OF_INJECTION)


def is_same_filter(first: CovHistory, other: CovHistory) -> bool:
    """Return whether two passes have the same filter, mean and times, bit for bit."""
    return all(np.array_equal(getattr(first, name), getattr(other, name), equal_nan=True) for name in _SAME)


def covariance_of(shared: SharedPass, sigmas: Sequence[float]) -> CovHistory:
    """Return the linear covariance of the case with given sigmas (n_axis,), in the units of `SharedPass.least`."""
    sigma = np.asarray(sigmas, dtype=float)
    base = shared.base
    # variances are linear in the squares of the sigmas
    increase_of_square = sigma**2 - shared.least**2
    largest_increase = shared.largest**2 - shared.least**2
    fractions = increase_of_square / largest_increase
    fields = {}
    for index, name in enumerate(_LINEAR):
        total = getattr(base, name).copy()
        for fraction, added in zip(fractions, shared.added, strict=True):
            total += fraction * added[index]
        fields[name] = total
    law = base.injection
    if law is not None:
        sums = {}
        for index, name in enumerate(_OF_INJECTION):
            increase = sum(fraction * added[index] for fraction, added in zip(fractions, shared.injected, strict=True))
            sums[name] = getattr(law, name) + increase
        law = law._replace(**sums)
    variance = np.diagonal(fields["true_cov"], axis1=1, axis2=2)
    return base._replace(
        **fields,
        true_sigma=np.sqrt(np.maximum(0.0, variance)),
        false_rejection=false_rejection(shared.gate_squared, fields["row_ratio"]),
        injection=law,
    )


def largest_difference(predicted: CovHistory, computed: CovHistory) -> float:
    """Return the largest relative difference of two linear covariances.

    The true covariance is compared relative to the sigmas of its row and column, the other sums relative to themselves.
    """
    sigma = computed.true_sigma
    product = sigma[:, :, None] * sigma[:, None, :]
    scale = np.maximum(product, 1e-300)
    difference = np.abs(predicted.true_cov - computed.true_cov)
    relative = difference / scale
    differences = [float(np.max(relative, initial=0.0))]
    for name in ("expected_nees", "expected_nis", "row_ratio"):
        a = getattr(predicted, name)
        b = getattr(computed, name)
        if not np.array_equal(np.isnan(a), np.isnan(b)):
            return float("inf")
        is_comparable = np.isfinite(a) & np.isfinite(b) & (b != 0.0)
        differences.append(_relative_difference(a, b, is_comparable))
    first, second = predicted.injection, computed.injection
    if first is not None and second is not None and not second.why:
        a = np.diagonal(first.covariance.sum(axis=0))
        b = np.diagonal(second.covariance.sum(axis=0))
        is_comparable = np.isfinite(b) & (b > 0.0)
        differences.append(_relative_difference(a, b, is_comparable))
    return max(differences)


def _relative_difference(a: Floats, b: Floats, valid: Bools) -> float:
    ratio = a[valid] / b[valid]
    return float(np.max(np.abs(ratio - 1.0), initial=0.0))
