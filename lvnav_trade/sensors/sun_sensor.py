"""Sun sensor: two angles of the Sun in axes of the sensor.

Axes s: z along the boresight, x and y across. With u = C_i^s s the direction s of the Sun in these axes,

    alpha = atan2(u_x, u_z),  beta = atan2(u_y, u_z),  z = (alpha, beta) + b + v

with a bias b and white noise v of each angle. Truth and filter compute s from the same almanac (`sensors/optics.py`),
whose error of 0.01 deg is part of the bias.
"""

import math
from collections.abc import Iterator, Mapping
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from lvnav_trade.kernels.attitude import cross, matrix, multiply
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import Q
from lvnav_trade.quantities.frames import matrices
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.units import Angle, AngleSigma, TimeConstant
from lvnav_trade.sensors.jacobian_row import H_ATT, add_angle_error, arctangent, clear
from lvnav_trade.sensors.optics import (
    Direction,
    angle,
    boresight_faults,
    boresight_quaternion,
    earth_disc,
    sun_direction,
)
from lvnav_trade.sensors.sensor import (
    Check,
    CorrelatedError,
    Evidence,
    FlightView,
    Registration,
    SensorCard,
    SensorModel,
    StateUnit,
    each_scalar,
)

SEMIDIAMETER = math.radians(959.63 / 3600.0)  # of the Sun at a distance of 1 au (IAU)
SUN = 4  # index of the Sun's direction in the filter parameters, after the mounting


class SunSensorModel(SensorModel):
    """Sun sensor as the filter models it: white noise of both angles, their biases as states."""

    states: ClassVar[Mapping[str, StateUnit]] = {"bias": StateUnit("sun_sensor_bias", "rad", "mrad", 1e3)}

    sigma: AngleSigma = Field(gt=0.0)
    boresight: Direction = (1.0, 0.0, 0.0)
    bias: AngleSigma = Field(0.0, description="of the extra state sun_sensor_bias: its initial one-sigma")
    bias_time: TimeConstant | None = None

    def _faults(self) -> Iterator[str]:
        return boresight_faults(self.boresight)

    def filter_parameters(self, flight: FlightView) -> Floats:
        """Return mounting and Sun (n_epoch, 7): quaternion from sensor axes to body axes; direction, frame i."""
        mounting = np.tile(boresight_quaternion(self.boresight), (flight.t.size, 1))
        return np.hstack([mounting, sun_direction(flight.epoch, flight.t, flight.theta)])


class SunSensorCard(SensorCard):
    """A sun sensor: two angles of the Sun, while it is in the field of view and the Earth hides no part of it."""

    measurement: ClassVar[str] = "sun_direction"
    model: ClassVar[type[SensorModel]] = SunSensorModel
    labels: ClassVar[tuple[str, ...]] = ("alpha", "beta")
    unit: ClassVar[str] = "rad"
    jacobian: ClassVar[tuple[str, ...]] = ("attitude",)
    noise: ClassVar[str] = "sun sensor noise"
    availability_phrase: ClassVar[str] = "the Sun is in its field of view"

    kind: Literal["sun_sensor"] = "sun_sensor"
    boresight: Direction = Field((1.0, 0.0, 0.0), description="direction in body axes, of any length")
    field_of_view: Angle = Field(gt=0.0, lt=0.5 * math.pi, description="largest angle between boresight and Sun")
    sigma: AngleSigma = Field(gt=0.0, description="white noise of each angle")
    bias: AngleSigma = Field(0.0, description="lasting error of each angle: mounting, calibration, albedo")
    bias_time: TimeConstant | None = Field(None, description="time constant of this error; none: constant during a run")

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        yield from boresight_faults(self.boresight)

    def truth(self, flight: FlightView) -> Floats:
        """Return the angles of the Sun (n_epoch, 2) in rad."""
        x, y, z = self._sun(flight).T
        return np.stack([np.arctan2(x, z), np.arctan2(y, z)], axis=1)

    def is_available(self, flight: FlightView) -> Bools:
        """Return whether the Sun is in the field of view and its whole disc above the limb, (n_epoch,)."""
        down, limb = earth_disc(flight)
        sun = sun_direction(flight.epoch, flight.t, flight.theta)
        nadir_angle = angle(down, sun)
        is_above_limb = nadir_angle >= limb + SEMIDIAMETER
        is_in_view = self._sun(flight)[:, 2] >= math.cos(self.field_of_view)
        return np.asarray(is_above_limb & is_in_view)

    @property
    def limiting_field(self) -> str:
        """Its field of view."""
        return "field_of_view"

    def correlated_errors(self) -> tuple[CorrelatedError, ...]:
        """Return the independent biases of both angles."""
        time = self.bias_time or math.inf
        return (CorrelatedError("sun sensor bias", "sun bias", self.bias, "bias", time, self.labels, each_scalar(2)),)

    def _sun(self, flight: FlightView) -> Floats:
        """Return the direction of the Sun (n_epoch, 3), axes of the sensor."""
        C_b_i = matrices(flight.q_b_i)
        mounting = matrices(boresight_quaternion(self.boresight)[None])
        axes = C_b_i @ mounting
        sun_i = sun_direction(flight.epoch, flight.t, flight.theta)
        return np.asarray(np.einsum("nij,ni->nj", axes, sun_i))


@jit
def measure(out, truth, e0, e1):
    """Set cosine and sine of both measured angles.

    Parameters
    ----------
    out : (4,)
        Cosine and sine of alpha, cosine and sine of beta; set here.
    truth : (4,)
        True angles alpha and beta (rad) in the first two entries.
    e0, e1 : float
        Errors of the angles (rad).
    """
    alpha = truth[0]
    beta = truth[1]
    out[0], out[1] = add_angle_error(math.cos(alpha), math.sin(alpha), e0)
    out[2], out[3] = add_angle_error(math.cos(beta), math.sin(beta), e1)


@jit
def fill(H, z, first_row, measurement, nav, parameters):
    """Set the Jacobian rows of the two angles and their innovations.

    Parameters
    ----------
    H : (n, n_entry)
        Jacobian rows of the epoch; two from `first_row` on are set.
    z : (n,)
        Innovations; two from `first_row` on are set (rad).
    first_row : int
        Index of the first scalar measurement.
    measurement : (4,)
        Cosine and sine of alpha, cosine and sine of beta.
    nav : (10,)
        Navigation state, frame i.
    parameters : (7,) or longer
        Mounting, a quaternion from sensor axes to body axes; direction of the Sun, frame i.
    """
    q0, q1, q2, q3 = multiply(
        nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3], parameters[0], parameters[1], parameters[2], parameters[3]
    )
    c = matrix(q0, q1, q2, q3)
    sx = parameters[SUN]
    sy = parameters[SUN + 1]
    sz = parameters[SUN + 2]
    # boresight, and the component of the Sun's direction along it
    ax = c[2]
    ay = c[5]
    az = c[8]
    ahead = ax * sx + ay * sy + az * sz
    for scalar in range(2):
        # sensor axis of this angle, and the component of the Sun's direction along it
        ex = c[scalar]
        ey = c[3 + scalar]
        ez = c[6 + scalar]
        side = ex * sx + ey * sy + ez * sz
        # innovation: measured angle minus atan(side / ahead)
        cosine = measurement[2 * scalar]
        sine = measurement[2 * scalar + 1]
        opposite = sine * ahead - cosine * side
        adjacent = cosine * ahead + sine * side
        z[first_row + scalar] = arctangent(opposite, adjacent)
        # derivative of the angle by the Sun's direction
        scale = 1.0 / (side * side + ahead * ahead)
        side_partial = ahead * scale
        ahead_partial = side * scale
        px = side_partial * ex - ahead_partial * ax
        py = side_partial * ey - ahead_partial * ay
        pz = side_partial * ez - ahead_partial * az
        h = H[first_row + scalar]
        clear(h)
        h[H_ATT], h[H_ATT + 1], h[H_ATT + 2] = cross(px, py, pz, sx, sy, sz)


_TESTS = "tests/sensors/test_sun_sensor.py"
SENSORS = (
    Registration(
        SunSensorCard,
        Evidence(
            "Sun sensor",
            checks=(
                Check(
                    "closed form",
                    "information of n measurements: all of it across the Sun, none about it, to 2e-4",
                    f"{_TESTS}::test_attitude_is_known_across_the_sun_and_not_about_it",
                ),
                Check(
                    "independent implementation",
                    "Jacobian against differences of the angles to 1e-8 of an angle",
                    f"{_TESTS}::test_the_rows_are_the_derivatives_of_the_angles",
                ),
                Check(
                    "independent implementation",
                    "lines of sight to the rim of the Sun, past the Earth or into it",
                    f"{_TESTS}::test_it_measures_where_every_line_to_the_rim_of_the_sun_misses_the_earth",
                ),
                Check(
                    "both engines",
                    "biases neglected and estimated",
                    f"{_TESTS}::test_both_engines_agree_whatever_the_filter_makes_of_the_bias",
                ),
                Check(
                    "published value",
                    "the Sun of a worked example to 0.01 deg",
                    "tests/sensors/test_optics.py::test_it_stands_where_the_published_example_has_it",
                ),
            ),
            omits="How the light of the Earth depends on attitude; plume and parts of the vehicle in the field; "
            "refraction at the limb; parallax (9 arcsec).",
        ),
        fill=fill,
        measure=measure,
    ),
)
