"""Redundant IMUs on the nominal flight: limits of the parity test, combined IMU for linear covariance.

Linear covariance applies the test to mean errors, as in a run without noise: an IMU is excluded from the tick at which
its deterministic errors fail the test. The selection of the middle value is treated by statistical linearisation.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from lvnav_trade.imu.array import ImuSet, axis_weights, own_solutions, terms_of, triads_of
from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.imu.redundancy import ParityCard
from lvnav_trade.kernels.transition import CONSTANT
from lvnav_trade.quantities.per_axis import squares
from lvnav_trade.quantities.records import Floats, Ints, Reference
from lvnav_trade.simulation.preparation.imu_arrays import along_axes, inputs_of
from lvnav_trade.simulation.preparation.imu_inputs import ImuArray, ImuRedundancy
from lvnav_trade.simulation.preparation.redundancy_stages import (
    CombinationStage,
    MedianStatistics,
    RedundantAxes,
    mean_stage,
    summed_variances,
)

# Deterministic error: sensor (in an array 2 * triad + sensor), driver (CONSTANT: a bias, OWN_0: a scale factor), start
# and end (s) of its growth, amplitude (SI).
Profile = tuple[int, int, float, float, tuple[float, float, float]]


class ParityTest(NamedTuple):
    """Parity test on the nominal flight; fields as in `ImuRedundancy`.

    ticks : Ticks summed for a test.
    weight : (n_window, 2, n_triad, 3). Inverse of the modelled variance of a summed increment.
    limits : (n_dof + 1,). Largest weighted sum of squared residuals, by degrees of freedom.
    owner : (n_triad,). IMU that the triad belongs to.
    hands_over : Whether the first IMU in use is excluded, whichever has failed.
    """

    ticks: int
    weight: Floats
    limits: Floats
    owner: Ints
    hands_over: bool


def redundant_of(
    card: ImuCard | ImuSet,
    units: ImuArray | None,
    ref: Reference,
    profiles: Sequence[Profile],
    hand_over: int = -1,
) -> ImuArray | None:
    """Return the IMU array with its parity test and selection; unchanged if it has neither.

    Parameters
    ----------
    card
        Card of the IMU or of the array.
    units
        IMU array; None for one IMU.
    ref
        True motion and ideal increments.
    profiles
        Deterministic errors of the IMUs.
    hand_over
        Tick of a hand-over at a given time; -1 without.
    """
    if units is None or isinstance(card, ImuCard) or (card.parity is None and card.selection == "mean"):
        return units
    dt = 1.0 / card.rate
    owner = np.array([triad.unit for triad in triads_of(card)], dtype=np.int64)
    axes = RedundantAxes(owner, own_solutions(card), axis_weights(card), card.selection == "prime")
    test = _parity_test(card, units, owner, dt)
    excludes = (card.parity or ParityCard()).after_detection != "report"
    along = np.array(along_axes(units, dt))
    errors = _profile_errors(units, profiles, 0.5 * (ref.t[:-1] + ref.t[1:]), dt)
    lost: list[tuple[int, int]] = []
    if card.parity is not None and excludes:
        lost = failed(along + errors, units.frames[:, :, 0], test)
    elif hand_over >= 0:
        lost = [(hand_over, 0)]
    spread, walk = _bias_variances(card)
    redundant = ImuRedundancy(
        middle=card.selection == "mid_value",
        prime=axes.prime,
        excludes=excludes,
        hands_over=test.hands_over,
        hand_over=hand_over,
        ticks=test.ticks if card.parity is not None else 0,
        weight=test.weight,
        limits=test.limits,
        owner=owner,
        alone=axes.alone,
        shares=axes.shares,
        noise=units.white[:, :6].reshape(-1, 2, 3).swapaxes(0, 1) ** 2 / dt,
        spread=spread,
        walk=walk,
        lost=np.array([tick for tick, _ in lost], dtype=np.int64),
        mean=_means(units, axes, [unit for _, unit in lost]),
    )
    statistics = MedianStatistics(card, units, axes, ref, along, errors) if redundant.middle else None
    return _add_stages(units, axes, statistics, lost, redundant)


def _means(units: ImuArray, axes: RedundantAxes, excluded: list[int]) -> Floats:
    """Return the weights of the mean of all IMUs, then after each exclusion, (n_excluded + 1, n_triad, 2, 3, 3).

    Parameters
    ----------
    units
        IMU array.
    axes
        Axes of the redundant IMUs.
    excluded
        Excluded IMUs, in order of exclusion.
    """
    means = []
    for n in range(len(excluded) + 1):
        first_excluded = set(excluded[:n])
        stage = mean_stage(units, axes, first_excluded)
        means.append(stage.solved)
    return np.array(means)


def _parity_test(card: ImuSet, units: ImuArray, owner: Ints, dt: float) -> ParityTest:
    """Return the parity test of an array; if its card has no test, that of the default card, which gives the weights.

    Parameters
    ----------
    card, units
        Card of the array, and its arrays.
    owner
        (n_triad,). IMU that the triad belongs to.
    dt
        s. Tick.
    """
    parity = card.parity or ParityCard()
    ticks = max(1, round(parity.window / dt))
    weight = 1.0 / _variance(card, units, dt, ticks)
    # the probability of a false alarm is shared by the tests of all windows and of both sensors
    n_test = 2 * weight.shape[0]
    dof = np.arange(1, max(2, int(units.n_axis.sum()) - 2))
    quantiles = chdtri(dof, parity.false_alarm / max(1, n_test))
    return ParityTest(
        ticks=ticks,
        weight=weight,
        limits=np.concatenate([[np.inf], quantiles]),
        owner=owner,
        hands_over=parity.after_detection == "hand_over",
    )


def _bias_variances(card: ImuSet) -> tuple[Floats, Floats]:
    """Return variance and variance rate of the random walk of the biases, (2, n_triad, 3) each, by sensor and axis."""
    shape = (2, len(triads_of(card)), 3)
    spread = np.zeros(shape)
    walk = np.zeros(shape)
    for term in terms_of(card):
        if term.driver == CONSTANT:
            variance = np.array(squares(term.sigma))
            # a Gauss-Markov process of variance s^2 drifts with 2 s^2 / T per second
            decay_drift = 2.0 / term.time_constant * variance
            drift = squares(term.walk) + decay_drift
            spread[term.sensor, term.triad] += variance
            walk[term.sensor, term.triad] += drift
    return spread, walk


def _profile_errors(units: ImuArray, profiles: Sequence[Profile], t: Floats, dt: float) -> Floats:
    """Return the errors of increments along the axes by deterministic profiles, (2, n_triad, n_tick, 3) rad and m/s.

    Parameters
    ----------
    units
        IMU array.
    profiles
        Deterministic errors of the IMUs.
    t
        (n_tick,) s since lift-off. Middle of the ticks.
    dt
        s. Tick.
    """
    n_triad, n_tick = units.dtheta.shape[:2]
    errors = np.zeros((2, n_triad, n_tick, 3))
    for code, driver, start, end, amplitude in profiles:
        triad, sensor = divmod(code, 2)
        elapsed = (t - start) / (end - start)
        growth = np.clip(elapsed, 0.0, 1.0)
        parameter = growth[:, None] * np.array(amplitude)
        inputs = inputs_of(units, dt, driver, triad, sensor)
        errors[sensor, triad] += parameter * inputs
    has_axis = np.arange(3) < units.n_axis[:, None]
    return errors * has_axis[None, :, None, :]


def _variance(card: ImuSet, units: ImuArray, dt: float, ticks: int) -> Floats:
    """Return the variance of a summed increment along an axis, (n_window, 2, n_triad, 3) SI squared.

    It is infinite without an axis.

    Parameters
    ----------
    card, units
        Card of the array, and its arrays.
    dt
        s. Tick.
    ticks
        Number of ticks summed.
    """
    lasting, white = summed_variances(card, units, dt, ticks)
    has_axis = np.arange(3) < units.n_axis[:, None]
    variance = lasting + white
    return np.asarray(np.where(has_axis, variance, np.inf))


def failed(along: Floats, directions: Floats, tests: ParityTest) -> list[tuple[int, int]]:
    """Return the IMUs that fail the parity test: tick from which each is excluded, and its number.

    This implementation by NumPy is independent of the kernel of the simulation.

    Parameters
    ----------
    along
        (2, n_triad, n_tick, 3). Increments along the sensing axes.
    directions
        (n_triad, 3, 3). Directions of the axes, body axes.
    tests
        Parity test.
    """
    out = set[int]()
    excluded = list[tuple[int, int]]()
    n_window = len(tests.weight)
    n_triad = along.shape[1]
    n_tick = n_window * tests.ticks
    tested = along[:, :, :n_tick]
    by_window = tested.reshape(2, n_triad, n_window, tests.ticks, 3)
    sums = by_window.sum(axis=3)
    for window in range(n_window):
        for sensor in range(2):
            y = sums[sensor, :, window]
            weight = tests.weight[window, sensor]
            if _residual_ratio(y, directions, weight, tests, out) <= 1.0:
                continue
            ratio, unit = _least_residual_ratio(y, directions, weight, tests, out)
            if np.isfinite(ratio):
                out.add(unit)
                first_tick = (window + 1) * tests.ticks
                excluded.append((first_tick, unit))
    return excluded


def _least_residual_ratio(
    y: Floats,
    directions: Floats,
    weight: Floats,
    tests: ParityTest,
    out: set[int],
) -> tuple[float, int]:
    """Return the smallest residual ratio of a fit without one more IMU, and that IMU.

    If a failure hands over from a prime IMU, these are 0 and the first IMU in use.

    Parameters
    ----------
    y
        (n_triad, 3). Increments along the axes, summed over the window.
    directions
        (n_triad, 3, 3). Directions of the axes, body axes.
    weight
        (n_triad, 3). Inverse of the modelled variance of y.
    tests
        Parity test.
    out
        IMUs that are already excluded.
    """
    candidates = []
    for unit in range(int(tests.owner.max()) + 1):
        if unit in out:
            continue
        ratio = 0.0  # a hand-over excludes the first in use, whichever has failed
        if not tests.hands_over:
            ratio = _residual_ratio(y, directions, weight, tests, out | {unit}, True)
        candidates.append((ratio, unit))
    return min(candidates)


def _residual_ratio(
    y: Floats,
    directions: Floats,
    weight: Floats,
    tests: ParityTest,
    out: set[int],
    alone: bool = False,
) -> float:
    """Return the weighted sum of squared residuals of a fit without some IMUs, divided by its limit.

    Parameters
    ----------
    y, directions, weight, tests
        As in `_least_residual_ratio`.
    out
        IMUs that are omitted.
    alone
        Whether the fit is a candidate for exclusion: without redundancy its ratio is infinite, otherwise 0.
    """
    use = (weight > 0.0) & ~np.isin(tests.owner, list(out))[:, None]
    dof = int(use.sum()) - 3
    if dof < 1:
        return np.inf if alone else 0.0
    root = np.sqrt(weight[use])
    H = directions[use] * root[:, None]
    z = y[use] * root
    x, *_ = np.linalg.lstsq(H, z, rcond=None)
    residual = z - H @ x
    return float(residual @ residual / tests.limits[dof])


def _add_stages(
    units: ImuArray,
    axes: RedundantAxes,
    statistics: MedianStatistics | None,
    lost: list[tuple[int, int]],
    redundant: ImuRedundancy,
) -> ImuArray:
    """Return the IMU array with the stages of the flight, tick by tick: with exclusions, and without.

    statistics : statistics of the middle value; None if the mean is used
    lost : ticks from which IMUs are excluded, and their numbers
    """
    n_tick = units.dtheta.shape[1]
    stages: list[CombinationStage] = []
    index: dict[tuple[bytes, bytes, bytes], int] = {}

    def stage_number(first: int, excluded: set[int]) -> int:
        stage = mean_stage(units, axes, excluded) if statistics is None else statistics.at(first, excluded)
        key = (stage.solved.tobytes(), stage.noisy.tobytes(), stage.shift.tobytes())
        if key not in index:
            index[key] = len(stages)
            stages.append(stage)
        return index[key]

    edges = {0, n_tick}
    edges.update(tick for tick, _ in lost)
    if statistics is not None:
        edges.update(range(0, n_tick, statistics.step))
    with_exclusions = np.zeros(n_tick, dtype=np.int64)
    without = np.zeros(n_tick, dtype=np.int64)
    for first, last in pairwise(sorted(edges)):
        excluded = {unit for tick, unit in lost if tick <= first}
        without[first:last] = stage_number(first, set())
        with_exclusions[first:last] = stage_number(first, excluded)
    return units._replace(
        solved=np.array([stage.solved for stage in stages]),
        noisy=np.array([stage.noisy for stage in stages]),
        shift=np.array([stage.shift for stage in stages]),
        stage=with_exclusions,
        stage_without_exclusion=without,
        redundant=redundant,
    )
