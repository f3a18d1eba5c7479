"""Magnetometer: the Earth's field in body axes, three scalars.

z = (1 + S) C_b_i' B(r) + b + v with soft iron S, hard iron b, noise v. The filter computes B at its estimated position
from a map along the flight, field and gradient by IGRF-14. Second-order terms of a 10 km position error are below 1 nT.
"""

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from lvnav_trade.kernels.attitude import cross, matrix
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import Q, R
from lvnav_trade.quantities.frames import ecef_from_eci, eci_from_ecef, matrices, rotation_i_e
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import FluxDensitySigma, Fraction
from lvnav_trade.sensors import geomagnetism
from lvnav_trade.sensors.jacobian_row import H_ATT, H_POS, clear
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

_NANOTESLA = 1e9
_AXES = ("x", "y", "z")
SOFT = tuple(f"{row}{column}" for row in _AXES for column in _AXES)
"""Entries of the soft-iron matrix: the axis that measures, the axis of the field."""
# Indices of the map: field (3), gradient (3 x 3, by rows), position (3).
FIELD, GRADIENT, PLACE = 0, 3, 12


class MagnetometerModel(SensorModel):
    """Magnetometer as the filter models it: white noise, IGRF-14 up to a degree, hard and soft iron as states."""

    states: ClassVar[Mapping[str, StateUnit]] = {
        "hard_iron": StateUnit("hard_iron", "T", "nT", _NANOTESLA),
        "soft_iron": StateUnit("soft_iron", "1", "%", 1e2),
    }

    sigma: FluxDensitySigma = Field(gt=0.0)
    hard_iron: FluxDensitySigma = Field(0.0, description="of the extra state hard_iron: its initial one-sigma")
    soft_iron: Fraction = Field(0.0, description="of the extra state soft_iron: its initial one-sigma")
    degree: Annotated[int, Field(ge=1, le=geomagnetism.DEGREE)] = Field(
        geomagnetism.DEGREE, description="degree of the field model that the filter uses"
    )

    def filter_parameters(self, flight: FlightView) -> Floats:
        """Return the map along the flight (n_epoch, 15), frame i: field (T), gradient (T/m), position (m)."""
        year = geomagnetism.decimal_year(flight.epoch)
        r_e = ecef_from_eci(flight.r_i, flight.theta)
        field_e = geomagnetism.field(r_e, year, self.degree)
        gradient_e = geomagnetism.gradient(r_e, year, self.degree)
        C_i_e = rotation_i_e(flight.theta)
        C_e_i = np.swapaxes(C_i_e, 1, 2)
        field = eci_from_ecef(field_e, flight.theta)
        gradient = C_e_i @ gradient_e @ C_i_e
        return np.hstack([field, gradient.reshape(-1, 9), flight.r_i])


class MagnetometerCard(SensorCard):
    """A three-axis magnetometer: the Earth's field in body axes, with hard and soft iron of the vehicle."""

    measurement: ClassVar[str] = "magnetic_field"
    model: ClassVar[type[SensorModel]] = MagnetometerModel
    labels: ClassVar[tuple[str, ...]] = _AXES
    unit: ClassVar[str] = "T"
    jacobian: ClassVar[tuple[str, ...]] = ("position", "attitude")
    noise: ClassVar[str] = "magnetometer noise"

    kind: Literal["magnetometer"] = "magnetometer"
    sigma: FluxDensitySigma = Field(gt=0.0, description="white noise of a measurement, per axis")
    hard_iron: FluxDensitySigma = Field(
        0.0, description="constant field of the vehicle and sensor offset in body axes, per axis"
    )
    soft_iron: Fraction = Field(
        0.0, description="one-sigma of each entry of the distortion matrix: scale, coupling, misalignment"
    )

    def matched_model(self) -> SensorModel:
        """Return the filter model with all numbers of this card and the full degree of the field."""
        numbers = {name: getattr(self, name) for name in self.model.model_fields if name != "degree"}
        return self.model.model_construct(**numbers)

    def truth(self, flight: FlightView) -> Floats:
        """Return the field (n_epoch, 3) in T, body axes."""
        r_e = ecef_from_eci(flight.r_i, flight.theta)
        field_e = geomagnetism.field(r_e, geomagnetism.decimal_year(flight.epoch))
        field = eci_from_ecef(field_e, flight.theta)
        return np.asarray(np.einsum("nij,ni->nj", matrices(flight.q_b_i), field))

    def correlated_errors(self) -> tuple[CorrelatedError, ...]:
        """Return hard iron by axis, and soft iron by matrix entry, proportional to the field of the entry's axis."""
        hard_iron = CorrelatedError(
            "hard iron",
            "hard iron",
            self.hard_iron,
            "hard_iron",
            math.inf,
            _AXES,
            each_scalar(3),
        )
        soft_iron = CorrelatedError(
            "soft iron",
            "soft iron",
            self.soft_iron,
            "soft_iron",
            math.inf,
            SOFT,
            self._soft_iron_partials,
        )
        return hard_iron, soft_iron

    def refusal(self, epoch: str) -> str:
        """Return why it cannot be simulated: IGRF-14 does not cover every year."""
        first, last = geomagnetism.model_years()
        is_covered = first <= geomagnetism.decimal_year(epoch) <= last
        return "" if is_covered else f"a flight of {epoch} has no field: IGRF-14 covers {first:.0f} to {last:.0f}"

    def _soft_iron_partials(self, flight: FlightView) -> Floats:
        """Return the derivative (n_epoch, 3, 9) of the scalars with respect to the entries of the matrix."""
        field = self.truth(flight)
        derivative = np.zeros((flight.t.size, 3, 9))
        for axis in range(3):
            derivative[:, axis, 3 * axis : 3 * axis + 3] = field
        return derivative


@jit
def fill(H, z, first_row, measurement, nav, parameters):
    """Set the Jacobian rows of a magnetic field and its innovations.

    Parameters
    ----------
    H : (n, n_entry)
        Jacobian rows of the epoch; three from `first_row` on are set.
    z : (n,)
        Innovations; three from `first_row` on are set (T, body axes).
    first_row : int
        Index of the first scalar measurement.
    measurement : (4,)
        Measured field (T, body axes) in the first three entries.
    nav : (10,)
        Navigation state, frame i.
    parameters : (15,)
        Map at the epoch, frame i: field (T), gradient (T/m, by rows), position (m).
    """
    # field at the estimated position, to first order about the position of the map
    x = nav[R] - parameters[PLACE]
    y = nav[R + 1] - parameters[PLACE + 1]
    w = nav[R + 2] - parameters[PLACE + 2]
    g = GRADIENT
    field_x = parameters[FIELD] + parameters[g] * x + parameters[g + 1] * y + parameters[g + 2] * w
    field_y = parameters[FIELD + 1] + parameters[g + 3] * x + parameters[g + 4] * y + parameters[g + 5] * w
    field_z = parameters[FIELD + 2] + parameters[g + 6] * x + parameters[g + 7] * y + parameters[g + 8] * w
    c = matrix(nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    for axis in range(3):
        # body axis in frame i, a column of C_b_i
        cx = c[axis]
        cy = c[3 + axis]
        cz = c[6 + axis]
        predicted_field = cx * field_x + cy * field_y + cz * field_z
        z[first_row + axis] = measurement[axis] - predicted_field
        h = H[first_row + axis]
        clear(h)
        h[H_ATT], h[H_ATT + 1], h[H_ATT + 2] = cross(cx, cy, cz, field_x, field_y, field_z)
        for i in range(3):
            gradient_x = parameters[g + i]
            gradient_y = parameters[g + 3 + i]
            gradient_z = parameters[g + 6 + i]
            h[H_POS + i] = cx * gradient_x + cy * gradient_y + cz * gradient_z


SENSORS = (
    Registration(
        MagnetometerCard,
        Evidence(
            "Magnetometer (IGRF-14)",
            checks=(
                Check(
                    "published value",
                    "field of IGRF-14 to 2.5 nT",
                    "tests/sensors/test_geomagnetism.py::test_it_is_the_field_that_is_published",
                ),
                Check(
                    "independent implementation",
                    "another program's field to 0.3 nT",
                    "tests/sensors/test_geomagnetism.py::test_it_is_the_field_that_another_program_computes",
                ),
                Check(
                    "closed form",
                    "information across the field and none about it, to 2e-4",
                    "tests/both_engines/test_magnetic.py::test_attitude_is_known_across_the_field_and_not_about_it",
                ),
                Check(
                    "both engines",
                    "hard and soft iron neglected and estimated",
                    "tests/both_engines/test_magnetic.py::test_both_engines_agree_on_what_iron_does",
                ),
            ),
            omits="Crustal field (up to some hundred nT), storms and currents of the ionosphere, fields of "
            "currents on board that vary.",
        ),
        fill=fill,
        order=8,
    ),
)
