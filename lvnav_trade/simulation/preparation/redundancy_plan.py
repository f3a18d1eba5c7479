"""Redundant IMUs on the nominal flight: limits of the parity test, combined IMU for linear covariance.

Linear covariance applies the test to mean errors, as in a run without noise: an IMU is excluded from the tick at which
its deterministic errors fail the test. The selection of the middle value is treated by statistical linearisation.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from lvnav_trade.imu.array import ImuSet, axis_weights, least_squares, own_solutions, terms_of, triads_of
from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.imu.redundancy import MedianModel, ParityCard, middle
from lvnav_trade.kernels.transition import CONSTANT
from lvnav_trade.quantities.per_axis import squares
from lvnav_trade.quantities.records import Floats, Ints, Reference
from lvnav_trade.simulation.preparation.imu_arrays import along_axes, inputs_of
from lvnav_trade.simulation.preparation.imu_inputs import ImuArray, ImuRedundancy

STAGE = 1.0
"""Interval (s) at which the statistics of the middle value are evaluated."""

# Deterministic error: sensor (in an array 2 * triad + sensor), driver (CONSTANT: a bias, OWN_0: a scale factor), start
# and end (s) of its growth, amplitude (SI).
Profile = tuple[int, int, float, float, tuple[float, float, float]]


class _Axes(NamedTuple):
    """Axes of redundant IMUs, triad by triad.

    owner : (n_triad,). IMU that the triad belongs to.
    alone : (n_triad, 3, 3). Weights by which the axes enter the solution of their IMU alone.
    shares : (2, n_triad). Weight of the axes in the mean, by sensor.
    prime : Whether the first IMU in use is used alone.
    """

    owner: Ints
    alone: Floats
    shares: Floats
    prime: bool


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
    card: ImuCard | ImuSet, units: ImuArray | None, ref: Reference, profiles: Sequence[Profile], hand_over: int = -1
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
        Tick of a hand-over at a stated time; -1 without.
    """
    if units is None or isinstance(card, ImuCard) or (card.parity is None and card.selection == "mean"):
        return units
    dt = 1.0 / card.rate
    owner = np.array([triad.unit for triad in triads_of(card)], dtype=np.int64)
    axes = _Axes(owner, own_solutions(card), axis_weights(card), card.selection == "prime")
    test = _parity_test(card, units, owner, dt)
    excludes = (card.parity or ParityCard()).after_detection != "report"
    along = np.array(along_axes(units, dt))
    errors = _profile_errors(units, profiles, 0.5 * (ref.t[:-1] + ref.t[1:]), dt)
    lost: list[tuple[int, int]] = []
    if card.parity is not None and excludes:
        lost = failed(along + errors, units.frames[:, :, 0], test)
    elif hand_over >= 0:
        lost = [(hand_over, 0)]
    means = []
    for n_lost in range(len(lost) + 1):
        excluded = {unit for _, unit in lost[:n_lost]}
        means.append(_mean_stage(units, axes, excluded).solved)
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
        mean=np.array(means),
    )
    statistics = _MedianStatistics(card, units, axes, ref, along, errors) if redundant.middle else None
    return _add_stages(units, axes, statistics, lost, redundant)


def _parity_test(card: ImuSet, units: ImuArray, owner: Ints, dt: float) -> ParityTest:
    """Return the parity test of an array; without one, that of the default card, which gives the weights."""
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
            drift = squares(term.walk) + 2.0 / term.time_constant * variance
            spread[term.sensor, term.triad] += variance
            walk[term.sensor, term.triad] += drift
    return spread, walk


def _profile_errors(units: ImuArray, profiles: Sequence[Profile], t: Floats, dt: float) -> Floats:
    """Return the errors of increments along the axes by deterministic profiles, (2, n_triad, n_tick, 3)."""
    n_triad, n_tick = units.dtheta.shape[:2]
    errors = np.zeros((2, n_triad, n_tick, 3))
    for code, driver, start, end, amplitude in profiles:
        triad, sensor = divmod(code, 2)
        growth = np.clip((t - start) / (end - start), 0.0, 1.0)
        parameter = growth[:, None] * np.array(amplitude)
        errors[sensor, triad] += parameter * inputs_of(units, dt, driver, triad, sensor)
    has_axis = np.arange(3) < units.n_axis[:, None]
    return errors * has_axis[None, :, None, :]


def _summed_variances(card: ImuSet, units: ImuArray, dt: float, ticks: int) -> tuple[Floats, Floats]:
    """Return the variances of increments along the axes, summed over windows of some ticks.

    Returns
    -------
    lasting, white
        (n_window, 2, n_triad, 3). By lasting errors and by white noise of the cards.
    """
    n_triad, n_tick = units.dtheta.shape[:2]
    edges = np.arange(0, n_tick + 1, ticks)
    lasting = np.zeros((edges.size - 1, 2, n_triad, 3))
    for term in terms_of(card):
        inputs = np.cumsum(inputs_of(units, dt, term.driver, term.triad, term.sensor), axis=0)
        from_start = np.vstack([np.zeros((1, 3)), inputs])
        summed = np.diff(from_start[edges], axis=0)
        parameter_variance = np.array(squares(term.sigma)) + np.array(squares(term.walk)) * dt * edges[1:, None]
        lasting[:, term.sensor, term.triad] += parameter_variance * summed**2
    white = np.empty((2, n_triad, 3))
    for sensor in range(2):
        noise = units.white[:, 3 * sensor : 3 * sensor + 3]
        step = units.white[:, 6 + sensor, None]
        # of the uniform rounding errors (step^2 / 12) of a sum only those of its first and last sample remain
        white[sensor] = ticks * noise**2 + step**2 / 6.0
    return lasting, np.broadcast_to(white[None], lasting.shape)


def _variance(card: ImuSet, units: ImuArray, dt: float, ticks: int) -> Floats:
    """Return the variance (n_window, 2, n_triad, 3) of a summed increment along an axis; infinite without an axis."""
    lasting, white = _summed_variances(card, units, dt, ticks)
    has_axis = np.arange(3) < units.n_axis[:, None]
    return np.asarray(np.where(has_axis, lasting + white, np.inf))


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
    by_window = along[:, :, : n_window * tests.ticks].reshape(2, n_triad, n_window, tests.ticks, 3)
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
                excluded.append(((window + 1) * tests.ticks, unit))
    return excluded


def _least_residual_ratio(
    y: Floats, directions: Floats, weight: Floats, tests: ParityTest, out: set[int]
) -> tuple[float, int]:
    """Return the smallest residual ratio of a fit without one more IMU, and that IMU.

    If a failure hands over from a prime IMU, these are 0 and the first IMU in use.
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
    y: Floats, directions: Floats, weight: Floats, tests: ParityTest, out: set[int], alone: bool = False
) -> float:
    """Return the weighted sum of squared residuals of a fit without the IMUs in `out`, divided by its limit.

    Without redundancy it is 0, or infinite if the fit is a candidate for exclusion (`alone`).
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


class _CombinationStage(NamedTuple):
    """Combination of the IMUs in a stage of the flight.

    solved : (n_triad, 2, 3, 3). Weights of each axis in the combined triad.
    noisy : (2, 2, 3). Factor on lasting errors and on white noise, by sensor and axis.
    shift : (2, 3) rad, m/s. Mean error of a combined increment.
    """

    solved: Floats
    noisy: Floats
    shift: Floats


def _add_stages(
    units: ImuArray,
    axes: _Axes,
    statistics: "_MedianStatistics | None",
    lost: list[tuple[int, int]],
    redundant: ImuRedundancy,
) -> ImuArray:
    """Return the IMU array with the stages of the flight, tick by tick: with exclusions, and without.

    statistics : statistics of the middle value; None if the mean is used
    lost : ticks from which IMUs are excluded, and their numbers
    """
    n_tick = units.dtheta.shape[1]
    stages: list[_CombinationStage] = []
    index: dict[tuple[bytes, bytes, bytes], int] = {}

    def stage_number(first: int, excluded: set[int]) -> int:
        stage = _mean_stage(units, axes, excluded) if statistics is None else statistics.at(first, excluded)
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
        flown=without,
        redundant=redundant,
    )


def _mean_stage(units: ImuArray, axes: _Axes, excluded: set[int]) -> _CombinationStage:
    """Return the stage with the mean of the IMUs that are not excluded; of a prime IMU, with the first of them."""
    solved = units.solved[0]
    if excluded:
        in_use = ~np.isin(axes.owner, list(excluded))
        if axes.prime:
            in_use &= axes.owner == axes.owner[in_use].min()
        has_axis = np.arange(3) < units.n_axis[:, None]
        triad, axis = np.nonzero(has_axis & in_use[:, None])
        solved = np.zeros_like(solved)
        for sensor, shares in enumerate(axes.shares):
            A = least_squares(units.frames[triad, axis, 0], shares[triad])
            solved[triad, sensor, :, axis] = A.T
    return _CombinationStage(solved, noisy=np.ones((2, 2, 3)), shift=np.zeros((2, 3)))


class _MedianStatistics:
    """Statistics of the middle value along a flight."""

    def __init__(
        self, card: ImuSet, units: ImuArray, axes: _Axes, ref: Reference, along: Floats, errors: Floats
    ) -> None:
        dt = 1.0 / card.rate
        n_tick = units.dtheta.shape[1]
        step = min(n_tick, max(1, round(STAGE / dt)))
        self.step = step
        self._units = units
        self._owner = axes.owner
        self._alone = axes.alone
        self._n = int(axes.owner.max()) + 1
        lasting, white = _summed_variances(card, units, dt, step)
        self._white = np.sqrt(self._solution_variances(white)[0] / step)
        self._lasting = np.sqrt(self._solution_variances(lasting)) / step
        solutions = np.stack([self._solutions(along[sensor] + errors[sensor]) for sensor in range(2)])
        true = np.stack([ref.dtheta, ref.dvel])
        # errors of a tick, averaged over each stage; a shorter last stage uses the errors of the stage before
        n_stage = len(lasting)
        solution_errors = (solutions - true[:, None])[:, :, : n_stage * step]
        self._errors = solution_errors.reshape(2, self._n, n_stage, step, 3).mean(axis=3)

    def _solutions(self, along: Floats) -> Floats:
        """Return the solution of each IMU alone, (n_unit, n_tick, 3), from increments (n_triad, n_tick, 3)."""
        solutions = np.zeros((self._n, *along.shape[1:]))
        for triad, unit in enumerate(self._owner):
            solutions[unit] += along[triad] @ self._alone[triad].T
        return solutions

    def _solution_variances(self, variance: Floats) -> Floats:
        """Return the variances (n, 2, n_unit, 3) of the solution of each IMU from those of axes, (n, 2, n_triad, 3)."""
        variances = np.zeros((len(variance), 2, self._n, 3))
        for triad, unit in enumerate(self._owner):
            variances[:, :, unit] += variance[:, :, triad] @ (self._alone[triad] ** 2).T
        return variances

    def at(self, tick: int, excluded: set[int]) -> _CombinationStage:
        """Return the stage of a tick without the excluded IMUs."""
        window = min(tick // self.step, self._errors.shape[2] - 1)
        in_use = [unit for unit in range(self._n) if unit not in excluded]
        solved = np.zeros_like(self._units.solved[0])
        noisy = np.ones((2, 2, 3))
        shift = np.zeros((2, 3))
        for sensor in range(2):
            for axis in range(3):
                error = self._errors[sensor, in_use, window, axis]
                white = self._white[sensor, in_use, axis]
                lasting = self._lasting[window, sensor, in_use, axis]
                median = _rounded_median(error, white, lasting)
                for triad, unit in enumerate(self._owner):
                    if unit in in_use:
                        gain = median.gains[in_use.index(int(unit))]
                        solved[triad, sensor, axis] = gain * self._alone[triad][axis]
                noisy[sensor, 0, axis] = median.lasting
                noisy[sensor, 1, axis] = median.white
                # mean of the median, minus the part that enters by the linear gains
                shift[sensor, axis] = white[0] * median.mean - median.gains @ (error - np.median(error))
        return _CombinationStage(solved, noisy, shift)


def _rounded_median(error: Floats, white: Floats, lasting: Floats) -> MedianModel:
    """Return the statistics of the middle value for rounded ratios, so that they can be cached.

    Quantities are in units of the first noise: deterministic errors about their median are rounded to a tenth and
    limited to 40, lasting errors to a tenth of their logarithm. Variances are returned as factors on the sigmas of the
    linear part.
    """
    deviations = (error - np.median(error)) / white[0]
    tenths = np.clip(np.rint(deviations * 10.0), -400.0, 400.0)
    log_ratios = np.log(np.maximum(lasting / white[0], 1e-4))
    exponents = np.rint(log_ratios * 10.0)
    return _cached_median(tuple(tenths), tuple(np.round(white / white[0], 6)), tuple(exponents))


@lru_cache(maxsize=4096)
def _cached_median(tenths: tuple[float, ...], white: tuple[float, ...], exponents: tuple[float, ...]) -> MedianModel:
    """Return the statistics of the middle value for the ratios of `_rounded_median`."""
    lasting_sigma = np.exp(np.array(exponents) / 10.0)
    white_sigma = np.array(white)
    median = middle(np.array(tenths) / 10.0, white_sigma, lasting_sigma)
    linear_lasting = np.sum((median.gains * lasting_sigma) ** 2)
    linear_white = np.sum((median.gains * white_sigma) ** 2)
    return median._replace(
        lasting=float(np.sqrt(median.lasting / linear_lasting)), white=float(np.sqrt(median.white / linear_white))
    )
