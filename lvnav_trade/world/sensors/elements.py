"""Sensing elements of an IMU: output beyond full scale, and dead elements."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.records import Bools, Floats


class Dead(NamedTuple):
    """A dead element: number (from 0) of its axis, ticks (n_tick,) at which it is dead; last: it repeats what it put
    out before them.
    """

    axis: int
    ticks: Bools
    last: bool


def put_out(increments: Floats, axes: Floats, limit: float, dead: Sequence[Dead] = ()) -> Floats:
    """Return what elements along some axes make of increments of angle or velocity, both (n_tick, 3), body axes.

    An element clips what is beyond its full scale. Bias, noise and scale factor come after it: they are of the
    electronics. Nothing is copied where nothing is clipped or dead.

    Parameters
    ----------
    axes
        Unit vectors (k, 3), k of 1 to 3, linearly independent; what is across them stays.
    limit
        Largest increment (rad or m/s) of a tick, either sign; inf: none.
    """
    if not dead and float(np.max(np.einsum("ij,ij->i", increments, increments), initial=0.0)) < 0.99 * limit**2:
        return increments  # no axis has more of it than its length
    along = increments @ axes.T
    found = np.clip(along, -limit, limit)
    for one in dead:
        at = np.flatnonzero(one.ticks)
        if at.size:
            found[at, one.axis] = found[at[0] - 1, one.axis] if one.last and at[0] > 0 else 0.0
    if np.array_equal(found, along):
        return increments
    return np.asarray(increments + (found - along) @ np.linalg.pinv(axes).T)
