"""Attitude reference: the rotation from the estimated attitude to the measured one, axis by axis, frame i.

z - z_hat = att + v: a row has one entry, a one in the column of its axis, so there is nothing to fill.
"""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from lvnav_trade.kernels.attitude import from_rotation, multiply, small_rotation
from lvnav_trade.kernels.jit import jit
from lvnav_trade.observables.sensor import SensorCard, SensorModel
from lvnav_trade.units import AngleSigma


class AttitudeModel(SensorModel):
    """Attitude reference as the filter models it: white noise per axis."""

    sigma: AngleSigma = Field(gt=0.0)


class AttitudeReferenceCard(SensorCard):
    """A magnetometer, horizon or star sensor by its performance: true attitude plus white noise on each axis."""

    measurement: ClassVar[str] = "attitude"
    model: ClassVar[type[SensorModel]] = AttitudeModel

    kind: Literal["attitude_reference"] = "attitude_reference"
    sigma: AngleSigma = Field(gt=0.0, description="of a measurement, per axis")

    def matched(self) -> AttitudeModel:
        """Return the filter model that takes every number from this card."""
        return AttitudeModel.model_construct(sigma=self.sigma)


@jit
def observe(q0, q1, q2, q3, sigma, n0, n1, n2):
    """Return the measured attitude (quaternion, body to inertial): the true one turned by noise of one-sigma `sigma`
    on each axis of frame i.
    """
    e0, e1, e2, e3 = from_rotation(sigma * n0, sigma * n1, sigma * n2)
    return multiply(e0, e1, e2, e3, q0, q1, q2, q3)


@jit
def innovation(m0, m1, m2, m3, q0, q1, q2, q3):
    """Return the small rotation (rad, frame i) from the estimated attitude q to the measured one m."""
    return small_rotation(m0, m1, m2, m3, q0, q1, q2, q3)
