"""Lower bounds on the modelled noise, which an exponential bound on the estimation error requires."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.components import components
from lvnav_trade.covariance.diagnostics.observability import initial_spread
from lvnav_trade.covariance.workspace import UpdateTape
from lvnav_trade.filter.ekf import inject
from lvnav_trade.filter.states import CARRIER_PHASE, DELTA_PSEUDORANGE, POSITION, PSEUDORANGE, TDCP, TYPES
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import add_turned, predict
from lvnav_trade.kernels.jit import jit
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.sensors.family import SENSORS
from lvnav_trade.simulation.preparation.prepare import Prepared

FLOOR = 1e-9
"""Eigenvalue of the correlation matrix of the noise below which it counts as zero; rounding errors reach 1e-12."""
_UNITS = {TYPES[card.measurement]: card.unit for card in SENSORS} | dict.fromkeys(
    (PSEUDORANGE, POSITION, CARRIER_PHASE, TDCP, DELTA_PSEUDORANGE), "m"
)


class ErrorBound(NamedTuple):
    """Bounds q1 I <= Q <= q2 I and r1 I <= R <= r2 I of the noise in the filter model over a nominal flight.

    The condition holds if Q has full rank and every measurement has noise.

    rank : Rank of Q, the process noise between two updates; the smallest of all intervals.
    states : Number of states.
    low : Smallest eigenvalue of Q, with states in units of their initial sigmas.
    high : Largest eigenvalue of Q, likewise.
    weakest : (n,). Direction of the smallest eigenvalue, in initial sigmas; its largest entry is 1.
    rows : Unit, smallest and largest one-sigma of the measurement noise, by unit.
    """

    rank: int
    states: int
    low: float
    high: float
    weakest: Floats
    rows: tuple[tuple[str, float, float], ...]

    @property
    def holds(self) -> bool:
        """Whether both lower bounds are positive."""
        return self.rank == self.states and all(low > 0.0 for _, low, _ in self.rows)


@jit
def _gather(noise, P, D, tape, schedule, true, model):
    """Set the process noise between successive updates; return the number of intervals.

    Noise after the last update is not included.

    Parameters
    ----------
    noise : (n_interval, n, n) SI squared, set here
    P, D : (n, n) and (n_block, 9) scratch
    tape, schedule : UpdateTape of the forward pass, Schedule
    true, model : Components, FilterModel
    """
    n = P.shape[0]
    count = 0
    P[:, :] = 0.0
    for w in range(schedule.n_tick.size):
        if schedule.n_tick[w] > 0:
            length = schedule.length[w]
            seconds = model.seconds[length]
            decay = model.decay[length]
            q = model.noise[length]
            sums = tape.sums[w]
            position = tape.position[w]
            x = position[0]
            y = position[1]
            z = position[2]
            transition.fill(D, true.nav_kinds, true.nav_drivers, sums, x, y, z, seconds)
            add_turned(P, model.uneven, sums, seconds)
            predict(P, D, true.nav_rows, true.nav_columns, decay, q, model.clock, seconds)
            add_turned(P, model.uneven, sums, seconds)
            inject(P, model, schedule.injection[w])
        has_update = tape.first[w + 1] > tape.first[w]
        if has_update:
            for i in range(n):
                for j in range(n):
                    noise[count, i, j] = P[i, j]
                    P[i, j] = 0.0
            count += 1
    return count


def error_bound(prepared: Prepared, tape: UpdateTape) -> ErrorBound:
    """Return the bounds of the noise in the filter model on its nominal flight.

    They are sufficient conditions for an error bounded in mean square (Reif, Guenther, Yaz and Unbehauen, IEEE Trans.
    Automatic Control 44(4), 1999), in the form of Canepa and Servidia, eq. 7.17 and 7.18.

    Parameters
    ----------
    prepared
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
    states = np.array(prepared.layout.reported)
    noise = _interval_noise(prepared, tape, n_update)[:, states[:, None], states]
    Q = noise[1:] if n_update > 1 else noise  # the time before the first update may be shorter than an interval
    P = prepared.start.P[np.ix_(states, states)]
    scale, _ = initial_spread(P)
    safe = np.where(scale > 0.0, scale, 1.0)
    Q = Q / np.outer(safe, safe)
    values, vectors = np.linalg.eigh(Q)
    smallest = values[:, 0]
    largest = values[:, -1]
    weakest_interval = int(np.argmin(smallest))
    weakest = vectors[weakest_interval, :, 0]
    largest_entry = np.argmax(np.abs(weakest))
    return ErrorBound(
        rank=int(_ranks(Q).min()),
        states=states.size,
        low=max(0.0, float(smallest.min())),
        high=float(largest.max()),
        weakest=weakest / weakest[largest_entry],
        rows=_noise_bounds(prepared, tape),
    )


def _interval_noise(prepared: Prepared, tape: UpdateTape, n_update: int) -> Floats:
    """Return the process noise between successive updates, (n_update, n, n) SI squared.

    Parameters
    ----------
    prepared
        Prepared case.
    tape
        Tape of the forward pass.
    n_update
        Number of windows with an update.
    """
    n = prepared.layout.n_state
    true = components(prepared)
    n_block = true.nav_rows.size
    noise = np.zeros((n_update, n, n))
    P = np.zeros((n, n))
    D = np.zeros((n_block, 9))
    _gather(noise, P, D, tape, prepared.schedule, true, prepared.model)
    return noise


def _ranks(Q: Floats) -> Ints:
    """Return the ranks (n_interval,) of the correlation matrices of noise Q (n_interval, n, n)."""
    sigma = np.sqrt(np.einsum("kii->ki", Q))
    safe = np.where(sigma > 0.0, sigma, 1.0)
    correlation = Q / (safe[:, :, None] * safe[:, None, :])
    is_positive = np.linalg.eigvalsh(correlation) > FLOOR
    return np.asarray(np.sum(is_positive, axis=1))


def _noise_bounds(prepared: Prepared, tape: UpdateTape) -> tuple[tuple[str, float, float], ...]:
    """Return unit, smallest and largest one-sigma of the noise of all processed measurements, by unit."""
    n_update = int(tape.used[0])
    epoch = tape.epoch[:n_update]
    channel = tape.channel[:n_update]
    sigma = np.sqrt(prepared.signals.variance[epoch, channel])
    row_types = prepared.model.row_type[channel].tolist()
    units = np.array([_UNITS.get(row_type, "m/s") for row_type in row_types])
    bounds = []
    for unit in dict.fromkeys(("m", "m/s", *units.tolist())):
        sigmas = sigma[units == unit]
        if sigmas.size:
            smallest = float(sigmas.min())
            largest = float(sigmas.max())
            bounds.append((unit, smallest, largest))
    return tuple(bounds)
