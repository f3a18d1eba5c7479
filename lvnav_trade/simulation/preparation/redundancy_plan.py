"""Redundant IMUs on the nominal flight: limits of the parity test, combined IMU for linear covariance.

Linear covariance applies the test to mean errors, as in a run without noise: an IMU is excluded from the tick at which
its deterministic errors fail the test. The selection of the middle value is treated by statistical linearisation.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from lvnav_trade.imu.array import ImuSet, axis_weights, imu_error_terms, list_triads, single_imu_columns
from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.imu.redundancy import ParityCard
from lvnav_trade.kernels.transition import CONSTANT
from lvnav_trade.quantities.per_axis import squares
from lvnav_trade.quantities.records import Floats, Ints, Reference
from lvnav_trade.simulation.preparation.imu_arrays import axis_increments, inputs_of
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

    n_test_tick : Ticks summed for a test.
    weight : (n_window, 2, n_triad, 3). Inverse of the modelled variance of a summed increment.
    limits : (n_dof + 1,). Largest weighted sum of squared residuals, by degrees of freedom.
    owner : (n_triad,). IMU that the triad belongs to.
    hands_over_on_failure : Whether the first IMU in use is excluded, whichever has failed.
    """

    n_test_tick: int
    weight: Floats
    limits: Floats
    owner: Ints
    hands_over_on_failure: bool


def add_redundancy(
    card: ImuCard | ImuSet,
    units: ImuArray | None,
    ref: Reference,
    profiles: Sequence[Profile],
    planned_handover_tick: int = -1,
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
    planned_handover_tick
        Tick of a hand-over at a given time; -1 without.
    """
    if units is None or isinstance(card, ImuCard) or (card.parity is None and card.selection == "mean"):
        return units
    dt = 1.0 / card.rate
    owner = np.array([triad.unit for triad in list_triads(card)], dtype=np.int64)
    axes = RedundantAxes(owner, single_imu_columns(card), axis_weights(card), card.selection == "prime")
    test = _parity_test(card, units, owner, dt)
    excludes = (card.parity or ParityCard()).after_detection != "report"
    increments = np.array(axis_increments(units, dt))
    errors = _profile_errors(units, profiles, 0.5 * (ref.t[:-1] + ref.t[1:]), dt)
    exclusions: list[tuple[int, int]] = []
    if card.parity is not None and excludes:
        exclusions = find_exclusions(increments + errors, units.frames[:, :, 0], test)
    elif planned_handover_tick >= 0:
        exclusions = [(planned_handover_tick, 0)]
    spread, walk = _bias_variances(card)
    redundant = ImuRedundancy(
        uses_middle_value=card.selection == "mid_value",
        uses_prime=axes.uses_prime,
        excludes=excludes,
        hands_over_on_failure=test.hands_over_on_failure,
        planned_handover_tick=planned_handover_tick,
        n_test_tick=test.n_test_tick if card.parity is not None else 0,
        weight=test.weight,
        limits=test.limits,
        owner=owner,
        imu_weights=axes.imu_weights,
        shares=axes.shares,
        noise=units.white[:, :6].reshape(-1, 2, 3).swapaxes(0, 1) ** 2 / dt,
        spread=spread,
        walk=walk,
        exclusion_ticks=np.array([tick for tick, _ in exclusions], dtype=np.int64),
        mean=_means(units, axes, [unit for _, unit in exclusions]),
    )
    statistics = MedianStatistics(card, units, axes, ref, increments, errors) if redundant.uses_middle_value else None
    return _add_stages(units, axes, statistics, exclusions, redundant)


def _means(units: ImuArray, axes: RedundantAxes, excluded_imus: list[int]) -> Floats:
    """Return the weights of the mean of all IMUs, then after each exclusion, (n_excluded + 1, n_triad, 2, 3, 3).

    Parameters
    ----------
    units
        IMU array.
    axes
        Axes of the redundant IMUs.
    excluded_imus
        Excluded IMUs, in order of exclusion.
    """
    means = []
    for n in range(len(excluded_imus) + 1):
        first_excluded = set(excluded_imus[:n])
        stage = mean_stage(units, axes, first_excluded)
        means.append(stage.axis_weights)
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
    n_test_tick = max(1, round(parity.window / dt))
    weight = 1.0 / _variance(card, units, dt, n_test_tick)
    # the probability of a false alarm is shared by the tests of all windows and of both sensors
    n_test = 2 * weight.shape[0]
    dof = np.arange(1, max(2, int(units.n_axis.sum()) - 2))
    quantiles = chdtri(dof, parity.false_alarm / max(1, n_test))
    return ParityTest(
        n_test_tick=n_test_tick,
        weight=weight,
        limits=np.concatenate([[np.inf], quantiles]),
        owner=owner,
        hands_over_on_failure=parity.after_detection == "hand_over",
    )


def _bias_variances(card: ImuSet) -> tuple[Floats, Floats]:
    """Return variance and variance rate of the random walk of the biases, (2, n_triad, 3) each, by sensor and axis."""
    shape = (2, len(list_triads(card)), 3)
    spread = np.zeros(shape)
    walk = np.zeros(shape)
    for term in imu_error_terms(card):
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
        relative_time = (t - start) / (end - start)
        growth = np.clip(relative_time, 0.0, 1.0)
        parameter = growth[:, None] * np.array(amplitude)
        inputs = inputs_of(units, dt, driver, triad, sensor)
        errors[sensor, triad] += parameter * inputs
    has_axis = np.arange(3) < units.n_axis[:, None]
    return errors * has_axis[None, :, None, :]


def _variance(card: ImuSet, units: ImuArray, dt: float, n_test_tick: int) -> Floats:
    """Return the variance of a summed increment along an axis, (n_window, 2, n_triad, 3) SI squared.

    It is infinite without an axis.

    Parameters
    ----------
    card, units
        Card of the array, and its arrays.
    dt
        s. Tick.
    n_test_tick
        Number of ticks summed.
    """
    lasting, white = summed_variances(card, units, dt, n_test_tick)
    has_axis = np.arange(3) < units.n_axis[:, None]
    variance = lasting + white
    return np.asarray(np.where(has_axis, variance, np.inf))


def find_exclusions(increments: Floats, directions: Floats, tests: ParityTest) -> list[tuple[int, int]]:
    """Return the IMUs that fail the parity test: tick from which each is excluded, and its number.

    This implementation by NumPy is independent of the kernel of the simulation.

    Parameters
    ----------
    increments
        (2, n_triad, n_tick, 3). Increments along the sensing axes.
    directions
        (n_triad, 3, 3). Directions of the axes, body axes.
    tests
        Parity test.
    """
    excluded_imus = set[int]()
    exclusions = list[tuple[int, int]]()
    n_window = len(tests.weight)
    n_triad = increments.shape[1]
    n_tick = n_window * tests.n_test_tick
    tested_increments = increments[:, :, :n_tick]
    by_window = tested_increments.reshape(2, n_triad, n_window, tests.n_test_tick, 3)
    sums = by_window.sum(axis=3)
    for window in range(n_window):
        for sensor in range(2):
            y = sums[sensor, :, window]
            weight = tests.weight[window, sensor]
            if _residual_ratio(y, directions, weight, tests, excluded_imus) <= 1.0:
                continue
            ratio, unit = _least_residual_ratio(y, directions, weight, tests, excluded_imus)
            if np.isfinite(ratio):
                excluded_imus.add(unit)
                first_tick = (window + 1) * tests.n_test_tick
                exclusions.append((first_tick, unit))
    return exclusions


def _least_residual_ratio(
    y: Floats,
    directions: Floats,
    weight: Floats,
    tests: ParityTest,
    excluded_imus: set[int],
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
    excluded_imus
        IMUs that are already excluded.
    """
    candidates = []
    for unit in range(int(tests.owner.max()) + 1):
        if unit in excluded_imus:
            continue
        ratio = 0.0  # a hand-over excludes the first in use, whichever has failed
        if not tests.hands_over_on_failure:
            ratio = _residual_ratio(y, directions, weight, tests, excluded_imus | {unit}, True)
        candidates.append((ratio, unit))
    return min(candidates)


def _residual_ratio(
    y: Floats,
    directions: Floats,
    weight: Floats,
    tests: ParityTest,
    omitted_imus: set[int],
    is_candidate: bool = False,
) -> float:
    """Return the weighted sum of squared residuals of a fit without some IMUs, divided by its limit.

    Parameters
    ----------
    y, directions, weight, tests
        As in `_least_residual_ratio`.
    omitted_imus
        IMUs that are omitted.
    is_candidate
        Whether the fit is a candidate for exclusion: without redundancy its ratio is infinite, otherwise 0.
    """
    use = (weight > 0.0) & ~np.isin(tests.owner, list(omitted_imus))[:, None]
    dof = int(use.sum()) - 3
    if dof < 1:
        return np.inf if is_candidate else 0.0
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
    exclusions: list[tuple[int, int]],
    redundant: ImuRedundancy,
) -> ImuArray:
    """Return the IMU array with the stages of the flight, tick by tick: with exclusions, and without.

    statistics : statistics of the middle value; None if the mean is used
    exclusions : ticks from which IMUs are excluded, and their numbers
    """
    n_tick = units.dtheta.shape[1]
    stages: list[CombinationStage] = []
    index: dict[tuple[bytes, bytes, bytes], int] = {}

    def stage_number(first: int, excluded_imus: set[int]) -> int:
        stage = mean_stage(units, axes, excluded_imus) if statistics is None else statistics.stage(first, excluded_imus)
        key = (stage.axis_weights.tobytes(), stage.error_factors.tobytes(), stage.shift.tobytes())
        if key not in index:
            index[key] = len(stages)
            stages.append(stage)
        return index[key]

    edges = {0, n_tick}
    edges.update(tick for tick, _ in exclusions)
    if statistics is not None:
        edges.update(range(0, n_tick, statistics.step))
    stages_with_exclusions = np.zeros(n_tick, dtype=np.int64)
    stages_without_exclusion = np.zeros(n_tick, dtype=np.int64)
    for first, last in pairwise(sorted(edges)):
        excluded_imus = {unit for tick, unit in exclusions if tick <= first}
        stages_without_exclusion[first:last] = stage_number(first, set())
        stages_with_exclusions[first:last] = stage_number(first, excluded_imus)
    return units._replace(
        axis_weights=np.array([stage.axis_weights for stage in stages]),
        error_factors=np.array([stage.error_factors for stage in stages]),
        shift=np.array([stage.shift for stage in stages]),
        stage=stages_with_exclusions,
        stage_without_exclusion=stages_without_exclusion,
        redundant=redundant,
    )
