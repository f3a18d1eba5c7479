"""The family of sensors: all sensors that the modules of this folder register in `SENSORS`.

A new sensor is a module here, a card in `configs/` and a test. Its number in the kernels is its index in `FAMILY`.
"""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import Field, create_model

from lvnav_trade.kernels.choice import choose_kernel
from lvnav_trade.kernels.jit import inline_jit
from lvnav_trade.quantities.units import Card
from lvnav_trade.sensors.receiver_observables import FURTHER
from lvnav_trade.sensors.sensor import Registration, SensorCard


def card_kind(card: type[SensorCard]) -> str:
    """Return the kind of a sensor card, as a scenario names it."""
    return str(card.model_fields["kind"].default)


def _family() -> tuple[Registration, ...]:
    """Return the registrations of the modules of this folder, in the order of their numbers."""
    package = __name__.rpartition(".")[0]
    members: list[Registration] = []
    for module in pkgutil.walk_packages([str(Path(__file__).parent)], f"{package}."):
        if module.name != __name__:
            members += getattr(importlib.import_module(module.name), "SENSORS", ())
    return tuple(sorted(members, key=lambda member: (member.order, card_kind(member.card))))


FAMILY = _family()
SENSORS: tuple[type[SensorCard], ...] = tuple(member.card for member in FAMILY)

RECEIVER_SOLUTION = ("position", "velocity")
RANGES = ("pseudorange", "range_rate")
OBSERVABLES = (*RANGES, *FURTHER)
SENSOR_MEASUREMENTS = tuple(dict.fromkeys(card.measurement for card in SENSORS))
MEASUREMENTS = (*RECEIVER_SOLUTION, *OBSERVABLES, *SENSOR_MEASUREMENTS, "imu")
"""Names of all measurements, in the order of a filter card."""

SENSOR_STATES = {state.name: state for card in SENSORS for state in card.model.states.values()}
"""Extra states of a filter for lasting errors of sensors, by name."""

if TYPE_CHECKING:
    Sensor = SensorCard
    Measurement = str
    SensorModels = Card
else:
    Sensor = Annotated[Union[SENSORS], Field(discriminator="kind")]  # noqa: UP007
    Measurement = Literal[MEASUREMENTS]
    SensorModels = create_model(
        "SensorModels",
        __base__=Card,
        __doc__="Filter models of the sensors, by measurement; `matched` takes each number from the sensor's card.",
        **{
            name: (
                Literal["matched"] | Union[tuple(card.model for card in SENSORS if card.measurement == name)],  # noqa: UP007
                "matched",
            )
            for name in SENSOR_MEASUREMENTS
        },
    )


def sensor_filter_model(models: SensorModels, sensor: SensorCard) -> Any:
    """Return the filter model of a sensor: that of the filter card, or for `matched` the numbers of the sensor."""
    model_setting = getattr(models, sensor.measurement)
    return sensor.matched_model() if isinstance(model_setting, str) else model_setting


@inline_jit
@choose_kernel([member.measure for member in FAMILY])
def measure(out, code, truth, e0, e1, e2):
    """Set the measured values of a sensor.

    Parameters
    ----------
    out : (4,)
        Measured values, set here.
    code : int
        Index of the sensor in `FAMILY`.
    truth : (4,)
        Error-free values at the epoch, SI.
    e0, e1, e2 : float
        Errors of the scalars, SI.
    """


@inline_jit
@choose_kernel([member.fill for member in FAMILY])
def fill(H, z, first_row, code, measurement, nav, theta, parameters):
    """Set the Jacobian rows of a sensor, from index `first_row` on, and its innovations (measured minus predicted).

    Parameters
    ----------
    H : (n, n_entry)
        Jacobian, updated in place.
    z : (n,)
        Innovations, updated in place.
    first_row : int
        Index of the first scalar measurement.
    code : int
        Index of the sensor in `FAMILY`.
    measurement : (4,)
        Measured values, as from `measure`.
    nav : (10,)
        Navigation state, frame i.
    theta : float
        Earth angle at the epoch (rad).
    parameters : (N_FILTER_PARAMETER,)
        Parameters of the sensor that the filter knows, at the epoch.
    """
