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
    test = _test(card, units, owner, dt)
    excludes = (card.parity or ParityCard()).after_detection != "report"
    along = np.array(along_axes(units, dt))
    errors = _known(units, profiles, 0.5 * (ref.t[:-1] + ref.t[1:]), dt)
    tested = card.parity is not None and excludes
    lost = failed(along + errors, units.frames[:, :, 0], test) if tested else [(hand_over, 0)] * (hand_over >= 0)
    excluded = [{unit for _, unit in lost[:n]} for n in range(len(lost) + 1)]
    spread, walk = _of_biases(card)
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
        lost=np.array([at for at, _ in lost], dtype=np.int64),
        mean=np.array([_mean(units, axes, out).solved for out in excluded]),
    )
    statistics = _MedianStatistics(card, units, axes, ref, along, errors) if redundant.middle else None
    return _staged(units, axes, statistics, lost, redundant)


def _test(card: ImuSet, units: ImuArray, owner: Ints, dt: float) -> ParityTest:
    """Return the parity test of an array; without one, that of the default card, which gives the weights."""
    parity = card.parity or ParityCard()
    ticks = max(1, round(parity.window / dt))
    weight = 1.0 / _variance(card, units, dt, ticks)
    n_axis = int(units.n_axis.sum())
    n_test = 2 * weight.shape[0]
    limits = np.concatenate([[np.inf], chdtri(np.arange(1, max(2, n_axis - 2)), parity.false_alarm / max(1, n_test))])
    return ParityTest(ticks, weight, limits, owner, parity.after_detection == "hand_over")


def _of_biases(card: ImuSet) -> tuple[Floats, Floats]:
    """Return variance and variance rate of the random walk of the biases, (2, n_triad, 3) each, by sensor and axis."""
    spread, walk = np.zeros((2, 2, len(triads_of(card)), 3))
    for block in terms_of(card):
        if block.driver == CONSTANT:
            variance = np.array(squares(block.sigma))
            spread[block.sensor, block.triad] += variance
            walk[block.sensor, block.triad] += squares(block.walk) + 2.0 / block.time_constant * variance
    return spread, walk


def _known(units: ImuArray, profiles: Sequence[Profile], t: Floats, dt: float) -> Floats:
    """Return the errors of increments along the axes by deterministic profiles, (2, n_triad, n_tick, 3)."""
    n_triad, n_tick = units.dtheta.shape[:2]
    errors = np.zeros((2, n_triad, n_tick, 3))
    for code, driver, start, end, size in profiles:
        triad, sensor = divmod(code, 2)
        share = np.clip((t - start) / (end - start), 0.0, 1.0)[:, None] * np.array(size)
        errors[sensor, triad] += share * inputs_of(units, dt, driver, triad, sensor)
    return errors * (np.arange(3) < units.n_axis[:, None])[None, :, None, :]


def _spread(card: ImuSet, units: ImuArray, dt: float, ticks: int) -> tuple[Floats, Floats]:
    """Return the variances of increments along the axes, summed over windows of some ticks.

    Returns
    -------
    lasting, white
        (n_window, 2, n_triad, 3). By lasting errors and by white noise of the cards.
    """
    n_triad, n_tick = units.dtheta.shape[:2]
    edges = np.arange(0, n_tick + 1, ticks)
    lasting = np.zeros((edges.size - 1, 2, n_triad, 3))
    for block in terms_of(card):
        entering = np.cumsum(inputs_of(units, dt, block.driver, block.triad, block.sensor), axis=0)
        summed = np.diff(np.vstack([np.zeros((1, 3)), entering])[edges], axis=0)
        grown = np.array(squares(block.sigma)) + np.array(squares(block.walk)) * dt * edges[1:, None]
        lasting[:, block.sensor, block.triad] += grown * summed**2
    white = np.stack(
        [
            ticks * units.white[:, 3 * sensor : 3 * sensor + 3] ** 2 + units.white[:, 6 + sensor, None] ** 2 / 6.0
            for sensor in range(2)
        ]
    )
    return lasting, np.broadcast_to(white[None], lasting.shape)


def _variance(card: ImuSet, units: ImuArray, dt: float, ticks: int) -> Floats:
    """Return the variance (n_window, 2, n_triad, 3) of a summed increment along an axis; infinite without an axis."""
    lasting, white = _spread(card, units, dt, ticks)
    return np.asarray(np.where(np.arange(3) < units.n_axis[:, None], lasting + white, np.inf))


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
    n_unit = int(tests.owner.max()) + 1
    sums = along[:, :, : n_window * tests.ticks].reshape(2, along.shape[1], n_window, tests.ticks, 3).sum(axis=3)
    for window in range(n_window):
        for sensor in range(2):
            y = sums[sensor, :, window]
            weight = tests.weight[window, sensor]
            if _over(y, directions, weight, tests, out) <= 1.0:
                continue
            if tests.hands_over:
                ratios = [0.0] * n_unit  # the first in use, whichever has failed
            else:
                ratios = [_over(y, directions, weight, tests, out | {u}, True) for u in range(n_unit)]
            worst = min((ratio, u) for u, ratio in enumerate(ratios) if u not in out)
            if np.isfinite(worst[0]):
                out.add(worst[1])
                excluded.append(((window + 1) * tests.ticks, worst[1]))
    return excluded


def _over(
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
    residual = z - H @ np.linalg.lstsq(H, z, rcond=None)[0]
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


def _staged(
    units: ImuArray,
    own: _Axes,
    looked: "_MedianStatistics | None",
    lost: list[tuple[int, int]],
    redundant: ImuRedundancy,
) -> ImuArray:
    """Return the IMU array with the stages of the flight, tick by tick: with exclusions, and without.

    looked : statistics of the middle value; None if the mean is used
    lost : ticks from which IMUs are excluded, and their numbers
    """
    n_tick = units.dtheta.shape[1]
    stages: list[_CombinationStage] = []
    index: dict[tuple[bytes, bytes, bytes], int] = {}

    def number(stage: _CombinationStage) -> int:
        key = (stage.solved.tobytes(), stage.noisy.tobytes(), stage.shift.tobytes())
        if key not in index:
            index[key] = len(stages)
            stages.append(stage)
        return index[key]

    edges = sorted({0, n_tick, *(at for at, _ in lost), *(() if looked is None else range(0, n_tick, looked.step))})
    stage = np.zeros(n_tick, dtype=np.int64)
    flown = np.zeros(n_tick, dtype=np.int64)
    for first, last in pairwise(edges):
        out = {unit for at, unit in lost if at <= first}
        for numbers, excluded in ((flown, set[int]()), (stage, out)):
            numbers[first:last] = number(_mean(units, own, excluded) if looked is None else looked.at(first, excluded))
    return units._replace(
        solved=np.array([item.solved for item in stages]),
        noisy=np.array([item.noisy for item in stages]),
        shift=np.array([item.shift for item in stages]),
        stage=stage,
        flown=flown,
        redundant=redundant,
    )


def _mean(units: ImuArray, own: _Axes, out: set[int]) -> _CombinationStage:
    """Return the stage with the mean of the IMUs that are not in `out`; of a prime IMU, with the first of them."""
    solved = units.solved[0]
    if out:
        solved = np.zeros_like(solved)
        used = ~np.isin(own.owner, list(out))
        if own.prime:
            used &= own.owner == own.owner[used].min()
        use = (np.arange(3) < units.n_axis[:, None]) & used[:, None]
        triad, axis = np.nonzero(use)
        for sensor, shares in enumerate(own.shares):
            A = least_squares(units.frames[triad, axis, 0], shares[triad])
            solved[triad, sensor, :, axis] = A.T
    return _CombinationStage(solved, np.ones((2, 2, 3)), np.zeros((2, 3)))


class _MedianStatistics:
    """Statistics of the middle value along a flight."""

    def __init__(self, card: ImuSet, units: ImuArray, own: _Axes, ref: Reference, along: Floats, known: Floats) -> None:
        dt = 1.0 / card.rate
        self.step = step = min(units.dtheta.shape[1], max(1, round(STAGE / dt)))
        lasting, white = _spread(card, units, dt, step)
        self._units, self._own, self._alone = units, own, own.alone
        self._n = int(own.owner.max()) + 1
        self._white = np.sqrt(self._of_units(white)[0] / step)
        self._lasting = np.sqrt(self._of_units(lasting)) / step
        true = np.stack([ref.dtheta, ref.dvel])
        sensed = np.stack([self._solved(along[s] + known[s]) for s in range(2)])
        # errors of a tick, averaged over each stage; a shorter last stage uses the errors of the stage before
        off = (sensed - true[:, None])[:, :, : len(lasting) * step]
        self._off = off.reshape(2, self._n, len(lasting), step, 3).mean(axis=3)

    def _solved(self, along: Floats) -> Floats:
        """Return the solution of each IMU alone, (n_unit, n_tick, 3), from increments (n_triad, n_tick, 3)."""
        solutions = np.zeros((self._n, *along.shape[1:]))
        for triad, unit in enumerate(self._own.owner):
            solutions[unit] += along[triad] @ self._alone[triad].T
        return solutions

    def _of_units(self, variance: Floats) -> Floats:
        """Return the variances (n, 2, n_unit, 3) of the solution of each IMU from those of axes, (n, 2, n_triad, 3)."""
        variances = np.zeros((len(variance), 2, self._n, 3))
        for triad, unit in enumerate(self._own.owner):
            variances[:, :, unit] += variance[:, :, triad] @ (self._alone[triad] ** 2).T
        return variances

    def at(self, tick: int, out: set[int]) -> _CombinationStage:
        """Return the stage of a tick without the IMUs in `out`."""
        window = min(tick // self.step, self._off.shape[2] - 1)
        used = [unit for unit in range(self._n) if unit not in out]
        solved = np.zeros_like(self._units.solved[0])
        noisy = np.ones((2, 2, 3))
        shift = np.zeros((2, 3))
        for sensor in range(2):
            for axis in range(3):
                off = self._off[sensor, used, window, axis]
                white = self._white[sensor, used, axis]
                lasting = self._lasting[window, sensor, used, axis]
                selection = _rounded(off, white, lasting)
                for triad, unit in enumerate(self._own.owner):
                    if unit in used:
                        gain = selection.gains[used.index(int(unit))]
                        solved[triad, sensor, axis] = gain * self._alone[triad][axis]
                noisy[sensor, :, axis] = selection.lasting, selection.white
                shift[sensor, axis] = white[0] * selection.mean - selection.gains @ (off - np.median(off))
        return _CombinationStage(solved, noisy, shift)


def _rounded(off: Floats, white: Floats, lasting: Floats) -> MedianModel:
    """Return the statistics of the middle value for rounded ratios, so that they can be cached.

    Quantities are in units of the first noise: deterministic errors about their median are rounded to a tenth and
    limited to 40, lasting errors to a tenth of their logarithm. Variances are returned as factors on the sigmas of the
    linear part.
    """
    steps = np.clip(np.rint((off - np.median(off)) / white[0] * 10.0), -400.0, 400.0)
    exponents = np.rint(np.log(np.maximum(lasting / white[0], 1e-4)) * 10.0)
    return _remembered(tuple(steps), tuple(np.round(white / white[0], 6)), tuple(exponents))


@lru_cache(maxsize=4096)
def _remembered(steps: tuple[float, ...], white: tuple[float, ...], exponents: tuple[float, ...]) -> MedianModel:
    lasting_sigma = np.exp(np.array(exponents) / 10.0)
    white_sigma = np.array(white)
    statistics = middle(np.array(steps) / 10.0, white_sigma, lasting_sigma)
    lasting, noise = (np.sum((statistics.gains * sigma) ** 2) for sigma in (lasting_sigma, white_sigma))
    return statistics._replace(
        lasting=float(np.sqrt(statistics.lasting / lasting)), white=float(np.sqrt(statistics.white / noise))
    )
