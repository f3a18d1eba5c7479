"""Combination of redundant IMUs by stage of the nominal flight: mean of the IMUs in use, or their middle value.

The middle value is treated by statistical linearisation (`imu.redundancy.median_model`).
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from lvnav_trade.imu.array import ImuSet, imu_error_terms, least_squares
from lvnav_trade.imu.redundancy import median_model
from lvnav_trade.quantities.per_axis import squares
from lvnav_trade.quantities.records import Floats, Ints, Reference
from lvnav_trade.simulation.preparation.imu_arrays import inputs_of
from lvnav_trade.simulation.preparation.imu_inputs import ImuArray

STAGE = 1.0
"""Interval (s) at which the statistics of the middle value are evaluated."""


class RedundantAxes(NamedTuple):
    """Axes of redundant IMUs, triad by triad.

    owner : (n_triad,). IMU that the triad belongs to.
    imu_weights : (n_triad, 3, 3). Weights by which the axes enter the solution of their IMU alone.
    shares : (2, n_triad). Weight of the axes in the mean, by sensor.
    uses_prime : Whether the first IMU in use is used alone.
    """

    owner: Ints
    imu_weights: Floats
    shares: Floats
    uses_prime: bool


class CombinationStage(NamedTuple):
    """Combination of the IMUs in a stage of the flight.

    axis_weights : (n_triad, 2, 3, 3). Weights of each axis in the combined triad.
    error_factors : (2, 2, 3). Factor on lasting errors and on white noise, by sensor and axis.
    shift : (2, 3) rad, m/s. Mean error of a combined increment.
    """

    axis_weights: Floats
    error_factors: Floats
    shift: Floats


def summed_variances(card: ImuSet, units: ImuArray, dt: float, n_test_tick: int) -> tuple[Floats, Floats]:
    """Return the variances of increments along the axes, summed over windows of some ticks.

    Parameters
    ----------
    card, units
        Card of the array, and its arrays.
    dt
        s. Tick.
    n_test_tick
        Number of ticks of a window.

    Returns
    -------
    lasting, white
        (n_window, 2, n_triad, 3) SI squared. By lasting errors and by white noise of the cards.
    """
    n_triad, n_tick = units.dtheta.shape[:2]
    edges = np.arange(0, n_tick + 1, n_test_tick)
    lasting = np.zeros((edges.size - 1, 2, n_triad, 3))
    window_end = edges[1:, None]
    for term in imu_error_terms(card):
        inputs = inputs_of(units, dt, term.driver, term.triad, term.sensor)
        summed_inputs = np.cumsum(inputs, axis=0)
        from_start = np.vstack([np.zeros((1, 3)), summed_inputs])
        window_inputs = np.diff(from_start[edges], axis=0)
        initial_variance = np.array(squares(term.sigma))
        variance_rate = np.array(squares(term.walk))
        parameter_variance = initial_variance + variance_rate * dt * window_end
        lasting[:, term.sensor, term.triad] += parameter_variance * window_inputs**2
    white = np.empty((2, n_triad, 3))
    for sensor in range(2):
        first = 3 * sensor
        noise = units.white[:, first : first + 3]
        step = units.white[:, 6 + sensor, None]
        noise_variance = n_test_tick * noise**2
        # of the uniform rounding errors (step^2 / 12) of a sum only those of its first and last sample remain
        rounding_variance = step**2 / 6.0
        white[sensor] = noise_variance + rounding_variance
    return lasting, np.broadcast_to(white[None], lasting.shape)


def mean_stage(units: ImuArray, axes: RedundantAxes, excluded_imus: set[int]) -> CombinationStage:
    """Return the stage with the mean of the IMUs that are not excluded; of a prime IMU, with the first of them.

    Parameters
    ----------
    units
        IMU array.
    axes
        Axes of the redundant IMUs.
    excluded_imus
        Excluded IMUs.
    """
    axis_weights = units.axis_weights[0]
    if excluded_imus:
        is_excluded = np.isin(axes.owner, list(excluded_imus))
        is_in_use = ~is_excluded
        if axes.uses_prime:
            first_unit = axes.owner[is_in_use].min()
            is_in_use &= axes.owner == first_unit
        has_axis = np.arange(3) < units.n_axis[:, None]
        triad, axis = np.nonzero(has_axis & is_in_use[:, None])
        directions = units.frames[triad, axis, 0]
        axis_weights = np.zeros_like(axis_weights)
        for sensor, shares in enumerate(axes.shares):
            A = least_squares(directions, shares[triad])
            axis_weights[triad, sensor, :, axis] = A.T
    return CombinationStage(axis_weights, error_factors=np.ones((2, 2, 3)), shift=np.zeros((2, 3)))


class MedianStatistics:
    """Statistics of the middle value along a flight."""

    def __init__(
        self,
        card: ImuSet,
        units: ImuArray,
        axes: RedundantAxes,
        ref: Reference,
        increments: Floats,
        errors: Floats,
    ) -> None:
        dt = 1.0 / card.rate
        n_tick = units.dtheta.shape[1]
        step = min(n_tick, max(1, round(STAGE / dt)))
        self.step = step
        self._units = units
        self._owner = axes.owner
        self._imu_weights = axes.imu_weights
        self._n = int(axes.owner.max()) + 1
        lasting, white = summed_variances(card, units, dt, step)
        self._white = np.sqrt(self._solution_variances(white)[0] / step)
        self._lasting = np.sqrt(self._solution_variances(lasting)) / step
        solutions = np.stack([self._solutions(increments[sensor] + errors[sensor]) for sensor in range(2)])
        true = np.stack([ref.dtheta, ref.dvel])
        # errors of a tick, averaged over each stage; a shorter last stage uses the errors of the stage before
        n_stage = len(lasting)
        solution_errors = (solutions - true[:, None])[:, :, : n_stage * step]
        self._errors = solution_errors.reshape(2, self._n, n_stage, step, 3).mean(axis=3)

    def _solutions(self, increments: Floats) -> Floats:
        """Return the solution of each IMU alone, (n_unit, n_tick, 3), from increments (n_triad, n_tick, 3)."""
        shape = (self._n, *increments.shape[1:])
        solutions = np.zeros(shape)
        for triad, unit in enumerate(self._owner):
            gains = self._imu_weights[triad].T
            solutions[unit] += increments[triad] @ gains
        return solutions

    def _solution_variances(self, variance: Floats) -> Floats:
        """Return the variances (n, 2, n_unit, 3) of the solution of each IMU from those of axes, (n, 2, n_triad, 3)."""
        variances = np.zeros((len(variance), 2, self._n, 3))
        for triad, unit in enumerate(self._owner):
            squared_gains = (self._imu_weights[triad] ** 2).T
            variances[:, :, unit] += variance[:, :, triad] @ squared_gains
        return variances

    def stage(self, tick: int, excluded_imus: set[int]) -> CombinationStage:
        """Return the stage of a tick without the excluded IMUs."""
        last_window = self._errors.shape[2] - 1
        window = min(tick // self.step, last_window)
        imus_in_use = [unit for unit in range(self._n) if unit not in excluded_imus]
        axis_weights = np.zeros_like(self._units.axis_weights[0])
        error_factors = np.ones((2, 2, 3))
        shift = np.zeros((2, 3))
        for sensor in range(2):
            for axis in range(3):
                error = self._errors[sensor, imus_in_use, window, axis]
                white = self._white[sensor, imus_in_use, axis]
                lasting = self._lasting[window, sensor, imus_in_use, axis]
                median = _rounded_median(error, white, lasting)
                for triad, unit in enumerate(self._owner):
                    if unit in imus_in_use:
                        number = imus_in_use.index(int(unit))
                        gain = median.gains[number]
                        axis_weights[triad, sensor, axis] = gain * self._imu_weights[triad][axis]
                error_factors[sensor, 0, axis] = median.lasting
                error_factors[sensor, 1, axis] = median.white
                # mean of the median, minus the part that enters by the linear gains
                median_mean = white[0] * median.mean
                linear_mean = median.gains @ (error - np.median(error))
                shift[sensor, axis] = median_mean - linear_mean
        return CombinationStage(axis_weights, error_factors, shift)


class _MedianFactors(NamedTuple):
    """Statistics of the middle value of IMUs, with variances as factors on the sigmas of the linear part.

    gains : (n_unit,). Gain of each IMU.
    mean : Mean, in units of the first noise.
    lasting : Factor on the sigma of lasting errors.
    white : Factor on the sigma of white noise.
    """

    gains: Floats
    mean: float
    lasting: float
    white: float


def _rounded_median(error: Floats, white: Floats, lasting: Floats) -> _MedianFactors:
    """Return the statistics of the middle value for rounded ratios, so that they can be cached.

    Quantities are in units of the first noise: deterministic errors about their median are rounded to a tenth and
    limited to 40, lasting errors to a tenth of their logarithm.
    """
    first_white = white[0]
    deviations = (error - np.median(error)) / first_white
    rounded_deviations = np.rint(deviations * 10.0)
    tenths = np.clip(rounded_deviations, -400.0, 400.0)
    lasting_ratios = np.maximum(lasting / first_white, 1e-4)
    log_ratios = np.log(lasting_ratios)
    exponents = np.rint(log_ratios * 10.0)
    white_ratios = np.round(white / first_white, 6)
    return _cached_median(tuple(tenths), tuple(white_ratios), tuple(exponents))


@lru_cache(maxsize=4096)
def _cached_median(tenths: tuple[float, ...], white: tuple[float, ...], exponents: tuple[float, ...]) -> _MedianFactors:
    """Return the statistics of the middle value for the ratios of `_rounded_median`."""
    lasting_sigma = np.exp(np.array(exponents) / 10.0)
    white_sigma = np.array(white)
    deviations = np.array(tenths) / 10.0
    median = median_model(deviations, white_sigma, lasting_sigma)
    linear_lasting = np.sum((median.gains * lasting_sigma) ** 2)
    linear_white = np.sum((median.gains * white_sigma) ** 2)
    lasting_factor = np.sqrt(median.constant_variance / linear_lasting)
    white_factor = np.sqrt(median.white_variance / linear_white)
    return _MedianFactors(median.gains, median.mean, lasting=float(lasting_factor), white=float(white_factor))
