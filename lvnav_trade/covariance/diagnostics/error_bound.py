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
            decay, q = model.decay[length], model.noise[length]
            sums, position = tape.sums[w], tape.position[w]
            transition.fill(D, true.nav_kinds, true.nav_drivers, sums, position[0], position[1], position[2], seconds)
            add_turned(P, model.uneven, sums, seconds)
            predict(P, D, true.nav_rows, true.nav_columns, decay, q, model.clock, seconds)
            add_turned(P, model.uneven, sums, seconds)
            inject(P, model, schedule.injection[w])
        if tape.first[w + 1] > tape.first[w]:
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
    scale, _ = initial_spread(prepared.start.P[np.ix_(states, states)])
    safe = np.where(scale > 0.0, scale, 1.0)
    Q = Q / np.outer(safe, safe)
    values, vectors = np.linalg.eigh(Q)
    weakest = vectors[int(np.argmin(values[:, 0])), :, 0]
    return ErrorBound(
        rank=int(_ranks(Q).min()),
        states=states.size,
        low=max(0.0, float(values[:, 0].min())),
        high=float(values[:, -1].max()),
        weakest=weakest / weakest[np.argmax(np.abs(weakest))],
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
    noise = np.zeros((n_update, n, n))
    P, D = np.zeros((n, n)), np.zeros((true.nav_rows.size, 9))
    _gather(noise, P, D, tape, prepared.schedule, true, prepared.model)
    return noise


def _ranks(Q: Floats) -> Ints:
    """Return the ranks (n_interval,) of the correlation matrices of noise Q (n_interval, n, n)."""
    sigma = np.sqrt(np.einsum("kii->ki", Q))
    safe = np.where(sigma > 0.0, sigma, 1.0)
    correlation = Q / (safe[:, :, None] * safe[:, None, :])
    return np.asarray(np.sum(np.linalg.eigvalsh(correlation) > FLOOR, axis=1))


def _noise_bounds(prepared: Prepared, tape: UpdateTape) -> tuple[tuple[str, float, float], ...]:
    """Return unit, smallest and largest one-sigma of the noise of all processed measurements, by unit."""
    n_update = int(tape.used[0])
    epoch, channel = tape.epoch[:n_update], tape.channel[:n_update]
    sigma = np.sqrt(prepared.signals.variance[epoch, channel])
    units = np.array([_UNITS.get(row_type, "m/s") for row_type in prepared.model.row_type[channel].tolist()])
    bounds = []
    for unit in dict.fromkeys(("m", "m/s", *units.tolist())):
        of_unit = sigma[units == unit]
        if of_unit.size:
            bounds.append((unit, float(of_unit.min()), float(of_unit.max())))
    return tuple(bounds)
