"""Base of the sensors on the pad, which measure while the vehicle is at rest, in axes of the rotating Earth."""

import math
from typing import ClassVar

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import like
from lvnav_trade.quantities.records import Bools
from lvnav_trade.sensors.jacobian_row import clear
from lvnav_trade.sensors.sensor import FlightView, SensorCard


class StandingCard(SensorCard):
    """A sensor on the pad, available from the start of the flight until the vehicle moves from its pad.

    The measurement assumes a vehicle at rest on the rotating Earth. Sway and twist of the trajectory (its oscillation)
    are errors of the measurement.
    """

    on_pad: ClassVar[bool] = True
    able: ClassVar[str] = "the vehicle stands on its pad"

    def available(self, flight: FlightView) -> Bools:
        """Return whether the vehicle is at rest, (n_epoch,) bool."""
        return flight.standing


class RestCard(StandingCard):
    """A measurement of a vehicle at rest by axis of frame e: zero velocity, zero rotation, or constant position."""

    labels: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    noise_fields: ClassVar[tuple[str, ...]] = ("jitter",)
    at_once: ClassVar[bool] = True


@jit
def begin_rows(H, at, entry, theta):
    """Clear three Jacobian rows and set three of their columns to the matrix C_i_e.

    Parameters
    ----------
    H : (n, n_entry)
        Jacobian rows of the epoch; three from `at` on are set.
    at : int
        Index of the first scalar measurement.
    entry : int
        First column of the matrix, as `H_POS`.
    theta : float
        Earth angle (rad).
    """
    for axis in range(3):
        clear(H[at + axis])
    zero = H[at, entry]
    c = math.cos(theta)
    s = math.sin(theta)
    x_row = H[at]
    y_row = H[at + 1]
    z_row = H[at + 2]
    x_row[entry] = like(zero, c)
    x_row[entry + 1] = like(zero, s)
    y_row[entry] = like(zero, -s)
    y_row[entry + 1] = like(zero, c)
    z_row[entry + 2] = like(zero, 1.0)


@jit
def to_earth(theta, x, y):
    """Return the x and y components in frame e of a vector in frame i; z is the same in both.

    Parameters
    ----------
    theta : float
        Earth angle (rad).
    x, y : float
        Components in frame i.
    """
    c = math.cos(theta)
    s = math.sin(theta)
    x_e = c * x + s * y
    y_e = c * y - s * x
    return x_e, y_e
