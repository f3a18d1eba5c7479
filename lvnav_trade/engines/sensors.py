"""What the sensors beside the receiver measure on the nominal flight, and what the filter assumes of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.inputs import Sensors
from lvnav_trade.frames import geodetic_from_ecef
from lvnav_trade.kernels.random import source_word
from lvnav_trade.observables.family import ALTIMETER, ATTITUDE_REFERENCE, N_TRUTH
from lvnav_trade.observables.partials import Channels, SensorChannels
from lvnav_trade.records import Floats
from lvnav_trade.scenario import Scenario, altimeter_belief, reference_belief
from lvnav_trade.world.flight.trajectory import Trajectory, motion

ALTITUDE_NOISE, ATTITUDE_NOISE = "altimeter noise", "attitude reference noise"


class Sensor(NamedTuple):
    """A sensor at the epochs: code in the family; what it measures, a label for each of its scalars; noise, its source's
    name; on (n_epoch,); truth (n_epoch, 4); sigma and variance (n_epoch, n_scalar) of its noise, true and as the filter
    assumes.
    """

    code: int
    channels: SensorChannels
    noise: str
    on: NDArray[np.bool_]
    truth: Floats
    sigma: Floats
    variance: Floats


def sensors_of(scenario: Scenario, trajectory: Trajectory, t_epoch: Floats) -> tuple[Sensor, ...]:
    """Return the sensors that the filter of a scenario uses, at the epochs (s)."""
    measured = scenario.filter.measurements
    found = []
    if "altitude" in measured and scenario.altimeter is not None:
        found.append(_altimeter(scenario, trajectory, t_epoch))
    if "attitude" in measured and scenario.attitude_reference is not None:
        found.append(_attitude_reference(scenario, trajectory, t_epoch))
    return tuple(found)


def _truth(columns: Floats) -> Floats:
    """Return columns (n_epoch, n) as a truth (n_epoch, 4)."""
    return np.ascontiguousarray(np.pad(columns, ((0, 0), (0, N_TRUTH - columns.shape[1]))))


def _altimeter(scenario: Scenario, trajectory: Trajectory, t_epoch: Floats) -> Sensor:
    card = scenario.altimeter
    assert card is not None
    # heights are the same in frame i: it turns about the ellipsoid's axis
    true = geodetic_from_ecef(motion(trajectory, t_epoch).r_i)[2]
    sigma, share = altimeter_belief(scenario)
    return Sensor(
        ALTIMETER,
        SensorChannels("altitude", ("",)),
        ALTITUDE_NOISE,
        (true >= card.lowest) & (true <= card.highest),
        _truth(true[:, None]),
        np.hypot(card.sigma, card.share * true)[:, None],
        (sigma**2 + (share * true) ** 2)[:, None],
    )


def _attitude_reference(scenario: Scenario, trajectory: Trajectory, t_epoch: Floats) -> Sensor:
    card = scenario.attitude_reference
    assert card is not None
    shape = (t_epoch.size, 3)
    return Sensor(
        ATTITUDE_REFERENCE,
        SensorChannels("attitude", ("x", "y", "z")),
        ATTITUDE_NOISE,
        np.ones(t_epoch.size, dtype=np.bool_),
        np.ascontiguousarray(motion(trajectory, t_epoch).q_b_i),
        np.full(shape, card.sigma),
        np.full(shape, reference_belief(scenario) ** 2),
    )


def for_kernels(sensors: tuple[Sensor, ...], channels: Channels, n_epoch: int) -> Sensors:
    """Return the sensors in numbers for the kernels."""
    n = len(sensors)
    return Sensors(
        code=np.array([sensor.code for sensor in sensors], dtype=np.int64),
        channel=np.array(channels.first, dtype=np.int64),
        scalars=np.array([len(sensor.channels.labels) for sensor in sensors], dtype=np.int64),
        on=np.array([sensor.on for sensor in sensors], dtype=np.bool_).reshape(n, n_epoch),
        truth=np.array([sensor.truth for sensor in sensors], dtype=float).reshape(n, n_epoch, N_TRUTH),
        sources=np.array([source_word(sensor.noise) for sensor in sensors], dtype=np.uint64),
    )
