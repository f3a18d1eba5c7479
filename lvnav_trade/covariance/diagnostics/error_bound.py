"""Lower bounds on the modelled noise, which an exponential bound on the estimation error requires."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.components import build_components
from lvnav_trade.covariance.diagnostics.observability import initial_spread
from lvnav_trade.covariance.workspace import UpdateTape
from lvnav_trade.filter.ekf import inject
from lvnav_trade.filter.states import CARRIER_PHASE, DELTA_PSEUDORANGE, POSITION, PSEUDORANGE, TDCP, TYPES
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import add_axis_noise, predict
from lvnav_trade.kernels.jit import jit
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.sensors.family import SENSORS
from lvnav_trade.simulation.preparation.prepare import PreparedCase

FLOOR = 1e-9
"""Eigenvalue of the correlation matrix of the noise below which it counts as zero; rounding errors reach 1e-12."""
_UNITS = {TYPES[card.measurement]: card.unit for card in SENSORS} | dict.fromkeys(
    (PSEUDORANGE, POSITION, CARRIER_PHASE, TDCP, DELTA_PSEUDORANGE), "m"
)


class ErrorBound(NamedTuple):
    """Bounds q1 I <= Q <= q2 I and r1 I <= R <= r2 I of the noise in the filter model over a nominal flight.

    The condition holds if Q has full rank and every measurement has noise.

    rank : Rank of Q, the process noise between two updates; the smallest of all intervals.
    state_count : Number of states.
    smallest_eigenvalue : Smallest eigenvalue of Q, with states in units of their initial sigmas.
    largest_eigenvalue : Largest eigenvalue of Q, likewise.
    weakest_direction : (n,). Direction of the smallest eigenvalue, in initial sigmas; its largest entry is 1.
    noise_bounds : Unit, smallest and largest one-sigma of the measurement noise, by unit.
    """

    rank: int
    state_count: int
    smallest_eigenvalue: float
    largest_eigenvalue: float
    weakest_direction: Floats
    noise_bounds: tuple[tuple[str, float, float], ...]

    @property
    def is_satisfied(self) -> bool:
        """Whether both lower bounds are positive."""
        return self.rank == self.state_count and all(low > 0.0 for _, low, _ in self.noise_bounds)


@jit
def _gather(noise, P, D, tape, schedule, components, model):
    """Set the process noise between successive updates; return the number of intervals.

    Noise after the last update is not included.

    Parameters
    ----------
    noise : (n_interval, n, n) SI squared, set here
    P, D : (n, n) and (n_block, 9) scratch
    tape, schedule : UpdateTape of the forward pass, Schedule
    components, model : Components, FilterModel
    """
    n = P.shape[0]
    count = 0
    P[:, :] = 0.0
    for w in range(schedule.n_tick.size):
        if schedule.n_tick[w] > 0:
            length_index = schedule.length_index[w]
            seconds = model.seconds[length_index]
            decay = model.decay[length_index]
            q = model.noise[length_index]
            sums = tape.sums[w]
            position = tape.position[w]
            x = position[0]
            y = position[1]
            z = position[2]
            transition.fill(D, components.nav_kinds, components.nav_drivers, sums, x, y, z, seconds)
            add_axis_noise(P, model.excess_density, sums, seconds)
            predict(P, D, components.nav_rows, components.nav_columns, decay, q, model.clock, seconds)
            add_axis_noise(P, model.excess_density, sums, seconds)
            inject(P, model, schedule.injection[w])
        has_update = tape.first[w + 1] > tape.first[w]
        if has_update:
            for i in range(n):
                for j in range(n):
                    noise[count, i, j] = P[i, j]
                    P[i, j] = 0.0
            count += 1
    return count


def error_bound(prepared_case: PreparedCase, tape: UpdateTape) -> ErrorBound:
    """Return the bounds of the noise in the filter model on its nominal flight.

    They are sufficient conditions for an error bounded in mean square (Reif, Guenther, Yaz and Unbehauen, IEEE Trans.
    Automatic Control 44(4), 1999), in the form of Canepa and Servidia, eq. 7.17 and 7.18.

    Parameters
    ----------
    prepared_case
        Prepared case.
    tape
        Tape of the forward pass.

    Raises
    ------
    InputError
        If the flight has no measurement.
    """
    n_update = int(np.count_nonzero(np.diff(tape.first) > 0))
    if not n_update:
        raise InputError("covariance.error_bound: the filter uses no measurement on this trajectory")
    states = np.array(prepared_case.layout.reported_states)
    noise = _interval_noise(prepared_case, tape, n_update)[:, states[:, None], states]
    Q = noise[1:] if n_update > 1 else noise  # the time before the first update may be shorter than an interval
    P = prepared_case.initial_state.P[np.ix_(states, states)]
    scale, _ = initial_spread(P)
    divisor = np.where(scale > 0.0, scale, 1.0)
    Q = Q / np.outer(divisor, divisor)
    values, vectors = np.linalg.eigh(Q)
    smallest = values[:, 0]
    largest = values[:, -1]
    weakest_interval = int(np.argmin(smallest))
    weakest_direction = vectors[weakest_interval, :, 0]
    largest_entry = np.argmax(np.abs(weakest_direction))
    return ErrorBound(
        rank=int(_ranks(Q).min()),
        state_count=states.size,
        smallest_eigenvalue=max(0.0, float(smallest.min())),
        largest_eigenvalue=float(largest.max()),
        weakest_direction=weakest_direction / weakest_direction[largest_entry],
        noise_bounds=_noise_bounds(prepared_case, tape),
    )


def _interval_noise(prepared_case: PreparedCase, tape: UpdateTape, n_update: int) -> Floats:
    """Return the process noise between successive updates, (n_update, n, n) SI squared.

    Parameters
    ----------
    prepared_case
        Prepared case.
    tape
        Tape of the forward pass.
    n_update
        Number of windows with an update.
    """
    n = prepared_case.layout.n_state
    components = build_components(prepared_case)
    n_block = components.nav_rows.size
    noise = np.zeros((n_update, n, n))
    P = np.zeros((n, n))
    D = np.zeros((n_block, 9))
    _gather(noise, P, D, tape, prepared_case.schedule, components, prepared_case.model)
    return noise


def _ranks(Q: Floats) -> Ints:
    """Return the ranks (n_interval,) of the correlation matrices of noise Q (n_interval, n, n)."""
    sigma = np.sqrt(np.einsum("kii->ki", Q))
    divisor = np.where(sigma > 0.0, sigma, 1.0)
    correlation = Q / (divisor[:, :, None] * divisor[:, None, :])
    is_positive = np.linalg.eigvalsh(correlation) > FLOOR
    return np.asarray(np.sum(is_positive, axis=1))


def _noise_bounds(prepared_case: PreparedCase, tape: UpdateTape) -> tuple[tuple[str, float, float], ...]:
    """Return unit, smallest and largest one-sigma of the noise of all processed measurements, by unit."""
    n_update = int(tape.n_recorded[0])
    epoch = tape.epoch[:n_update]
    channel = tape.channel[:n_update]
    sigma = np.sqrt(prepared_case.signals.variance[epoch, channel])
    channel_types = prepared_case.model.channel_type[channel].tolist()
    units = np.array([_UNITS.get(channel_type, "m/s") for channel_type in channel_types])
    bounds = []
    for unit in dict.fromkeys(("m", "m/s", *units.tolist())):
        sigmas = sigma[units == unit]
        if sigmas.size:
            smallest = float(sigmas.min())
            largest = float(sigmas.max())
            bounds.append((unit, smallest, largest))
    return tuple(bounds)
