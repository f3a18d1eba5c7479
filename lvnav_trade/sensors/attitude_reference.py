"""Attitude reference: the rotation from the estimated attitude to the measured one, axis by axis, frame i.

z - z_hat = att + v.
"""

from typing import ClassVar, Literal

from pydantic import Field

from lvnav_trade.kernels.attitude import from_rotation, multiply, small_rotation
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import Q
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import AngleSigma
from lvnav_trade.sensors.jacobian_row import H_ATT, clear
from lvnav_trade.sensors.sensor import Check, Evidence, FlightView, Registration, SensorCard, SensorModel


class AttitudeModel(SensorModel):
    """Attitude reference as the filter models it: white noise per axis."""

    sigma: AngleSigma = Field(gt=0.0)


class AttitudeReferenceCard(SensorCard):
    """A generic attitude sensor (magnetometer, horizon or star sensor): true attitude plus white noise on each axis."""

    measurement: ClassVar[str] = "attitude"
    model: ClassVar[type[SensorModel]] = AttitudeModel
    labels: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    unit: ClassVar[str] = "rad"
    jacobian: ClassVar[tuple[str, ...]] = ("attitude",)
    noise: ClassVar[str] = "attitude reference noise"

    kind: Literal["attitude_reference"] = "attitude_reference"
    sigma: AngleSigma = Field(gt=0.0, description="white noise of a measurement, per axis")

    def truth(self, flight: FlightView) -> Floats:
        """Return the attitude (n_epoch, 4), a quaternion from body to frame i."""
        return flight.q_b_i


@jit
def measure(out, truth, e0, e1, e2):
    """Set the measured attitude: the true attitude rotated by the errors about the axes of the frame.

    Parameters
    ----------
    out : (4,)
        Measured quaternion from the body to a frame, set here.
    truth : (4,)
        True quaternion from the body to this frame.
    e0, e1, e2 : float
        Errors (rad) about the axes of this frame.
    """
    q0, q1, q2, q3 = from_rotation(e0, e1, e2)
    out[0], out[1], out[2], out[3] = multiply(q0, q1, q2, q3, truth[0], truth[1], truth[2], truth[3])


@jit
def fill(H, z, first_row, measurement, nav):
    """Set the Jacobian rows of an attitude and its innovation, the small rotation from estimate to measurement.

    Parameters
    ----------
    H : (n, n_entry)
        Jacobian rows of the epoch; three from `first_row` on are set.
    z : (n,)
        Innovations; three from `first_row` on are set (rad, frame i).
    first_row : int
        Index of the first scalar measurement.
    measurement : (4,)
        Measured quaternion, body to frame i.
    nav : (10,)
        Navigation state, frame i.
    """
    z[first_row], z[first_row + 1], z[first_row + 2] = small_rotation(
        measurement[0], measurement[1], measurement[2], measurement[3], nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3]
    )
    for axis in range(3):
        clear(H[first_row + axis])
        H[first_row + axis, H_ATT + axis] = 0.0 * z[first_row] + 1.0


SENSORS = (
    Registration(
        AttitudeReferenceCard,
        Evidence(
            "Attitude reference",
            checks=(
                Check(
                    "closed form",
                    "the innovation is the attitude error plus the noise",
                    "tests/sensors/test_attitude_reference.py"
                    "::test_the_innovation_is_the_error_truth_minus_estimate_plus_the_noise",
                ),
                Check(
                    "both engines",
                    "400 runs, only while it measures",
                    "tests/simulation/preparation/test_sensors.py"
                    "::test_both_engines_take_an_attitude_reference_only_when_it_measures_and_agree",
                ),
            ),
            omits="The measurement principle: the noise is white and equal on all axes, without misalignment.",
        ),
        fill=fill,
        measure=measure,
        order=1,
    ),
)
