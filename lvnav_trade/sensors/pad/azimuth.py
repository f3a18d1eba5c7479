"""Optical azimuth: a theodolite measures the azimuth of a mirror on the vehicle, whose normal is the body y axis.

Azimuth from north to east in the plane of the local horizon; with m the normal, d down and m_h its part in that plane,
z - z_hat = (d - (m . d / |m_h|^2) m_h) . att + v. The horizon is that of the estimated position; its rotation with a
position error (1e-5 rad for 100 m) is neglected.
"""

import math
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from lvnav_trade.kernels.attitude import matrix
from lvnav_trade.kernels.earth import height_and_normal
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import sqrt
from lvnav_trade.kernels.strapdown import Q, R
from lvnav_trade.quantities.frames import matrices, rotation_i_n
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.units import AngleSigma
from lvnav_trade.sensors.jacobian_row import H_ATT, add_angle_error, clear
from lvnav_trade.sensors.pad.standing import PadSensorCard
from lvnav_trade.sensors.sensor import Check, CorrelatedError, Evidence, FlightView, Registration, SensorModel

_STEEPEST = 0.5  # smallest horizontal component of the mirror's normal for a measurement


class AzimuthModel(SensorModel):
    """Optical azimuth as the filter models it: white noise."""

    sigma: AngleSigma = Field(gt=0.0)


class AzimuthCard(PadSensorCard):
    """Azimuth of a mirror on the vehicle (its normal is the body's y axis), seen from the ground."""

    measurement: ClassVar[str] = "azimuth"
    model: ClassVar[type[SensorModel]] = AzimuthModel
    unit: ClassVar[str] = "rad"
    jacobian: ClassVar[tuple[str, ...]] = ("attitude",)
    noise: ClassVar[str] = "azimuth noise"

    kind: Literal["azimuth"] = "azimuth"
    sigma: AngleSigma = Field(gt=0.0, description="white noise of a measurement")
    bias: AngleSigma = Field(0.0, description="constant error of the surveyed line and of the mirror")

    def truth(self, flight: FlightView) -> Floats:
        """Return the azimuth of the mirror's normal (n_epoch, 1) in rad."""
        normal = self._normal(flight)
        return np.arctan2(normal[:, 1].copy(), normal[:, 0].copy())[:, None]

    def is_available(self, flight: FlightView) -> Bools:
        """Return whether the vehicle is at rest and the mirror's normal near enough to the horizon, (n_epoch,) bool."""
        horizontal = np.linalg.norm(self._normal(flight)[:, :2], axis=1)
        return flight.is_at_rest & (horizontal > _STEEPEST)

    def correlated_errors(self) -> tuple[CorrelatedError, ...]:
        """Return its bias."""
        return (CorrelatedError("azimuth bias", "azimuth_bias", self.bias, "bias", math.inf),)

    @staticmethod
    def _normal(flight: FlightView) -> Floats:
        """Return the mirror's normal (n_epoch, 3), north-east-down axes."""
        normal_i = matrices(flight.q_b_i)[:, :, 1]
        C_i_n = rotation_i_n(flight.r_i, flight.theta)
        return np.asarray(np.einsum("nij,nj->ni", C_i_n, normal_i))


@jit
def measure(out, truth, e0):
    """Set cosine and sine of the measured azimuth.

    Parameters
    ----------
    out : (4,)
        Measured values; the first two are set.
    truth : (4,)
        True azimuth (rad) in the first entry.
    e0 : float
        Error of the azimuth (rad).
    """
    cosine = math.cos(truth[0])
    sine = math.sin(truth[0])
    out[0], out[1] = add_angle_error(cosine, sine, e0)


@jit
def fill(H, z, first_row, measurement, nav):
    """Set the Jacobian row of an azimuth and its innovation.

    Parameters
    ----------
    H : (n, n_entry)
        Jacobian rows of the epoch; that at `first_row` is set.
    z : (n,)
        Innovations; that at `first_row` is set (rad).
    first_row : int
        Index of the scalar measurement.
    measurement : (4,)
        Cosine and sine of the measured azimuth in the first two entries.
    nav : (10,)
        Navigation state, frame i.
    """
    # axes of the local horizon: u up, e east, n north
    _, ux, uy, uz = height_and_normal(nav[R], nav[R + 1], nav[R + 2])
    level_square = ux * ux + uy * uy
    scale = 1.0 / sqrt(level_square)
    ex = -uy * scale
    ey = ux * scale
    nx = -uz * ey
    ny = uz * ex
    nz = ux * ey - uy * ex
    # components of the mirror's normal, the body y axis
    c = matrix(nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    mx = c[1]
    my = c[4]
    mz = c[7]
    north = nx * mx + ny * my + nz * mz
    east = ex * mx + ey * my
    up = ux * mx + uy * my + uz * mz
    horizontal_square = north * north + east * east
    inverse_square = 1.0 / horizontal_square
    # arc sine, to third order, of the sine of measured minus predicted azimuth
    cross_product = measurement[1] * north - measurement[0] * east
    sine = cross_product * sqrt(inverse_square)
    z[first_row] = sine * (1.0 + sine * sine * (1.0 / 6.0))
    # d - (m . d / |m_h|^2) m_h, with d = -u and m_h = north n + east e
    tilt = up * inverse_square
    horizontal_x = north * nx + east * ex
    horizontal_y = north * ny + east * ey
    horizontal_z = north * nz
    h = H[first_row]
    clear(h)
    h[H_ATT] = tilt * horizontal_x - ux
    h[H_ATT + 1] = tilt * horizontal_y - uy
    h[H_ATT + 2] = tilt * horizontal_z - uz


SENSORS = (
    Registration(
        AzimuthCard,
        Evidence(
            "Optical azimuth",
            checks=(
                Check(
                    "closed form",
                    "heading to its bias and averaged noise, 1 %",
                    "tests/both_engines/test_alignment.py::test_an_azimuth_gives_heading_to_its_bias_and_its_averaged_noise",
                ),
                Check(
                    "both engines",
                    "64 runs at lift-off, while the vehicle sways",
                    "tests/both_engines/test_alignment.py::test_both_engines_agree_at_lift_off",
                ),
            ),
            omits="Refraction and shimmer of the line of sight; mounting of the mirror apart from the bias.",
        ),
        fill=fill,
        measure=measure,
        order=4,
    ),
)
