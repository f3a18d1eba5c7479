"""Base classes of the sensors: what every sensor card and every filter model of a sensor has."""

from abc import abstractmethod
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from lvnav_trade.records import Bools, Floats
from lvnav_trade.units import Card, Frequency
from lvnav_trade.world.conditions import Conditions

N_TRUTH = 4
"""Numbers of a sensor's truth at an epoch."""


class FlightView(NamedTuple):
    """The true flight at the epochs, for sensors: t (n,) s; r_i, v_i (n, 3), q_b_i (n, 4) frame i; height (n,) m over
    the ellipsoid; theta (n,) rad angle of the Earth; r_rest (n, 3), q_rest (n, 4) place and attitude without the
    oscillations; standing (n,) whether the vehicle has not yet left the place on the Earth where it stands.
    """

    t: Floats
    r_i: Floats
    v_i: Floats
    q_b_i: Floats
    height: Floats
    theta: Floats
    r_rest: Floats = np.empty((0, 3))
    q_rest: Floats = np.empty((0, 4))
    standing: Bools = np.empty(0, dtype=np.bool_)


class LastingError(NamedTuple):
    """A random error of a sensor that lasts, added to all its scalars: source and kind (they address its draws), sigma
    and the field of the card that holds it, time constant in s (inf: constant).
    """

    source: str
    kind: str
    sigma: float
    field: str
    time_constant: float


class SensorModel(Card):
    """A sensor as the filter models it: one-sigma noise of a measurement and whatever its variance depends on."""

    @abstractmethod
    def variance(self, flight: FlightView) -> Floats:
        """Return the variance (n_epoch, n_scalar) that the filter assumes of the noise, SI."""


class SensorCard(Conditions):
    """A sensor beside the IMU and the receiver: true errors, and when it measures: at its rate, while conditions hold.

    A member of the family states `kind` (a literal of one word), `measurement` (the name that a filter lists), `model`
    (the class of its filter model), `labels` of its scalars and their `unit`, what their Jacobian depends on
    (`jacobian`: position, velocity, attitude), and the name of its noise as an error source; it is added to `SENSORS`.
    """

    measurement: ClassVar[str]
    model: ClassVar[type[SensorModel]]
    labels: ClassVar[tuple[str, ...]] = ("",)
    unit: ClassVar[str]
    jacobian: ClassVar[tuple[str, ...]]
    noise: ClassVar[str]
    noise_fields: ClassVar[tuple[str, ...]] = ("sigma",)
    on_pad: ClassVar[bool] = False

    name: str
    source: str
    rate: Frequency | None = Field(None, description="of its measurements; none: at every update of the filter")

    def matched(self) -> SensorModel:
        """Return the filter model that takes every number from this card."""
        return self.model.model_construct(**{name: getattr(self, name) for name in self.model.model_fields})

    @abstractmethod
    def truth(self, flight: FlightView) -> Floats:
        """Return what the sensor would measure without error, (n_epoch, at most 4), as its kernels read it."""

    @abstractmethod
    def noise_sigma(self, flight: FlightView) -> Floats:
        """Return the true one-sigma of the white noise, (n_epoch, n_scalar), SI."""

    def available(self, flight: FlightView) -> Bools:
        """Return whether it can measure at the epochs, (n_epoch,), beside its rate and its conditions."""
        return np.ones(flight.t.size, dtype=np.bool_)

    def lasting(self) -> tuple[LastingError, ...]:
        """Return its errors that last."""
        return ()
