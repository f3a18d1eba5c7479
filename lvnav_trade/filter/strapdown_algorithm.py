"""Strapdown algorithms: weights of the coning and sculling compensation, and frame of the integration.

In coning motion of angular frequency w, the cross product of two increments depends only on their distance in time.
With b = w T, T the time of a subsample, and increments of amplitude a,

    (increment k) x (increment k + d) = 4 a^2 sin(b / 2)^2 sin(d b)         along the axis of the cone
    coning of a step of N subsamples  = a^2 / 2 (N b - sin(N b))

The optimised class (Ignagni, J. Guidance Control Dynamics 19, 1996) has two products: the weighted sum of all
increments but the last with the last, and the sum of the previous step with the sum of this step. The weights match as
many terms of the series in b as there are weights. They are Miller's 2/3, (9/20, 27/20), ... without the previous step,
and 1/12 for one increment with it. The same weights compensate sculling (the duality of Roscoe, same journal 24, 2001).
"""

from collections.abc import Iterator
from fractions import Fraction
from typing import Literal

import numpy as np
from pydantic import Field

from lvnav_trade.kernels import strapdown
from lvnav_trade.kernels.local_level import ENU, NED
from lvnav_trade.kernels.strapdown import Strapdown, StrapdownExtensions
from lvnav_trade.quantities import units
from lvnav_trade.quantities.records import Floats

LOCAL = {"ned": NED, "enu": ENU}
GRAVITY = {"point": strapdown.POINT, "j2": strapdown.J2, "j4": strapdown.J4}


class StrapdownCard(units.Card):
    """Number of IMU increments in one strapdown step, and the compensation of coning and sculling within it."""

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
            yield f"{self.algorithm}: a step of one increment has nothing to compensate with; use a ratio of 2 or more"


def optimised_weights(subsamples: int, uses_previous_step: bool) -> tuple[Floats, float]:
    """Return the weights of the optimised coning compensation (Ignagni 1996).

    Parameters
    ----------
    subsamples
        Number N of increments in a step.
    uses_previous_step
        Whether the compensation uses the sum of the previous step too.

    Returns
    -------
    weights
        (N - 1,). Weights of all increments of the step but the last, in order of time.
    previous_weight
        Weight of the sum of the previous step; 0 without it.

    Notes
    -----
    The weights solve one linear equation per power n = 3, 5, ... of b. Apart from the common factor 1 / n!, the
    coefficient of b^n is 2 d^n - (d + 1)^n - (d - 1)^n for the product of increments d apart, N^n (2 - 2^n) for the
    product of the sums of two steps, and -N^n / 2 for the coning integral. Fractions keep the solution exact.
    """
    n = subsamples
    distances = range(n - 1, 0, -1)
    n_weight = len(distances) + uses_previous_step
    equations = []
    for power in range(3, 3 + 2 * n_weight, 2):
        equation = [Fraction(2 * d**power - (d + 1) ** power - (d - 1) ** power) for d in distances]
        if uses_previous_step:
            equation.append(Fraction(n**power * (2 - 2**power)))
        equation.append(Fraction(-(n**power), 2))
        equations.append(equation)
    weights = [float(value) for value in _solve(equations)]
    previous_weight = weights.pop() if uses_previous_step else 0.0
    return np.array(weights, dtype=float), previous_weight


def recursive_weights(subsamples: int) -> Floats:
    """Return the weights of Savage's recursion for the product of each pair of increments, (subsamples, subsamples).

    Each increment is multiplied by half of the sum of all increments before it, and by a twelfth of the last of them.
    """
    index = np.arange(subsamples)
    distance = np.subtract.outer(index, index)
    sum_weights = np.where(distance < 0, 0.5, 0.0)
    last_weights = np.where(distance == -1, 1.0 / 12.0, 0.0)
    return sum_weights + last_weights


def polynomial_weights(subsamples: int) -> Floats:
    """Return the weights of McKern's algorithm for the product of each pair of increments, (subsamples, subsamples).

    The rate is the polynomial of degree subsamples - 1 whose integrals over the subsamples are the increments. The
    coning integral is half of the integral of angle times rate; its exact value gives the weights.
    """
    n = subsamples
    rates = [_unit_rate(j, n) for j in range(n)]
    weights = np.zeros((n, n))
    for j in range(n):
        for k in range(j + 1, n):
            forward = _angle_rate_integral(rates[j], rates[k])
            backward = _angle_rate_integral(rates[k], rates[j])
            difference = forward - backward
            weights[j, k] = float(difference / 2)
    return weights


def _unit_rate(j: int, n: int) -> list[Fraction]:
    """Return the coefficients of the rate (powers 0 to n - 1) with integral 1 over subsample j and 0 over the others.

    The integral of s^p over subsample k is ((k + 1)^(p + 1) - k^(p + 1)) / (p + 1).
    """
    equations = []
    for k in range(n):
        equation = [Fraction((k + 1) ** (p + 1) - k ** (p + 1), p + 1) for p in range(n)]
        equation.append(Fraction(int(k == j)))
        equations.append(equation)
    return _solve(equations)


def _angle_rate_integral(first: list[Fraction], second: list[Fraction]) -> Fraction:
    """Return the integral over the step of the angle of one rate times another rate, both by their coefficients."""
    n = len(first)
    total = Fraction(0)
    for p in range(n):
        angle = first[p] / (p + 1)  # coefficient of s^(p + 1)
        for q in range(n):
            power = p + q + 2
            integral = Fraction(n**power, power)
            total += angle * second[q] * integral
    return total


def _solve(equations: list[list[Fraction]]) -> list[Fraction]:
    """Return the solution of linear equations (Gauss-Jordan); each has its coefficients and its right-hand side."""
    for k in range(len(equations)):
        pivot = k
        while equations[pivot][k] == 0:
            pivot += 1
        equations[k], equations[pivot] = equations[pivot], equations[k]
        scale = equations[k][k]
        equations[k] = [value / scale for value in equations[k]]
        for i, equation in enumerate(equations):
            if i != k:
                factor = equation[k]
                pairs = zip(equation, equations[k], strict=True)
                equations[i] = [value - factor * pivot_value for value, pivot_value in pairs]
    return [equation[-1] for equation in equations]


EXACT_TURN = 5e-3
"""Largest rotation (rad) in a sample at which the error of the two-sample algorithm is neglected: 2e-5 m/s^2 at a
specific force of 30 m/s^2."""


def build_strapdown(
    card: StrapdownCard,
    gravity: str,
    mechanisation: str = "inertial",
    angle: float = 0.0,
    start: Floats | None = None,
    turn: float = 0.0,
) -> Strapdown:
    """Return a strapdown algorithm as numbers for the kernels.

    Parameters
    ----------
    card
        Algorithm, and number of increments in a step.
    gravity
        Gravity model: point, j2 or j4.
    mechanisation
        Frame of the integration, as in the filter card.
    angle
        rad. Angle from the x axis of frame i to that of frame e at tick 0.
    start
        (3,) m. Position at tick 0, frame i; the origin of the pad mechanisation.
    turn
        rad. Largest rotation within a sample on the nominal flight. Above `EXACT_TURN` linear covariance includes the
        error of the algorithm.

    Returns
    -------
    Strapdown
        The algorithm as numbers.
    """
    weights = np.zeros(0)
    previous_weight = 0.0
    pairs = np.zeros((0, 0))
    if card.algorithm in {"two_sample", "recursive"}:
        previous_weight = 1.0 / 12.0
    if card.algorithm == "recursive":
        pairs = recursive_weights(card.ratio)
    elif card.algorithm == "polynomial":
        pairs = polynomial_weights(card.ratio)
    elif card.algorithm.startswith("optimised"):
        weights, previous_weight = optimised_weights(card.ratio, card.algorithm == "optimised")
    local = LOCAL.get(mechanisation, 0)
    has_extensions = bool(local) or pairs.size > 0
    general = card.algorithm != "two_sample" or card.ratio > 1
    return Strapdown(
        gravity=GRAVITY[gravity],
        subsamples=card.ratio,
        weights=weights,
        previous_step_weight=previous_weight,
        has_end_attitude=card.algorithm == "summed",
        is_rotating=mechanisation != "inertial",
        angle=angle,
        origin=_pad_origin(start, angle) if mechanisation == "pad" and start is not None else np.zeros(3),
        extensions=StrapdownExtensions(local, pairs) if has_extensions else None,
        is_general=general,
        is_error_included=general or turn > EXACT_TURN,
    )


def _pad_origin(start: Floats, angle: float) -> Floats:
    """Return a position (3,) m, frame i, in axes rotated about z by an angle (rad), those of frame e."""
    c = np.cos(angle)
    s = np.sin(angle)
    x, y, z = start
    x_e = c * x + s * y
    y_e = c * y - s * x
    return np.array([x_e, y_e, z])
