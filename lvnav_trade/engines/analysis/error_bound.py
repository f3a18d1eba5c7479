"""Lower bounds on the modelled noise, which an exponential bound on the estimation error requires."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.engines.analysis.observability import initial_spread
from lvnav_trade.engines.lincov.components import components
from lvnav_trade.engines.lincov.workspace import UpdateTape
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.errors import InputError
from lvnav_trade.filters.ekf import inject
from lvnav_trade.filters.rows import CARRIER_PHASE, DELTA_PSEUDORANGE, POSITION, PSEUDORANGE, TDCP, TYPES
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import add_turned, predict
from lvnav_trade.kernels.jit import jit
from lvnav_trade.observables.sensors import SENSORS
from lvnav_trade.records import Floats

FLOOR = 1e-9
"""An eigenvalue of the noise's correlation below counts as nothing: sums of thousands of windows are exact to 1e-12."""
_UNITS = {TYPES[card.measurement]: card.unit for card in SENSORS} | dict.fromkeys(
    (PSEUDORANGE, POSITION, CARRIER_PHASE, TDCP, DELTA_PSEUDORANGE), "m"
)


class ErrorBound(NamedTuple):
    """Bounds q I <= Q <= q I and r I <= R <= r I over a nominal flight.

    rank of Q, the noise between two updates, the smallest of all intervals; states of the filter; low, high eigenvalue
    of Q, states in initial sigmas; weakest (n,) direction of the interval of the lowest, in initial sigmas, largest
    entry of size 1; rows: unit, low, high one-sigma of the rows' noise by unit. The condition holds where Q has full
    rank and no row is without noise.
    """

    rank: int
    states: int
    low: float
    high: float
    weakest: Floats
    rows: tuple[tuple[str, float, float], ...]

    @property
    def holds(self) -> bool:
        """Whether both bounds are above zero."""
        return self.rank == self.states and all(low > 0.0 for _, low, _ in self.rows)


@jit
def _gather(noise, P, D, tape, schedule, true, model):
    """Fill noise (n_interval, n, n), what enters between two windows with rows; return how many there are.

    P (n, n) and D (n_block, 9) work; what is after the last row is left out.
    """
    n, count = P.shape[0], 0
    P[:, :] = 0.0
    for w in range(schedule.n_tick.size):
        if schedule.n_tick[w] > 0:
            length, at = schedule.length[w], tape.position[w]
            seconds = model.seconds[length]
            transition.fill(D, true.nav_kinds, true.nav_drivers, tape.sums[w], at[0], at[1], at[2], seconds)
            add_turned(P, model.uneven, tape.sums[w], seconds)
            predict(
                P,
                D,
                true.nav_rows,
                true.nav_columns,
                model.decay[length],
                model.noise[length],
                model.clock,
                seconds,
            )
            add_turned(P, model.uneven, tape.sums[w], seconds)
            inject(P, model, schedule.injection[w])
        if tape.first[w + 1] > tape.first[w]:
            for i in range(n):
                for j in range(n):
                    noise[count, i, j] = P[i, j]
                    P[i, j] = 0.0
            count += 1
    return count


def error_bound(prepared: Prepared, tape: UpdateTape) -> ErrorBound:
    """Return the bounds of the noise that the filter assumes, on its nominal flight.

    Sufficient conditions of an error that stays bounded in mean square (Reif, Guenther, Yaz and Unbehauen, IEEE Trans.
    Automatic Control 44(4), 1999), as Canepa and Servidia state them, eq. 7.17 and 7.18. `tape`: the forward pass.
    InputError for a flight without a measurement.
    """
    true, model, n = components(prepared), prepared.model, prepared.layout.n_state
    updates = int(np.count_nonzero(np.diff(tape.first) > 0))
    if not updates:
        raise InputError("covariance.error_bound: the filter takes no measurement on this flight")
    noise = np.zeros((updates, n, n))
    _gather(
        noise,
        np.zeros((n, n)),
        np.zeros((true.nav_rows.size, 9)),
        tape,
        prepared.schedule,
        true,
        model,
    )
    own = np.array(prepared.layout.reported)
    noise, n = noise[:, own[:, None], own], own.size
    kept = noise[1:] if updates > 1 else noise  # before the first update the stretch may be shorter than an interval
    scale = initial_spread(prepared.start.P[np.ix_(own, own)])[0]
    safe = np.where(scale > 0.0, scale, 1.0)
    kept = kept / np.outer(safe, safe)
    root = np.sqrt(np.einsum("kii->ki", kept))
    unit = np.where(root > 0.0, root, 1.0)
    ranks = np.sum(np.linalg.eigvalsh(kept / (unit[:, :, None] * unit[:, None, :])) > FLOOR, axis=1)
    values, vectors = np.linalg.eigh(kept)
    worst = int(np.argmin(values[:, 0]))
    direction = vectors[worst, :, 0]
    return ErrorBound(
        int(ranks.min()),
        n,
        max(0.0, float(values[:, 0].min())),
        float(values[:, -1].max()),
        direction / direction[np.argmax(np.abs(direction))],
        _rows(prepared, tape),
    )


def _rows(prepared: Prepared, tape: UpdateTape) -> tuple[tuple[str, float, float], ...]:
    """Return unit, lowest and highest one-sigma of the noise of the rows that were used, by unit."""
    used = int(tape.used[0])
    epoch, channel = tape.epoch[:used], tape.channel[:used]
    sigma = np.sqrt(prepared.signals.variance[epoch, channel])
    units = np.array([_UNITS.get(kind, "m/s") for kind in prepared.model.row_type[channel].tolist()])
    return tuple(
        (unit, float(sigma[units == unit].min()), float(sigma[units == unit].max()))
        for unit in dict.fromkeys(("m", "m/s", *units.tolist()))
        if np.any(units == unit)
    )
