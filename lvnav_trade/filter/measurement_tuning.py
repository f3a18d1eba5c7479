"""Cards for filter tuning by flight region: under-weighting of measurements, process noise."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from lvnav_trade.quantities.conditions import Conditions
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.shared_cards import OverFlight
from lvnav_trade.quantities.units import (
    AccelerationSigma,
    AngleRandomWalk,
    AngleSigma,
    AngularRateSigma,
    Card,
    Fraction,
    GSensitivity,
    LengthSigma,
    PositionRandomWalk,
    SpeedSigma,
    TimeConstant,
    VelocityRandomWalk,
)
from lvnav_trade.sensors.family import MEASUREMENTS

if TYPE_CHECKING:
    Weighted = str
else:
    Weighted = Literal[tuple(name for name in MEASUREMENTS if name != "imu")]


PositiveAngle = Annotated[AngleSigma, Field(gt=0.0)]
PositiveSpeed = Annotated[SpeedSigma, Field(gt=0.0)]
PositiveLength = Annotated[LengthSigma, Field(gt=0.0)]


class UnderweightingCard(Conditions):
    """Reduced weight of measurements while conditions are true.

    The filter uses beta h P h' + factor R in place of R: Lear's under-weighting (Zanetti, DeMars and Bishop 2010, by
    scalar) and a larger noise. Where several cards apply, betas add and factors multiply.
    """

    beta: float = Field(
        0.0, ge=0.0, description="fraction of h P h', the variance of the innovation due to the state, that is added"
    )
    noise_factor: float = Field(1.0, gt=0.0, description="factor on the assumed noise variance")
    measurements: tuple[Weighted, ...] = Field(
        (), description="measurements to which it applies; none: all measurements of the filter"
    )

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.beta == 0.0 and self.noise_factor == 1.0:
            yield "beta: is 0 and noise_factor 1, which changes nothing"


class RegionNoiseCard(Conditions):
    """Process noise at a change of operating region: sigmas added to the states at that time.

    With a threshold noise is added, while the conditions are true, whenever the specific force or rate of the nominal
    flight has changed by the threshold since the last addition. Without a threshold it is added when the conditions
    become true and when they cease to be true.
    """

    force_change: Annotated[AccelerationSigma, Field(gt=0.0)] | None = Field(
        None, description="change of the specific force vector in body axes that starts a new region"
    )
    rate_change: Annotated[AngularRateSigma, Field(gt=0.0)] | None = None  # the same of the body rate
    attitude: AngleSigma = 0.0  # added one-sigma per axis
    velocity: SpeedSigma = 0.0  # added one-sigma per axis
    position: LengthSigma = 0.0  # added one-sigma per axis
    gyro_bias: AngularRateSigma = 0.0  # added one-sigma per axis
    accel_bias: AccelerationSigma = 0.0  # added one-sigma per axis
    gyro_scale_factor: Fraction = 0.0  # added one-sigma per axis
    accel_scale_factor: Fraction = 0.0  # added one-sigma per axis
    gyro_nonlinearity: Fraction = Field(0.0, description="scale-factor error at full scale")
    accel_nonlinearity: Fraction = Field(0.0, description="scale-factor error at full scale")
    gyro_misalignment: AngleSigma = 0.0  # added one-sigma per axis
    accel_misalignment: AngleSigma = 0.0  # added one-sigma per axis
    gyro_g_sensitivity: GSensitivity = 0.0  # added one-sigma per axis
    clock_bias: LengthSigma = 0.0  # added one-sigma
    clock_drift: SpeedSigma = 0.0  # added one-sigma

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.force_change is None and self.rate_change is None and not self.condition_keys:
            yield "force_change: is missing, or rate_change, or a condition such as from or above"


DRIVEN = ("attitude", "velocity", "position")


class HInfinityCard(Card):
    """Errors that an H-infinity filter bounds for the worst noise, not only for the noise that is assumed.

    The covariance grows as if errors of the given sizes were lost within the time: dP/dt = P S P in addition to all
    other terms, with 1 / (time size^2) of each state in S. The larger the time, the nearer to the Kalman filter.
    """

    time: TimeConstant = Field(description="in which a variance of size^2 would grow beyond all bounds, unmeasured")
    attitude: PositiveAngle | None = None  # size per axis; none: not bounded
    velocity: PositiveSpeed | None = None  # size per axis; none: not bounded
    position: PositiveLength | None = None  # size per axis; none: not bounded

    @property
    def weights(self) -> Floats:
        """Diagonal of S (9,), 1 / (SI squared s): attitude, velocity, position by axis."""
        sizes = [getattr(self, name) for name in DRIVEN]
        weights = [0.0 if size is None else 1.0 / (self.time * size**2) for size in sizes]
        return np.repeat(np.array(weights), 3)

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if not self.weights.any():
            yield f"time: of no error; give one of {', '.join(DRIVEN)}"


class ProcessNoiseTable(OverFlight):
    """Process noise as a function of one quantity of the nominal flight, in addition to that of the filter card.

    Two entries that start at zero make the density proportional to the quantity. Variances of several tables add.
    """

    attitude: tuple[AngleRandomWalk, ...] = Field((), description="root PSD per axis at these values")
    velocity: tuple[VelocityRandomWalk, ...] = Field((), description="root PSD per axis at these values")
    position: tuple[PositionRandomWalk, ...] = Field((), description="root PSD per axis at these values")

    def _length_faults(self, values: tuple[float, ...]) -> Iterator[str]:
        if not any(any(getattr(self, name)) for name in DRIVEN):
            yield f"no noise: one of {', '.join(DRIVEN)} is above zero somewhere"
        for name in DRIVEN:
            count = len(getattr(self, name))
            if count not in (0, len(values)):
                yield f"{len(values)} values of {self.independent_quantity} but {count} of {name}"
