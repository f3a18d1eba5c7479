"""Difference of two IMUs: increments of the first minus those of the second, summed since the previous measurement.

z - z_hat = T (b - b_hat) + v, body axes, with the bias b of the first minus that of the second, and the time T (s)
since the previous measurement. If IMUs are weighted by their noise, v is uncorrelated with the noise of the fused
increments.
"""

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from lvnav_trade.kernels.jit import jit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import AngleRandomWalk, VelocityRandomWalk
from lvnav_trade.sensors.jacobian_row import clear
from lvnav_trade.sensors.sensor import Check, Evidence, FlightView, Registration, SensorCard, SensorModel


class AngleDifferenceModel(SensorModel):
    """Difference of angle increments as the filter models it: combined random walk of both IMUs per axis."""

    noise_field: ClassVar[str] = "random_walk"

    random_walk: AngleRandomWalk = Field(gt=0.0)


class VelocityDifferenceModel(SensorModel):
    """Difference of velocity increments as the filter models it: combined random walk of both IMUs per axis."""

    noise_field: ClassVar[str] = "random_walk"

    random_walk: VelocityRandomWalk = Field(gt=0.0)


class ImuDifferenceCard(SensorCard):
    """Difference of two IMUs of an array; its errors are those of the IMUs."""

    labels: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    jacobian: ClassVar[tuple[str, ...]] = ()
    noise_fields: ClassVar[tuple[str, ...]] = ()
    has_no_latency: ClassVar[bool] = True

    name: str = "difference of two units"
    source: str = ""
    units: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]] = Field(
        (1, 2), description="numbers of the two units in the list of units; each has three or more sensing axes"
    )

    @model_validator(mode="after")
    def _check_units(self) -> Self:
        if self.units[0] == self.units[1]:
            raise ValueError("units: a unit does not differ from itself")
        return self

    def truth(self, flight: FlightView) -> Floats:
        """Return zeros (n_epoch, 3), because the difference consists of the errors of the IMUs."""
        return np.zeros((flight.t.size, 3))


class AngleDifferenceCard(ImuDifferenceCard):
    """Difference of the angle increments of two IMUs, body axes."""

    measurement: ClassVar[str] = "angle_difference"
    model: ClassVar[type[SensorModel]] = AngleDifferenceModel
    unit: ClassVar[str] = "rad"
    noise: ClassVar[str] = "angle difference noise"

    kind: Literal["angle_difference"] = "angle_difference"


class VelocityDifferenceCard(ImuDifferenceCard):
    """Difference of the velocity increments of two IMUs, body axes, with the lever-arm setting of the array."""

    measurement: ClassVar[str] = "velocity_difference"
    model: ClassVar[type[SensorModel]] = VelocityDifferenceModel
    unit: ClassVar[str] = "m/s"
    noise: ClassVar[str] = "velocity difference noise"

    kind: Literal["velocity_difference"] = "velocity_difference"


@jit
def fill(H, z, first_row, measurement):
    """Set the Jacobian rows of a difference of two IMUs, which are zero for the navigation state, and its innovations.

    Parameters
    ----------
    H : (n, n_entry)
        Jacobian rows of the epoch; three from `first_row` on are set.
    z : (n,)
        Innovations; three from `first_row` on are set (rad or m/s, body axes).
    first_row : int
        Index of the first scalar measurement.
    measurement : (4,)
        Summed difference of the increments (rad or m/s, body axes) in the first three entries.
    """
    for axis in range(3):
        clear(H[first_row + axis])
        z[first_row + axis] = measurement[axis]


_EVIDENCE = Evidence(
    "Difference of two inertial units",
    checks=(
        Check(
            "closed form",
            "what is left of the fused bias, s1 s2 / sqrt(s1² + s2²), to 1e-4",
            "tests/sensors/test_imu_difference.py"
            "::test_a_difference_of_two_units_tells_which_is_the_better_one_whatever_their_weights",
        ),
        Check(
            "both engines",
            "64 runs, skewed axes and lever arms included",
            "tests/sensors/test_imu_difference.py::test_both_engines_agree_on_a_difference",
        ),
    ),
    omits="Bending of the structure between the units.",
)
SENSORS = (
    Registration(AngleDifferenceCard, _EVIDENCE, fill=fill, measure=None, order=5),
    Registration(VelocityDifferenceCard, _EVIDENCE, fill=fill, measure=None, order=6),
)
