"""Base classes of the sensors: card, filter model, correlated errors, evidence, registration."""

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from lvnav_trade.quantities.conditions import Conditions
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.shared_cards import Resources
from lvnav_trade.quantities.units import Card, Frequency, NamedCard, Pause
from lvnav_trade.sensors.jacobian_row import add


class CorrelatedError(NamedTuple):
    """Random errors with a common cause, correlated over time or between measurements.

    The errors of different labels are independent. Each is a constant, a Gauss-Markov process, or a new draw at every
    epoch.

    source : Physical cause.
    error_type : Kind of the error, as in `receiver_observables.members`; source, error type and label together address
        the random draws.
    sigma : SI. Standard deviation.
    field : Field of the sensor's card for sigma, and of the filter model for the assumed sigma.
    time_constant : s. Infinite for a constant, 0 for an error that is new at every epoch.
    labels : Label of each error: a satellite, a system, an axis; empty for a single error.
    partial : Function of the flight that returns the derivative (n_epoch, n_scalar, n_label) of a sensor's scalars by
        the errors; None: a single error, added to all scalars. Measurements of satellites use
        `receiver_observables.partial`.
    state : Extra state of the filter that models it; empty: none.
    """

    source: str
    error_type: str
    sigma: float
    field: str
    time_constant: float
    labels: tuple[str, ...] = ("",)
    partial: Callable[[Any], Floats] | None = None
    state: str = ""

    def partials(self, flight: Any, n_scalar: int) -> Floats:
        """Return the derivative (n_epoch, n_scalar, n_label) of a sensor's scalars by the errors along a flight."""
        shape = (flight.t.size, n_scalar, len(self.labels))
        return np.ones(shape) if self.partial is None else np.broadcast_to(self.partial(flight), shape)


class Check(NamedTuple):
    """A test that compares a model with an independent result.

    by : Kind of comparison, one of those in `report/templates/models.toml`.
    shown : Verified property and accuracy.
    test : Id of the test.
    """

    by: str
    shown: str
    test: str


class Evidence(NamedTuple):
    """Evidence for a model as printed in the report.

    name : Name of the model.
    checks : Tests that verify it.
    omits : Omitted effects.
    """

    name: str
    checks: tuple[Check, ...]
    omits: str


N_TRUTH = 4
"""Number of entries of a sensor's true values at an epoch."""
N_FILTER_PARAMETER = 16
"""Number of entries of the filter parameters of a sensor at an epoch."""


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
    is_at_rest : (n,). Whether the vehicle is still at rest on the Earth.
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
    is_at_rest: Bools = np.empty(0, dtype=np.bool_)


def each_scalar(n_scalar: int, *scalars: int) -> Callable[[FlightView], Floats]:
    """Return a function for the partials (1, n_scalar, n) of n errors that each affect a single scalar.

    scalars : Indices of these scalars; without any, all scalars.
    """
    selection_matrix = np.eye(n_scalar)[:, list(scalars) if scalars else slice(None)]
    return lambda _: selection_matrix[None]


class StateUnit(NamedTuple):
    """Name and units of an extra state for a lasting error.

    name : Name of the state.
    unit : SI unit.
    label_unit : Display unit.
    label_factor : Factor from SI to the display unit.
    """

    name: str
    unit: str
    label_unit: str
    label_factor: float


class SensorModel(Card):
    """A sensor as the filter models it: noise, latency, and extra states for lasting errors.

    latency : s. Latency that a filter with `delay_compensation` compensates.
    states : Extra states for lasting errors, by the name of the field with their sigma, here and in the sensor's card.
        The field of that name with `_time` is the time constant; without it (or None) the error is constant.
    noise_field : Name of the field with the standard deviation of the noise, if that is constant.
    """

    states: ClassVar[Mapping[str, StateUnit]] = {}
    noise_field: ClassVar[str] = "sigma"

    latency: Pause = Field(0.0, description="latency that delay_compensation assumes")

    def time_constant(self, field: str) -> float:
        """Return the time constant (s) that the filter assumes for the lasting error of a field; inf: constant."""
        return float(getattr(self, f"{field}_time", None) or math.inf)

    def variance(self, flight: FlightView) -> Floats:
        """Return the assumed noise variance (n_epoch, n_scalar), SI; a dimension of 1 means that it is constant."""
        return np.array([[getattr(self, self.noise_field) ** 2]])

    def filter_parameters(self, flight: FlightView) -> Floats:
        """Return the parameters of the sensor that the filter knows, (n_epoch, at most N_FILTER_PARAMETER).

        Its kernels use them: a mounting, the position of a station, a map along the flight.
        """
        return np.zeros((flight.t.size, 0))


class SensorCard(Conditions, NamedCard):
    """A sensor other than the IMU and the receiver. It measures at its rate while its conditions are true.

    Subclasses set the class attributes below and the literal `kind`, and their module registers them.

    measurement : Name of the measurement in a filter card.
    model : Class of the filter model.
    labels : Labels of the scalars.
    unit : Unit of the scalars.
    jacobian : Quantities that the Jacobian depends on: position, velocity, attitude.
    noise : Name of the noise as an error source.
    noise_fields : Fields with the standard deviations of the noise.
    is_on_pad : Whether it measures on the pad only.
    has_no_latency : Whether the measurement is formed in the navigation computer and has no latency.
    availability_phrase : Phrase in messages for "it is available".
    """

    measurement: ClassVar[str]
    model: ClassVar[type[SensorModel]]
    labels: ClassVar[tuple[str, ...]] = ("",)
    unit: ClassVar[str]
    jacobian: ClassVar[tuple[str, ...]]
    noise: ClassVar[str]
    noise_fields: ClassVar[tuple[str, ...]] = ("sigma",)
    is_on_pad: ClassVar[bool] = False
    has_no_latency: ClassVar[bool] = False
    availability_phrase: ClassVar[str] = "it can measure"

    rate: Frequency | None = Field(None, description="rate of the measurements; none: at every update of the filter")
    latency: Pause = Field(0.0, description="time between the validity of a measurement and its arrival at the filter")
    resources: Resources | None = Field(None, description="cost, mass, power, volume, reliability")

    def matched_model(self) -> SensorModel:
        """Return the filter model with all numbers of this card."""
        return self.model.model_construct(**{name: getattr(self, name) for name in self.model.model_fields})

    @abstractmethod
    def truth(self, flight: FlightView) -> Floats:
        """Return the error-free measurement, (n_epoch, at most N_TRUTH), as the kernels of the sensor use it."""

    def noise_sigma(self, flight: FlightView) -> Floats:
        """Return the true standard deviation (n_epoch, n_scalar) of the white noise, SI; a dimension of 1 means that it
        is constant.
        """
        return np.array([[getattr(self, self.noise_fields[0]) if self.noise_fields else 0.0]])

    @property
    def scalars(self) -> tuple[str, ...]:
        """Labels of the scalars that this sensor measures: all of its class, unless the card selects some."""
        return self.labels

    def assumed_variance(self, model: SensorModel, flight: FlightView) -> Floats:
        """Return the noise variance that a filter with this model assumes, as `SensorModel.variance`."""
        return model.variance(flight)

    def filter_parameters(self, model: SensorModel, flight: FlightView) -> Floats:
        """Return the parameters that a filter with this model knows, (n_epoch, at most N_FILTER_PARAMETER)."""
        return model.filter_parameters(flight)

    def is_available(self, flight: FlightView) -> Bools:
        """Return whether it can measure at the epochs, (n_epoch,) bool, apart from its rate and its conditions."""
        return np.ones(flight.t.size, dtype=np.bool_)

    @property
    def limiting_field(self) -> str:
        """Field to change if the sensor never measures; empty if there is none."""
        return self.condition_keys[0] if self.condition_keys else ""

    def correlated_errors(self) -> tuple[CorrelatedError, ...]:
        """Return its errors that are correlated over time or between scalars."""
        return ()

    def refusal(self, epoch: str) -> str:
        """Return why it cannot be simulated on a flight with lift-off at an epoch (UTC, ISO 8601); empty if it can."""
        return ""


class Registration(NamedTuple):
    """Registration of a sensor, in the tuple `SENSORS` of its module in this folder.

    card : Class of the card; its `model` is the filter model.
    evidence : Tests that verify the sensor, and its omissions; sensors with common evidence are one row of the report.
    fill : Kernel that sets Jacobian rows and innovations; its arguments are a selection of those of `family.fill`.
    measure : Kernel that sets the measured values, with arguments of `family.measure`; None: the engines set them.
    order : Rank among the sensors and of the measurement in a filter card, fixed for compatibility. Sensors without it
        come last, by name.
    """

    card: type[SensorCard]
    evidence: Evidence
    fill: Any
    measure: Any = add
    order: int = 1_000
