"""Zero velocity: a vehicle on its pad does not move over the rotating Earth.

z - z_hat = C_i_e (vel - Omega x pos) + v, axes of frame e.
"""

import math
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like
from lvnav_trade.kernels.strapdown import R, V
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import SpeedSigma
from lvnav_trade.sensors.jacobian_row import H_POS, H_VEL
from lvnav_trade.sensors.pad.standing import PadVectorCard, begin_rows, earth_components
from lvnav_trade.sensors.sensor import Check, Evidence, FlightView, Registration, SensorModel


class ZeroVelocityModel(SensorModel):
    """Zero velocity as the filter models it: white noise per axis in place of the sway."""

    sigma: SpeedSigma = Field(gt=0.0)


class ZeroVelocityCard(PadVectorCard):
    """Zero velocity relative to the Earth while the vehicle is at rest on its pad."""

    measurement: ClassVar[str] = "zero_velocity"
    model: ClassVar[type[SensorModel]] = ZeroVelocityModel
    unit: ClassVar[str] = "m/s"
    jacobian: ClassVar[tuple[str, ...]] = ("velocity", "position")
    noise: ClassVar[str] = "zero velocity noise"

    kind: Literal["zero_velocity"] = "zero_velocity"
    sigma: SpeedSigma = Field(gt=0.0, description="sway per axis that a matched filter assumes")
    jitter: SpeedSigma = Field(0.0, description="true white noise per axis, in addition to the sway of the trajectory")

    def truth(self, flight: FlightView) -> Floats:
        """Return zero, (n_epoch, 3) m/s."""
        return np.zeros((flight.t.size, 3))


@jit
def fill(H, z, first_row, measurement, nav, theta):
    """Set the Jacobian rows of the velocity relative to the Earth and its innovations.

    Parameters
    ----------
    H : (n, n_entry)
        Jacobian rows of the epoch; three from `first_row` on are set.
    z : (n,)
        Innovations; three from `first_row` on are set (m/s, frame e).
    first_row : int
        Index of the first scalar measurement.
    measurement : (4,)
        Measured velocity (m/s, frame e) in the first three entries.
    nav : (10,)
        Navigation state, frame i.
    theta : float
        Earth angle (rad).
    """
    # velocity relative to the Earth: vel - Omega x pos
    relative_x = nav[V] + OMEGA * nav[R + 1]
    relative_y = nav[V + 1] - OMEGA * nav[R]
    x, y = earth_components(theta, relative_x, relative_y)
    z[first_row] = measurement[0] - x
    z[first_row + 1] = measurement[1] - y
    z[first_row + 2] = measurement[2] - nav[V + 2]
    begin_rows(H, first_row, H_VEL, theta)
    # derivative by position: -C_i_e Omega x
    c = OMEGA * math.cos(theta)
    s = OMEGA * math.sin(theta)
    x_row = H[first_row]
    y_row = H[first_row + 1]
    x_row[H_POS] = number_like(z[first_row], -s)
    x_row[H_POS + 1] = number_like(z[first_row], c)
    y_row[H_POS] = number_like(z[first_row], -c)
    y_row[H_POS + 1] = number_like(z[first_row], -s)


SENSORS = (
    Registration(
        ZeroVelocityCard,
        Evidence(
            "Zero velocity on the pad",
            checks=(
                Check(
                    "closed form",
                    "tilt b / g to 0.2 %",
                    "tests/both_engines/test_alignment.py::test_tilt_is_accelerometer_bias_over_gravity",
                ),
                Check(
                    "closed form",
                    "heading e / (W cos L) to 0.5 % at three latitudes",
                    "tests/both_engines/test_alignment.py::test_heading_is_east_gyro_bias_over_the_earths_horizontal_rate",
                ),
                Check(
                    "both engines",
                    "64 runs at lift-off, while the vehicle sways",
                    "tests/both_engines/test_alignment.py::test_both_engines_agree_at_lift_off",
                ),
            ),
            omits="Coarse alignment (it is the start); a sway that differs from run to run; creep of the pad.",
        ),
        fill=fill,
        order=2,
    ),
)
