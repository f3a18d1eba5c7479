"""Base classes of the sensors: what every card, every filter model and every registration of a sensor has."""

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from lvnav_trade.observables.base import add
from lvnav_trade.observables.correlated import CorrelatedError
from lvnav_trade.observables.evidence import Evidence
from lvnav_trade.records import Bools, Floats
from lvnav_trade.resources import Resources
from lvnav_trade.units import Card, Frequency, NamedCard, Pause
from lvnav_trade.world.conditions import Conditions

N_TRUTH = 4
"""Numbers of a sensor's truth at an epoch."""
N_KNOWN = 16
"""Numbers of what a filter knows of a sensor at an epoch."""


class FlightView(NamedTuple):
    """True flight at the times at which a sensor measures: the epochs, or earlier by its latency.

    t : (n,) s since lift-off.
    r_i : (n, 3) m. Position, frame i.
    v_i : (n, 3) m/s. Inertial velocity, frame i.
    q_b_i : (n, 4). Attitude quaternion, body to frame i, scalar first.
    height : (n,) m. Height above the ellipsoid.
    theta : (n,) rad. Earth rotation angle.
    w_ib_b : (n, 3) rad/s. Body rate, body axes.
    epoch : UTC of lift-off, ISO 8601.
    r_rest : (n, 3) m. Position without the oscillations, frame i.
    q_rest : (n, 4). Attitude without the oscillations.
    standing : (n,). Whether the vehicle is still at rest on the Earth.
    """

    t: Floats
    r_i: Floats
    v_i: Floats
    q_b_i: Floats
    height: Floats
    theta: Floats
    w_ib_b: Floats
    epoch: str
    r_rest: Floats = np.empty((0, 3))
    q_rest: Floats = np.empty((0, 4))
    standing: Bools = np.empty(0, dtype=np.bool_)


def each_scalar(n_scalar: int, *own: int) -> Callable[[FlightView], Floats]:
    """Return partials (1, n_scalar, n) of errors that each act on one scalar: the n scalars `own`, all of them if none
    is named.
    """
    picked = np.eye(n_scalar)[:, list(own) if own else slice(None)]
    return lambda _: picked[None]


class StateUnit(NamedTuple):
    """An extra state of a filter for a lasting error: its name, SI unit, unit and factor for people."""

    name: str
    unit: str
    label_unit: str
    label_factor: float


class SensorModel(Card):
    """A sensor as the filter models it: one-sigma noise of a measurement and whatever its variance depends on.

    latency: what a filter with `delay_compensation` compensates. states: extra states that stand for lasting errors, by
    the field that holds their sigma here and in the card; a field of that name and `_time` holds the time constant,
    without it (or None) they are constant. noise_field: the one that holds the one-sigma of a constant noise.
    """

    states: ClassVar[Mapping[str, StateUnit]] = {}
    noise_field: ClassVar[str] = "sigma"

    latency: Pause = Field(0.0, description="as delay_compensation takes it")

    def time_constant(self, field: str) -> float:
        """Return the time constant (s) that the filter assumes of a lasting error; inf: constant."""
        return float(getattr(self, f"{field}_time", None) or math.inf)

    def variance(self, flight: FlightView) -> Floats:
        """Return the variance (n_epoch, n_scalar) that the filter assumes of the noise, SI; 1 in place of a number: the
        same at all epochs, of all scalars.
        """
        return np.array([[getattr(self, self.noise_field) ** 2]])

    def known(self, flight: FlightView) -> Floats:
        """Return what the filter knows of the sensor, (n_epoch, at most N_KNOWN), as its kernels read it: a mounting,
        the place of a station, a map along the flight.
        """
        return np.zeros((flight.t.size, 0))


class SensorCard(Conditions, NamedCard):
    """A sensor beside the IMU and the receiver: true errors, and when it measures: at its rate, while conditions hold.

    A member of the family states `kind` (a literal of one word), `measurement` (the name that a filter lists), `model`
    (the class of its filter model), `labels` of its scalars and their `unit`, what their Jacobian depends on
    (`jacobian`: position, velocity, attitude), and the name of its noise as an error source; its module registers it.
    What is `at_once` is known to the computer or formed in it, and has no latency. `able` says in messages when it is
    available.
    """

    measurement: ClassVar[str]
    model: ClassVar[type[SensorModel]]
    labels: ClassVar[tuple[str, ...]] = ("",)
    unit: ClassVar[str]
    jacobian: ClassVar[tuple[str, ...]]
    noise: ClassVar[str]
    noise_fields: ClassVar[tuple[str, ...]] = ("sigma",)
    on_pad: ClassVar[bool] = False
    at_once: ClassVar[bool] = False
    able: ClassVar[str] = "it can measure"

    rate: Frequency | None = Field(None, description="of its measurements; none: at every update of the filter")
    latency: Pause = Field(0.0, description="from the time that a measurement is of to its arrival at the filter")
    resources: Resources | None = Field(None, description="cost, mass, power, volume, reliability")

    def matched(self) -> SensorModel:
        """Return the filter model that takes every number from this card."""
        return self.model.model_construct(**{name: getattr(self, name) for name in self.model.model_fields})

    @abstractmethod
    def truth(self, flight: FlightView) -> Floats:
        """Return what the sensor would measure without error, (n_epoch, at most 4), as its kernels read it."""

    def noise_sigma(self, flight: FlightView) -> Floats:
        """Return the true one-sigma of the white noise, (n_epoch, n_scalar), SI; 1 in place of a number: the same at
        all epochs, of all scalars.
        """
        return np.array([[getattr(self, self.noise_fields[0]) if self.noise_fields else 0.0]])

    @property
    def scalars(self) -> tuple[str, ...]:
        """Labels of the scalars that this sensor measures: all of the family's, unless the card picks some."""
        return self.labels

    def assumed_variance(self, model: SensorModel, flight: FlightView) -> Floats:
        """Return the variance that a filter assumes of the noise of what it measures, as `SensorModel.variance`."""
        return model.variance(flight)

    def known(self, model: SensorModel, flight: FlightView) -> Floats:
        """Return what a filter knows of it, (n_epoch, at most N_KNOWN): of its model, and of where it stands."""
        return model.known(flight)

    def available(self, flight: FlightView) -> Bools:
        """Return whether it can measure at the epochs, (n_epoch,), beside its rate and its conditions."""
        return np.ones(flight.t.size, dtype=np.bool_)

    @property
    def limiting(self) -> str:
        """The field that keeps it from measuring where it never can, empty where it has none."""
        return self.stated[0] if self.stated else ""

    def lasting(self) -> tuple[CorrelatedError, ...]:
        """Return its errors that last."""
        return ()

    def refusal(self, epoch: str) -> str:
        """Return why it cannot be simulated on a flight that lifts off at a time (UTC), empty if it can."""
        return ""


class Registration(NamedTuple):
    """A sensor as the family holds it; a module of `observables/sensors` states its own in `SENSORS`.

    card : Card of the sensor; its `model` is the filter's.
    evidence : Tests that check the sensor, and what it leaves out; two that share one are one model in the report.
    fill : Kernel that sets Jacobian rows and innovations; it names the arguments that it takes of those of `fill`
    there.
    measure : Kernel that sets what is measured, by the arguments of `measure` there; None: the engines do.
    order : Place among the sensors, and so of the measurement in a filter card: cards of earlier versions keep theirs.
    Those that state none come last, by name.
    """

    card: type[SensorCard]
    evidence: Evidence
    fill: Any
    measure: Any = add
    order: int = 1_000
