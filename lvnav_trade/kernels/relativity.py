"""Relativistic terms of a pseudorange: the satellite clock's periodic term and the bending of time by the Earth."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.earth import GM

Floats = NDArray[np.float64]


def periodic(r: ArrayLike, v: ArrayLike) -> Floats:
    """Return what the eccentricity of a satellite's orbit adds to its pseudorange (...,) in m: 2 r.v / c.

    r, v (..., 3) m and m/s of the satellite at transmission, both in frame i or both in frame e (r.v is the same).

    Notes
    -----
    Clock offset (IS-GPS-200, 20.3.3.3.3.1): dt_r = F e sqrt(A) sin(E) = -2 r.v / c^2, to be added to the broadcast
    polynomial. The pseudorange carries minus c times the satellite's clock, so the term appears in it as -c dt_r.
    Canepa and Servidia, eq. 3.16, print dt_r itself as a delay: seconds, and of the other sign.
    """
    return np.asarray(2.0 * np.sum(np.asarray(r, dtype=float) * np.asarray(v, dtype=float), axis=-1) / SPEED_OF_LIGHT)


def shapiro(satellite_r: ArrayLike, receiver_r: ArrayLike) -> Floats:
    """Return what the Earth's gravity adds to a pseudorange (...,) in m, about 2 cm (Ashby 2003, section 5).

    satellite_r, receiver_r (..., 3) m from the Earth's centre, the same axes.
    """
    sent, received = np.asarray(satellite_r, dtype=float), np.asarray(receiver_r, dtype=float)
    around = np.linalg.norm(sent, axis=-1) + np.linalg.norm(received, axis=-1)
    distance = np.linalg.norm(sent - received, axis=-1)
    return np.asarray(2.0 * GM / SPEED_OF_LIGHT**2 * np.log((around + distance) / (around - distance)))


def relativity(satellite_r: ArrayLike, satellite_v: ArrayLike, receiver_r: ArrayLike) -> Floats:
    """Return both terms together, as they add to a pseudorange (...,) in m; vectors (..., 3) in frame i, SI."""
    return periodic(satellite_r, satellite_v) + shapiro(satellite_r, receiver_r)
