"""Zero rotation: a vehicle on its pad keeps its attitude relative to the Earth, which is not known by itself.

A small rotation from the predicted attitude to the standing one, axes of frame e: z - z_hat = C_i_e att + m + v. The
three m, how far the standing attitude is from what was taken for it, last: the extra state standing_attitude.
"""

import math
from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import Field

from lvnav_trade.frames import matrices, quaternions, rotation_i_e
from lvnav_trade.kernels.attitude import multiply, small_rotation
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import Q
from lvnav_trade.observables.base import H_ATT
from lvnav_trade.observables.pad.standing import RestCard, begin_rows
from lvnav_trade.observables.sensor import FlightView, LastingError, SensorModel, StateUnit, each_scalar
from lvnav_trade.records import Floats
from lvnav_trade.units import AngleSigma

STANDING_ATTITUDE = "standing_attitude"


class ZeroRotationModel(SensorModel):
    """Zero rotation as the filter models it: white noise per axis in place of the twist, and the standing attitude."""

    states: ClassVar[Mapping[str, StateUnit]] = {"attitude": StateUnit(STANDING_ATTITUDE, "rad", "mrad", 1e3)}

    sigma: AngleSigma = Field(gt=0.0)
    attitude: AngleSigma = Field(gt=0.0, description="of the extra state standing_attitude: its initial one-sigma")


class ZeroRotationCard(RestCard):
    """The attitude relative to the Earth stays while the vehicle stands on its pad, known beforehand to `attitude`."""

    measurement: ClassVar[str] = "zero_rotation"
    model: ClassVar[type[SensorModel]] = ZeroRotationModel
    unit: ClassVar[str] = "rad"
    jacobian: ClassVar[tuple[str, ...]] = ("attitude",)
    noise: ClassVar[str] = "zero rotation noise"

    kind: Literal["zero_rotation"] = "zero_rotation"
    sigma: AngleSigma = Field(gt=0.0, description="of sway and twist, per axis, as a matched filter assumes it")
    jitter: AngleSigma = Field(0.0, description="true white noise per axis, beside sway and twist of the trajectory")
    attitude: AngleSigma = Field(gt=0.0, description="how well the standing attitude is known beforehand, per axis")

    def truth(self, flight: FlightView) -> Floats:
        """Return the attitude at rest (n_epoch, 4), a quaternion from body to frame e."""
        return quaternions(rotation_i_e(flight.theta) @ matrices(flight.q_rest))

    def lasting(self) -> tuple[LastingError, ...]:
        """Return the error of the attitude that is known beforehand."""
        known = ("attitude", math.inf, self.labels, each_scalar(3))
        return (LastingError("standing attitude", STANDING_ATTITUDE, self.attitude, *known),)


@jit
def fill(H, z, at, observed, nav, theta):
    """Set three Jacobian rows from `at` on, and the small rotation (rad, frame e) from the estimate to the measured
    attitude; theta rad of the Earth.
    """
    c, s = math.cos(0.5 * theta), math.sin(0.5 * theta)
    q0, q1, q2, q3 = multiply(c, 0.0, 0.0, -s, nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    z[at], z[at + 1], z[at + 2] = small_rotation(observed[0], observed[1], observed[2], observed[3], q0, q1, q2, q3)
    begin_rows(H, at, H_ATT, theta)
