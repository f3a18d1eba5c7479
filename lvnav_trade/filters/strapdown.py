"""Algorithms of the strapdown: how the increments of a step are combined, and in which frame they are integrated.

For coning of angular frequency w the cross product of two increments depends only on how far apart they are. With
b = w T, T the time of a subsample, and increments of amplitude a,

    (increment k) x (increment k + d) = 4 a^2 sin(b / 2)^2 sin(d b)         along the axis of the cone
    coning of a step of N subsamples  = a^2 / 2 (N b - sin(N b))

The optimised class (Ignagni, J. Guidance Control Dynamics 19, 1996) takes the weighted sum of all but the last
increment times the last, and the product of the sums of the step before and of this one. Its weights make as many
terms of the series in b equal as there are weights: Miller's 2/3, (9/20, 27/20), ... without the step before, 1/12 for
one increment with it. The same weights compensate sculling (the duality of Roscoe, same journal 24, 2001).
"""

from collections.abc import Iterator
from fractions import Fraction
from typing import Literal

import numpy as np
from pydantic import Field

from lvnav_trade import units
from lvnav_trade.kernels import strapdown
from lvnav_trade.kernels.local_level import ENU, NED
from lvnav_trade.kernels.strapdown import Further, Strapdown
from lvnav_trade.records import Floats

LOCAL = {"ned": NED, "enu": ENU}
GRAVITY = {"point": strapdown.POINT, "j2": strapdown.J2, "j4": strapdown.J4}


class StrapdownCard(units.Card):
    """How many increments of the unit make one step of the strapdown, and what compensates the motion within it."""

    algorithm: Literal["summed", "two_sample", "optimised", "optimised_present", "recursive", "polynomial"] = Field(
        "two_sample",
        description="summed: none; two_sample: by the sums of the step before and of this one; optimised: by these and "
        "every increment of this step; optimised_present: by those of this step alone; recursive: increment by "
        "increment at their own rate (Savage); polynomial: integral of rates through all increments of the step "
        "(McKern)",
    )
    ratio: int = Field(1, ge=1, le=8, description="IMU increments per strapdown step")

    def _faults(self) -> Iterator[str]:
        if self.algorithm in {"optimised_present", "polynomial"} and self.ratio == 1:
            yield f"{self.algorithm}: a step of one increment has no other to compensate by; take a ratio of 2 or more"


def optimised_weights(subsamples: int, with_previous: bool) -> tuple[Floats, float]:
    """Return the weights (subsamples - 1,) of all increments of a step but the last, in their order, and that of the
    step before (0 without it).

    Of b^(2 m + 1), m from 1, the product of increments that are d apart has 2 d^n - (d + 1)^n - (d - 1)^n, n = 2 m + 1,
    that of the sums of two steps N^n (2 - 2^n), and the coning -N^n / 2, all over n! and with the same sign.
    """
    n, apart = subsamples, list(range(subsamples - 1, 0, -1))
    rows = []
    for power in range(3, 3 + 2 * (len(apart) + with_previous), 2):
        row = [Fraction(2 * d**power - (d + 1) ** power - (d - 1) ** power) for d in apart]
        row += [Fraction(n**power * (2 - 2**power))] if with_previous else []
        rows.append([*row, Fraction(-(n**power), 2)])
    found = [float(value) for value in _solved(rows)]
    across = found.pop() if with_previous else 0.0
    return np.array(found, dtype=float), across


def recursive_weights(subsamples: int) -> Floats:
    """Return the weights (subsamples, subsamples) of products of two increments by Savage's recursion: half of the sum
    before, and a twelfth of the increment before, times each increment.
    """
    apart = np.subtract.outer(np.arange(subsamples), np.arange(subsamples))
    return np.where(apart < 0, 0.5, 0.0) + np.where(apart == -1, 1.0 / 12.0, 0.0)


def polynomial_weights(subsamples: int) -> Floats:
    """Return the weights (subsamples, subsamples) of products of two increments by rates that are the polynomial of
    degree subsamples - 1 through the increments: half of the integral of angle times rate.
    """
    n = subsamples
    # the rate's coefficients of s^p that each increment gives: their integrals over every subsample are 0 or 1
    powers = [[Fraction((k + 1) ** (p + 1) - k ** (p + 1), p + 1) for p in range(n)] for k in range(n)]
    rates = [_solved([[*powers[k], Fraction(int(k == j))] for k in range(n)]) for j in range(n)]

    def integral(j: int, k: int) -> Fraction:  # of the angle of increment j times the rate of increment k
        terms = (
            rates[j][p] / (p + 1) * rates[k][q] * Fraction(n ** (p + q + 2), p + q + 2)
            for p in range(n)
            for q in range(n)
        )
        return sum(terms, Fraction(0))

    found = np.zeros((n, n))
    for j in range(n):
        for k in range(j + 1, n):
            found[j, k] = float((integral(j, k) - integral(k, j)) / 2)
    return found


def _solved(rows: list[list[Fraction]]) -> list[Fraction]:
    """Return the solution of linear equations, each a row of coefficients with its right side last (Gauss-Jordan)."""
    for k in range(len(rows)):
        pivot = next(i for i in range(k, len(rows)) if rows[i][k] != 0)
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [value / rows[k][k] for value in rows[k]]
        for i, row in enumerate(rows):
            if i != k:
                rows[i] = [value - row[k] * own for value, own in zip(row, rows[k], strict=True)]
    return [row[-1] for row in rows]


EXACT_TURN = 5e-3
"""Largest rotation (rad) in a sample for which the two-sample algorithm is taken for exact: at 30 m/s^2 its error is
2e-5 m/s^2."""


def strapdown_of(
    card: StrapdownCard,
    gravity: str,
    mechanisation: str = "inertial",
    angle: float = 0.0,
    start: Floats | None = None,
    turn: float = 0.0,
) -> Strapdown:
    """Return a strapdown in numbers; angle (rad) from the i to the e x axis, and start (3,) m of the flight in frame i,
    both at tick 0; turn: the largest rotation (rad) of a sample on the nominal flight.
    """
    general = card.algorithm != "two_sample" or card.ratio > 1
    weights, across, pairs = np.zeros(0), 0.0, np.zeros((0, 0))
    if card.algorithm in {"two_sample", "recursive"}:
        across = 1.0 / 12.0
    if card.algorithm == "recursive":
        pairs = recursive_weights(card.ratio)
    elif card.algorithm == "polynomial":
        pairs = polynomial_weights(card.ratio)
    elif card.algorithm.startswith("optimised"):
        weights, across = optimised_weights(card.ratio, card.algorithm == "optimised")
    origin, local = np.zeros(3), LOCAL.get(mechanisation, 0)
    if mechanisation == "pad" and start is not None:
        c, s = np.cos(angle), np.sin(angle)
        origin = np.array([c * start[0] + s * start[1], c * start[1] - s * start[0], start[2]])
    return Strapdown(
        gravity=GRAVITY[gravity],
        subsamples=card.ratio,
        weights=weights,
        across=across,
        at_end=card.algorithm == "summed",
        rotating=mechanisation != "inertial",
        angle=angle,
        origin=origin,
        further=Further(local, pairs) if local or pairs.size else None,
        general=general,
        counted=general or turn > EXACT_TURN,
    )
