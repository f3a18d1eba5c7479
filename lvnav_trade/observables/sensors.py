"""The family of sensors: a line in `SENSORS` and one in each dispatch of the kernels adds a member."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import Field, create_model

from lvnav_trade.kernels.jit import inlined
from lvnav_trade.observables import altitude, attitude, ground, imu_difference, magnetic, stellar
from lvnav_trade.observables.altitude import AltimeterCard
from lvnav_trade.observables.attitude import AttitudeReferenceCard
from lvnav_trade.observables.base import add
from lvnav_trade.observables.ground import StationCard
from lvnav_trade.observables.imu_difference import AngleDifferenceCard, VelocityDifferenceCard
from lvnav_trade.observables.magnetic import MagnetometerCard
from lvnav_trade.observables.pad import azimuth, position, rotation, velocity
from lvnav_trade.observables.pad.azimuth import AzimuthCard
from lvnav_trade.observables.pad.position import PadPositionCard
from lvnav_trade.observables.pad.rotation import ZeroRotationCard
from lvnav_trade.observables.pad.velocity import ZeroVelocityCard
from lvnav_trade.observables.partials import FURTHER
from lvnav_trade.observables.pressure import BarometerCard
from lvnav_trade.observables.sensor import SensorCard
from lvnav_trade.observables.stellar import StarTrackerCard
from lvnav_trade.units import Card

SENSORS: tuple[type[SensorCard], ...] = (
    AltimeterCard,
    AttitudeReferenceCard,
    ZeroVelocityCard,
    PadPositionCard,
    AzimuthCard,
    AngleDifferenceCard,
    VelocityDifferenceCard,
    StarTrackerCard,
    MagnetometerCard,
    BarometerCard,
    StationCard,
    ZeroRotationCard,
)
"""The number of a member in the kernels is its place here."""
ALTIMETER, ATTITUDE_REFERENCE, ZERO_VELOCITY, PAD_POSITION, AZIMUTH, ANGLE_DIFFERENCE, VELOCITY_DIFFERENCE = range(7)
STAR_TRACKER, MAGNETOMETER, BAROMETER, GROUND_STATION, ZERO_ROTATION = range(7, len(SENSORS))

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
def measure(out, code, truth, e0, e1, e2):
    """Set what a sensor measures.

    out : (4,) set; code : the member's number; truth : (4,) at the epoch; e0, e1, e2 : errors of its scalars, SI
    """
    if code in (ATTITUDE_REFERENCE, ZERO_ROTATION):
        attitude.measure(out, truth, e0, e1, e2)
    elif code == STAR_TRACKER:
        stellar.measure(out, truth, e0, e1, e2)
    elif code == AZIMUTH:
        azimuth.measure(out, truth, e0)
    elif code not in (ANGLE_DIFFERENCE, VELOCITY_DIFFERENCE):  # those are summed with the samples of the units
        add(out, truth, e0, e1, e2)


@inlined
def fill(H, z, at, code, observed, nav, theta, known):
    """Set the Jacobian rows of a sensor, from row `at` on, and measured minus predicted.

    H : (n, n_entry), z : (n,) updated; observed : (4,) of `measure`; nav : (10,) navigation state, frame i;
    theta : rad, angle of the Earth at the epoch; known : (N_KNOWN,) what the filter knows of the sensor there
    """
    if code in (ALTIMETER, BAROMETER):
        z[at] = observed[0] - altitude.row(H[at], nav)
    elif code == ATTITUDE_REFERENCE:
        attitude.fill(H, z, at, observed, nav)
    elif code == ZERO_VELOCITY:
        velocity.fill(H, z, at, observed, nav, theta)
    elif code == PAD_POSITION:
        position.fill(H, z, at, observed, nav, theta)
    elif code == AZIMUTH:
        azimuth.fill(H, z, at, observed, nav)
    elif code in (ANGLE_DIFFERENCE, VELOCITY_DIFFERENCE):
        imu_difference.fill(H, z, at, observed)
    elif code == STAR_TRACKER:
        stellar.fill(H, z, at, observed, nav, known)
    elif code == MAGNETOMETER:
        magnetic.fill(H, z, at, observed, nav, known)
    elif code == GROUND_STATION:
        ground.fill(H, z, at, observed, nav, known)
    elif code == ZERO_ROTATION:
        rotation.fill(H, z, at, observed, nav, theta)
