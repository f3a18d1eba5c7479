"""Zero rotation: a vehicle on its pad keeps its attitude relative to the Earth, which is not known exactly.

The small rotation from the predicted to the standing attitude, axes of frame e, is z - z_hat = C_i_e att + m + v. The
constant m is the error of the assumed standing attitude: the extra state standing_attitude.
"""

import math
from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import Field

from lvnav_trade.kernels.attitude import multiply, small_rotation
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import Q
from lvnav_trade.quantities.frames import matrices, quaternions, rotation_i_e
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import AngleSigma
from lvnav_trade.sensors.attitude_reference import measure
from lvnav_trade.sensors.jacobian_row import H_ATT
from lvnav_trade.sensors.pad.standing import PadVectorCard, begin_rows
from lvnav_trade.sensors.sensor import (
    Check,
    CorrelatedError,
    Evidence,
    FlightView,
    Registration,
    SensorModel,
    StateUnit,
    each_scalar,
)

STANDING_ATTITUDE = "standing_attitude"


class ZeroRotationModel(SensorModel):
    """Zero rotation as the filter models it: white noise per axis in place of the twist, and the standing attitude."""

    states: ClassVar[Mapping[str, StateUnit]] = {"attitude": StateUnit(STANDING_ATTITUDE, "rad", "mrad", 1e3)}

    sigma: AngleSigma = Field(gt=0.0)
    attitude: AngleSigma = Field(gt=0.0, description="of the extra state standing_attitude: its initial one-sigma")


class ZeroRotationCard(PadVectorCard):
    """Constant attitude relative to the Earth while the vehicle is at rest on its pad, known to `attitude`."""

    measurement: ClassVar[str] = "zero_rotation"
    model: ClassVar[type[SensorModel]] = ZeroRotationModel
    unit: ClassVar[str] = "rad"
    jacobian: ClassVar[tuple[str, ...]] = ("attitude",)
    noise: ClassVar[str] = "zero rotation noise"

    kind: Literal["zero_rotation"] = "zero_rotation"
    sigma: AngleSigma = Field(gt=0.0, description="sway and twist per axis that a matched filter assumes")
    jitter: AngleSigma = Field(
        0.0, description="true white noise per axis, in addition to sway and twist of the trajectory"
    )
    attitude: AngleSigma = Field(gt=0.0, description="initial one-sigma of the standing attitude, per axis")

    def truth(self, flight: FlightView) -> Floats:
        """Return the attitude at rest (n_epoch, 4), a quaternion from body to frame e."""
        return quaternions(rotation_i_e(flight.theta) @ matrices(flight.q_rest))

    def correlated_errors(self) -> tuple[CorrelatedError, ...]:
        """Return the error of the attitude known in advance."""
        error = CorrelatedError(
            "standing attitude",
            STANDING_ATTITUDE,
            self.attitude,
            "attitude",
            math.inf,
            self.labels,
            each_scalar(3),
        )
        return (error,)


@jit
def fill(H, z, first_row, measurement, nav, theta):
    """Set the Jacobian rows of the attitude at rest and its innovations.

    The innovation is the small rotation from the estimated to the measured attitude.

    Parameters
    ----------
    H : (n, n_entry)
        Jacobian rows of the epoch; three from `first_row` on are set.
    z : (n,)
        Innovations; three from `first_row` on are set (rad, frame e).
    first_row : int
        Index of the first scalar measurement.
    measurement : (4,)
        Measured quaternion, body to frame e.
    nav : (10,)
        Navigation state, frame i.
    theta : float
        Earth angle (rad).
    """
    # estimated attitude relative to frame e, which is rotated by theta about z
    c, s = math.cos(0.5 * theta), math.sin(0.5 * theta)
    q0, q1, q2, q3 = multiply(c, 0.0, 0.0, -s, nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    z[first_row], z[first_row + 1], z[first_row + 2] = small_rotation(
        measurement[0],
        measurement[1],
        measurement[2],
        measurement[3],
        q0,
        q1,
        q2,
        q3,
    )
    begin_rows(H, first_row, H_ATT, theta)


SENSORS = (
    Registration(
        ZeroRotationCard,
        Evidence(
            "Zero rotation on the pad",
            checks=(
                Check(
                    "closed form",
                    "gyro bias along the Earth's axis to its random walk, 1 %",
                    "tests/both_engines/test_alignment.py"
                    "::test_zero_rotation_tells_the_gyro_bias_along_the_earths_axis_to_its_random_walk",
                ),
                Check(
                    "both engines",
                    "64 runs at lift-off, while the vehicle sways",
                    "tests/both_engines/test_alignment.py::test_both_engines_agree_at_lift_off",
                ),
            ),
            omits="A slow tilt of the pad, as by fuelling or the Sun.",
        ),
        fill=fill,
        measure=measure,
        order=11,
    ),
)
