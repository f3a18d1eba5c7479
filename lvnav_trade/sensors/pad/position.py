"""Known position: the surveyed position of the IMU while the vehicle is at rest on the pad.

z - z_hat = C_i_e pos + s + v, axes of frame e, with the constant survey error s.
"""

import math
from typing import ClassVar, Literal

from pydantic import Field

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import R
from lvnav_trade.quantities.frames import ecef_from_eci
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import LengthSigma
from lvnav_trade.sensors.jacobian_row import H_POS
from lvnav_trade.sensors.pad.standing import PadVectorCard, begin_rows, earth_components
from lvnav_trade.sensors.sensor import (
    Check,
    CorrelatedError,
    Evidence,
    FlightView,
    Registration,
    SensorModel,
    each_scalar,
)


class PadPositionModel(SensorModel):
    """Known position as the filter models it: white noise per axis in place of the sway."""

    sigma: LengthSigma = Field(gt=0.0)


class PadPositionCard(PadVectorCard):
    """The surveyed position of the IMU of a vehicle at rest on its pad."""

    measurement: ClassVar[str] = "pad_position"
    model: ClassVar[type[SensorModel]] = PadPositionModel
    unit: ClassVar[str] = "m"
    jacobian: ClassVar[tuple[str, ...]] = ("position",)
    noise: ClassVar[str] = "pad position noise"

    kind: Literal["pad_position"] = "pad_position"
    sigma: LengthSigma = Field(gt=0.0, description="sway per axis that a matched filter assumes")
    jitter: LengthSigma = Field(0.0, description="true white noise per axis, in addition to the sway of the trajectory")
    survey: LengthSigma = Field(0.0, description="constant error of the survey, per axis")

    def truth(self, flight: FlightView) -> Floats:
        """Return the position at rest (n_epoch, 3) in m, frame e."""
        return ecef_from_eci(flight.r_rest, flight.theta)

    def correlated_errors(self) -> tuple[CorrelatedError, ...]:
        """Return the error of the survey."""
        error = CorrelatedError("pad survey", "survey", self.survey, "survey", math.inf, self.labels, each_scalar(3))
        return (error,)


@jit
def fill(H, z, first_row, measurement, nav, theta):
    """Set the Jacobian rows of a known position and its innovations.

    Parameters
    ----------
    H : (n, n_entry)
        Jacobian rows of the epoch; three from `first_row` on are set.
    z : (n,)
        Innovations; three from `first_row` on are set (m, frame e).
    first_row : int
        Index of the first scalar measurement.
    measurement : (4,)
        Surveyed position (m, frame e) in the first three entries.
    nav : (10,)
        Navigation state, frame i.
    theta : float
        Earth angle (rad).
    """
    x, y = earth_components(theta, nav[R], nav[R + 1])
    z[first_row] = measurement[0] - x
    z[first_row + 1] = measurement[1] - y
    z[first_row + 2] = measurement[2] - nav[R + 2]
    begin_rows(H, first_row, H_POS, theta)


SENSORS = (
    Registration(
        PadPositionCard,
        Evidence(
            "Known position of the pad",
            checks=(
                Check(
                    "closed form",
                    "survey error plus averaged jitter to 0.5 %",
                    "tests/both_engines/test_alignment.py"
                    "::test_a_known_position_is_known_to_its_survey_and_its_averaged_jitter",
                ),
                Check(
                    "both engines",
                    "64 runs at lift-off, while the vehicle sways",
                    "tests/both_engines/test_alignment.py::test_both_engines_agree_at_lift_off",
                ),
            ),
            omits="A slow movement of the pad, as by fuelling or the Sun.",
        ),
        fill=fill,
        order=3,
    ),
)
