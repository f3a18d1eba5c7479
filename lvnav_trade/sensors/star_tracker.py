"""Star tracker: attitude in sensor axes, more accurate across than about the boresight.

Axes s: z along the boresight, x and y across. z - z_hat = C_s_i' att + v; the sigma of v is `across` about x and y, and
`about` about z.
"""

import math
from collections.abc import Iterator, Mapping
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from lvnav_trade.kernels.attitude import from_rotation, matrix, multiply, rotation_vector
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import Q
from lvnav_trade.quantities.frames import matrices
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.units import Angle, AngleSigma, AngularRateSigma, TimeConstant
from lvnav_trade.sensors.jacobian_row import H_ATT, clear
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
from lvnav_trade.trajectory.attitude_algebra import product

_ARCSEC = 648000.0 / math.pi


class StarTrackerModel(SensorModel):
    """Star tracker as the filter models it: white noise across and about its boresight, lasting errors as states."""

    states: ClassVar[Mapping[str, StateUnit]] = {
        "misalignment": StateUnit("tracker_misalignment", "rad", "arcsec", _ARCSEC),
        "low_frequency": StateUnit("tracker_low_frequency", "rad", "arcsec", _ARCSEC),
    }

    across: AngleSigma = Field(gt=0.0)
    about: AngleSigma = Field(gt=0.0)
    boresight: Direction = (1.0, 0.0, 0.0)
    misalignment: AngleSigma = Field(0.0, description="of the extra state tracker_misalignment: its one-sigma")
    low_frequency: AngleSigma = Field(0.0, description="of the extra state tracker_low_frequency: its one-sigma")
    low_frequency_time: TimeConstant | None = None

    def _faults(self) -> Iterator[str]:
        return boresight_faults(self.boresight)

    def variance(self, flight: FlightView) -> Floats:
        """Return the variance (1, 3) in rad^2."""
        return np.square([[self.across, self.across, self.about]])

    def filter_parameters(self, flight: FlightView) -> Floats:
        """Return the mounting (n_epoch, 4), a quaternion from sensor axes to body axes."""
        return np.tile(boresight_quaternion(self.boresight), (flight.t.size, 1))


class StarTrackerCard(SensorCard):
    """A star tracker: inertial attitude, available away from Sun and Earth and at low body rates."""

    measurement: ClassVar[str] = "stellar_attitude"
    model: ClassVar[type[SensorModel]] = StarTrackerModel
    labels: ClassVar[tuple[str, ...]] = ("x", "y", "boresight")
    unit: ClassVar[str] = "rad"
    jacobian: ClassVar[tuple[str, ...]] = ("attitude",)
    noise: ClassVar[str] = "star tracker noise"
    noise_fields: ClassVar[tuple[str, ...]] = ("across", "about")
    availability_phrase: ClassVar[str] = "Sun, Earth and body rate allow a solution"

    kind: Literal["star_tracker"] = "star_tracker"
    boresight: Direction = Field((1.0, 0.0, 0.0), description="direction in body axes, of any length")
    across: AngleSigma = Field(gt=0.0, description="white noise of a measurement about each axis across the boresight")
    about: AngleSigma = Field(gt=0.0, description="white noise of a measurement about the boresight")
    misalignment: AngleSigma = Field(0.0, description="constant mounting error, about each axis")
    low_frequency: AngleSigma = Field(
        0.0, description="slow error about each axis (stars that cross the field of view, heat): Gauss-Markov"
    )
    low_frequency_time: TimeConstant | None = Field(
        None, description="time constant of this error; none: constant during a run"
    )
    sun_exclusion: Angle | None = Field(
        None, ge=0.0, le=math.pi, description="least angle between boresight and Sun, unless the Earth hides it"
    )
    limb_exclusion: Angle | None = Field(
        None, ge=0.0, le=math.pi, description="least angle between boresight and the limb of the Earth"
    )
    highest_rate: AngularRateSigma | None = Field(
        None, gt=0.0, description="body rate above which it has no solution; none: any"
    )

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        yield from boresight_faults(self.boresight)

    def truth(self, flight: FlightView) -> Floats:
        """Return the attitude of the tracker (n_epoch, 4), a quaternion from sensor axes to frame i."""
        mounting = np.broadcast_to(boresight_quaternion(self.boresight), flight.q_b_i.shape)
        return np.asarray(product(flight.q_b_i, mounting))

    def noise_sigma(self, flight: FlightView) -> Floats:
        """Return the one-sigma (1, 3) in rad."""
        return np.array([[self.across, self.across, self.about]])

    def is_available(self, flight: FlightView) -> Bools:
        """Return whether Sun, limb and rate allow a solution, (n_epoch,)."""
        is_available = np.ones(flight.t.size, dtype=np.bool_)
        boresight = matrices(self.truth(flight))[:, :, 2]
        down, limb = earth_disc(flight)
        if self.sun_exclusion is not None:
            sun = sun_direction(flight.epoch, flight.t, flight.theta)
            is_hidden = angle(down, sun) < limb
            is_available &= (angle(boresight, sun) >= self.sun_exclusion) | is_hidden
        if self.limb_exclusion is not None:
            is_available &= angle(boresight, down) - limb >= self.limb_exclusion
        if self.highest_rate is not None:
            is_available &= np.linalg.norm(flight.w_ib_b, axis=1) <= self.highest_rate
        return is_available

    def correlated_errors(self) -> tuple[CorrelatedError, ...]:
        """Return misalignment and low-frequency error, independent on the three axes."""
        partials = each_scalar(len(self.labels))
        misalignment = CorrelatedError(
            "star tracker misalignment",
            "misalignment",
            self.misalignment,
            "misalignment",
            math.inf,
            self.labels,
            partials,
        )
        low_frequency = CorrelatedError(
            "star tracker low-frequency error",
            "low frequency",
            self.low_frequency,
            "low_frequency",
            self.low_frequency_time or math.inf,
            self.labels,
            partials,
        )
        return misalignment, low_frequency


@jit
def measure(out, truth, e0, e1, e2):
    """Set the measured attitude: the true attitude rotated by the errors about the axes of the sensor.

    Parameters
    ----------
    out : (4,)
        Measured quaternion from sensor axes to frame i, set here.
    truth : (4,)
        True quaternion from sensor axes to frame i.
    e0, e1, e2 : float
        Errors (rad) about sensor axes x, y and boresight.
    """
    q0, q1, q2, q3 = from_rotation(e0, e1, e2)
    out[0], out[1], out[2], out[3] = multiply(truth[0], truth[1], truth[2], truth[3], q0, q1, q2, q3)


@jit
def fill(H, z, first_row, measurement, nav, parameters):
    """Set the Jacobian rows of a stellar attitude and its innovation, the small rotation from estimate to measurement.

    Parameters
    ----------
    H : (n, n_entry)
        Jacobian rows of the epoch; three from `first_row` on are set.
    z : (n,)
        Innovations; three from `first_row` on are set (rad, sensor axes).
    first_row : int
        Index of the first scalar measurement.
    measurement : (4,)
        Measured quaternion, sensor axes to frame i.
    nav : (10,)
        Navigation state, frame i.
    parameters : (4,) or longer
        Mounting, a quaternion from sensor axes to body axes.
    """
    # estimated attitude of the tracker, and the rotation from it to the measured attitude
    s0, s1, s2, s3 = multiply(
        nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3], parameters[0], parameters[1], parameters[2], parameters[3]
    )
    d0, d1, d2, d3 = multiply(s0, -s1, -s2, -s3, measurement[0], measurement[1], measurement[2], measurement[3])
    z[first_row], z[first_row + 1], z[first_row + 2] = rotation_vector(d0, d1, d2, d3)
    c = matrix(s0, s1, s2, s3)
    for scalar in range(3):
        h = H[first_row + scalar]
        clear(h)
        for axis in range(3):
            h[H_ATT + axis] = c[3 * axis + scalar]


SENSORS = (
    Registration(
        StarTrackerCard,
        Evidence(
            "Star tracker",
            checks=(
                Check(
                    "closed form",
                    "n averaged updates across and about the boresight, and errors that last, to 1e-4",
                    "tests/both_engines/test_stellar.py"
                    "::test_what_lasts_is_averaged_by_its_correlation_and_a_misalignment_not_at_all",
                ),
                Check(
                    "both engines",
                    "200 runs of an oblique boresight",
                    "tests/both_engines/test_stellar.py::test_both_engines_agree_on_an_oblique_boresight",
                ),
                Check(
                    "published value",
                    "the Sun of a worked example to 0.01 deg",
                    "tests/sensors/test_optics.py::test_it_stands_where_the_published_example_has_it",
                ),
            ),
            omits="Stars: no catalogue, no lost-in-space phase, no Moon in the field, no plume; noise does "
            "not grow with the rate.",
        ),
        fill=fill,
        measure=measure,
        order=7,
    ),
)
