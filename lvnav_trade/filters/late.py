"""Measurements that are late: met where the unit's own solution was when they were valid, or carried on to the present.

Canepa and Servidia, algorithm 5.1 and eq. 7.19, 7.20. Buffered, the innovation is formed with the estimate of the time
of validity; gain and rows stand for the present (Phi over the delay is taken for one). Extrapolated, a receiver's
position and velocity are carried on by one Euler step with the unit's own velocity and acceleration, and what that adds
to their covariance is told to the update.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.kernels.attitude import matrix
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import where
from lvnav_trade.kernels.strapdown import Q, R, V, gravity
from lvnav_trade.kernels.transition import VEL

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# What is kept of the unit's own solution: navigation state, last increments, velocity a while before, acceleration that
# the epoch before was carried on with, and whether there was one.
NAV, LAST, EARLY, BEFORE, KNOWN, N_PAST = 0, 10, 16, 19, 22, 23


class Late(NamedTuple):
    """How a filter meets late measurements. extrapolated: or buffered; valid, early (n_window,): epoch whose state is
    kept at a window's end, or its velocity before, -1 none; delay (n_epoch,) s as the filter takes it; offset
    (n_epoch,) s from the tick of `valid` to the time of validity; base (n_epoch,) s from `early` to it; interval s
    between epochs; jitter (s^2), acceleration (m^2/s^4): variances believed of the delay and of the acceleration.
    """

    extrapolated: bool
    valid: Ints
    early: Ints
    delay: Floats
    offset: Floats
    base: Floats
    interval: float
    jitter: float
    acceleration: float


@jit
def _move(kept, seconds, dt, kind):
    """Move the kept state by less than a tick; its attitude is that of the tick."""
    c = matrix(kept[NAV + Q], kept[NAV + Q + 1], kept[NAV + Q + 2], kept[NAV + Q + 3])
    pulled = gravity(kind, kept[NAV + R], kept[NAV + R + 1], kept[NAV + R + 2])
    x, y, z = kept[LAST + 3] / dt, kept[LAST + 4] / dt, kept[LAST + 5] / dt
    for i in range(3):
        v = kept[NAV + V + i]
        pushed = pulled[i] + c[3 * i] * x + c[3 * i + 1] * y + c[3 * i + 2] * z
        kept[NAV + R + i] = kept[NAV + R + i] + seconds * (v + 0.5 * seconds * pushed)
        kept[NAV + V + i] = v + seconds * pushed


@inlined
def keep(kept, nav, previous, late, window, dt, kind):
    """Keep what the next late measurement will be met with, at the end of a window.

    kept (N_PAST,) updated; nav (10,), previous (6,) the unit's own state and last increments; late : Late, or None
    where nothing is compensated; dt s of a strapdown step; kind of gravity
    """
    if late is not None:
        if late.early[window] >= 0:
            for i in range(3):
                kept[EARLY + i] = nav[V + i]
        epoch = late.valid[window]
        if epoch >= 0:
            for i in range(10):
                kept[NAV + i] = nav[i]
            for i in range(6):
                kept[LAST + i] = previous[i]
            if late.offset[epoch] != 0.0:
                _move(kept, late.offset[epoch], dt, kind)


@jit
def carry_on(z, told, kept, P, late, epoch):
    """Carry a late solution on to the present, in the innovations z (6,), and add to its covariance told (6, 6) what
    that costs (eq. 7.20): the unit's own velocity and acceleration, the delay's error, and what an Euler step leaves.

    P (n, n) of the filter gives the velocity's part. kept : the acceleration of this epoch is kept for the next one.
    """
    delay, half = late.delay[epoch], 0.5 * late.delay[epoch] * late.delay[epoch]
    vx, vy, vz = kept[NAV + V], kept[NAV + V + 1], kept[NAV + V + 2]
    inverse = 1.0 / late.base[epoch]
    ax, ay, az = (vx - kept[EARLY]) * inverse, (vy - kept[EARLY + 1]) * inverse, (vz - kept[EARLY + 2]) * inverse
    # half the acceleration is left of the position, half its change of the velocity; the first epoch knows none
    rate = where(kept[KNOWN] > 0.0, half / late.interval, 0.0)
    bx, by, bz = rate * (ax - kept[BEFORE]), rate * (ay - kept[BEFORE + 1]), rate * (az - kept[BEFORE + 2])
    moves, bends = (vx, vy, vz, ax, ay, az), (half * ax, half * ay, half * az, bx, by, bz)
    square = delay * delay
    for i in range(6):
        z[i] = z[i] + delay * moves[i]
        for j in range(6):
            told[i, j] = told[i, j] + late.jitter * moves[i] * moves[j] + bends[i] * bends[j]
    for i in range(3):
        told[3 + i, 3 + i] = told[3 + i, 3 + i] + square * late.acceleration
        kept[BEFORE + i] = moves[3 + i]
        for j in range(3):
            told[i, j] = told[i, j] + square * P[VEL + i, VEL + j]
    kept[KNOWN] = 0.0 * vx + 1.0
