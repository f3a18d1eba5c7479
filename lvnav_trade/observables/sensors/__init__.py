"""The family of sensors: every module of this folder that registers one in `SENSORS` is a member.

A new sensor is a module here, a card in `configs/` and a test. Its number in the kernels is its place in `FAMILY`.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import Field, create_model

from lvnav_trade.kernels.choice import choosing
from lvnav_trade.kernels.jit import inlined
from lvnav_trade.observables.partials import FURTHER
from lvnav_trade.observables.sensor import Registration, SensorCard
from lvnav_trade.units import Card


def kind_of(card: type[SensorCard]) -> str:
    """Return the word by which a scenario names a kind of sensor."""
    return str(card.model_fields["kind"].default)


def _family() -> tuple[Registration, ...]:
    """Return what the modules of this folder register, in the order of their numbers."""
    names = [found.name for found in pkgutil.walk_packages(__path__, f"{__name__}.")]
    found = [one for name in names for one in getattr(importlib.import_module(name), "SENSORS", ())]
    return tuple(sorted(found, key=lambda one: (one.order, kind_of(one.card))))


FAMILY = _family()
SENSORS: tuple[type[SensorCard], ...] = tuple(member.card for member in FAMILY)

RECEIVER_SOLUTION = ("position", "velocity")
RANGES = ("pseudorange", "range_rate")
OBSERVABLES = (*RANGES, *FURTHER)
SENSOR_MEASUREMENTS = tuple(dict.fromkeys(card.measurement for card in SENSORS))
MEASUREMENTS = (*RECEIVER_SOLUTION, *OBSERVABLES, *SENSOR_MEASUREMENTS, "imu")
"""Names of measurements, in the order in which a filter card holds them."""

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


def model_of(models: SensorModels, sensor: SensorCard) -> Any:
    """Return the filter model of a sensor: that of the filter card, or the one that takes the sensor's own numbers."""
    stated = getattr(models, sensor.measurement)
    return sensor.matched() if isinstance(stated, str) else stated


@inlined
@choosing([member.measure for member in FAMILY])
def measure(out, code, truth, e0, e1, e2):
    """Set what a sensor measures.

    out : (4,) set; code : the member's number; truth : (4,) at the epoch; e0, e1, e2 : errors of its scalars, SI
    """


@inlined
@choosing([member.fill for member in FAMILY])
def fill(H, z, at, code, observed, nav, theta, known):
    """Set the Jacobian rows of a sensor, from row `at` on, and measured minus predicted.

    H : (n, n_entry), z : (n,) updated; observed : (4,) of `measure`; nav : (10,) navigation state, frame i;
    theta : rad, angle of the Earth at the epoch; known : (N_KNOWN,) what the filter knows of the sensor there
    """
