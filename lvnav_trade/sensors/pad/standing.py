"""Base of the sensors on the pad, which measure while the vehicle is at rest, in axes of the rotating Earth."""

import math
from typing import ClassVar

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like
from lvnav_trade.quantities.records import Bools
from lvnav_trade.sensors.jacobian_row import clear
from lvnav_trade.sensors.sensor import FlightView, SensorCard


class PadSensorCard(SensorCard):
    """A sensor on the pad, available from the start of the flight until the vehicle moves from its pad.

    The measurement assumes a vehicle at rest on the rotating Earth. Sway and twist of the trajectory (its oscillation)
    are errors of the measurement.
    """

    is_on_pad: ClassVar[bool] = True
    availability_phrase: ClassVar[str] = "the vehicle stands on its pad"

    def is_available(self, flight: FlightView) -> Bools:
        """Return whether the vehicle is at rest, (n_epoch,) bool."""
        return flight.is_at_rest


class PadVectorCard(PadSensorCard):
    """A measurement of a vehicle at rest by axis of frame e: zero velocity, zero rotation, or constant position."""

    labels: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    noise_fields: ClassVar[tuple[str, ...]] = ("jitter",)
    has_no_latency: ClassVar[bool] = True


@jit
def begin_rows(H, first_row, entry, theta):
    """Clear three Jacobian rows and set three of their columns to the matrix C_i_e.

    Parameters
    ----------
    H : (n, n_entry)
        Jacobian rows of the epoch; three from `first_row` on are set.
    first_row : int
        Index of the first scalar measurement.
    entry : int
        First column of the matrix, as `H_POS`.
    theta : float
        Earth angle (rad).
    """
    for axis in range(3):
        clear(H[first_row + axis])
    zero = H[first_row, entry]
    c = math.cos(theta)
    s = math.sin(theta)
    x_row = H[first_row]
    y_row = H[first_row + 1]
    z_row = H[first_row + 2]
    x_row[entry] = number_like(zero, c)
    x_row[entry + 1] = number_like(zero, s)
    y_row[entry] = number_like(zero, -s)
    y_row[entry + 1] = number_like(zero, c)
    z_row[entry + 2] = number_like(zero, 1.0)


@jit
def earth_components(theta, x, y):
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
