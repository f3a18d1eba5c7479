"""Sensing elements of an IMU: output beyond full scale, and dead elements."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.records import Bools, Floats


class Dead(NamedTuple):
    """A dead sensing element.

    axis : Index of its axis.
    ticks : (n_tick,). Whether it is dead at the tick.
    last : Whether it repeats its last output; otherwise its output is zero.
    """

    axis: int
    ticks: Bools
    last: bool


def put_out(increments: Floats, axes: Floats, limit: float, dead: Sequence[Dead] = ()) -> Floats:
    """Return the increments after clipping at full scale and dead elements.

    Bias, noise and scale factor are errors of the electronics and are added after this step.

    Parameters
    ----------
    increments : (n_tick, 3) rad or m/s
        Increments of angle or velocity, body axes.
    axes : (k, 3)
        Linearly independent unit vectors of 1 to 3 sensing axes. Components across all of them do not change.
    limit : float
        Largest increment (rad or m/s) of a tick, of either sign; inf: none.
    dead : sequence of Dead

    Returns
    -------
    (n_tick, 3) rad or m/s
        The array `increments` itself if nothing is clipped or dead.
    """
    if not dead and float(np.max(np.einsum("ij,ij->i", increments, increments), initial=0.0)) < 0.99 * limit**2:
        return increments  # the component along an axis is at most the length of the vector
    along = increments @ axes.T
    output = np.clip(along, -limit, limit)
    for element in dead:
        at = np.flatnonzero(element.ticks)
        if at.size:
            output[at, element.axis] = output[at[0] - 1, element.axis] if element.last and at[0] > 0 else 0.0
    if np.array_equal(output, along):
        return increments
    return np.asarray(increments + (output - along) @ np.linalg.pinv(axes).T)
