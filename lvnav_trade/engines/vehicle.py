"""What a flight with an attitude reference takes in beside the rest: motion of the vehicle, envelope, noise."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.envelopes import envelopes
from lvnav_trade.engines.sensors import measures
from lvnav_trade.filters.base import ImuBelief
from lvnav_trade.filters.envelope import EnvelopeCard
from lvnav_trade.kernels.random import source_word
from lvnav_trade.kernels.transition import ATT
from lvnav_trade.layout import StateLayout
from lvnav_trade.observables.attitude import AttitudeReferenceCard
from lvnav_trade.records import Floats, Reference
from lvnav_trade.scenario import Scenario, sensor_model, sensor_of
from lvnav_trade.world.control.ascent import changes
from lvnav_trade.world.truth import Trajectory

ATTITUDE_NOISE = "attitude reference noise"
"""Source of the budget."""
CHANNELS = (
    *(f"position {axis}" for axis in "xyz"), *(f"velocity {axis}" for axis in "xyz"),
    *(f"attitude {axis}" for axis in "xyz"), *(f"gyro {axis}" for axis in "xyz"),
    *(f"accelerometer {axis}" for axis in "xyz"),
)  # fmt: skip
"""Innovation channels; those of the inertial unit belong to the last sample before an epoch."""
N_EPOCH_ROW = 9


class Vehicle(NamedTuple):
    """Settings of a flight with an attitude reference.

    on (n_epoch,) whether the attitude reference measures; modelled: rate and acceleration are states, at `motion` of
    the error state; bias: first state of the biases; rate, force (n_imu, 3) true means over the ticks (rad/s, m/s^2,
    body axes); walk (n_imu, 6) variance of the step that the filter expects of them into each tick; variance (6,) that
    it models of a sample's noise; raw (6,) that with the bias before it is estimated; attitude (n_epoch, 4) true
    quaternion at the epochs; sigma of the attitude reference and the variance in the filter's model; source word;
    entries (1,) and columns (3, 1) of its rows, a row an axis, as `absorb` takes them.
    """

    on: NDArray[np.bool_]
    modelled: bool
    motion: int
    bias: int
    rate: Floats
    force: Floats
    walk: Floats
    variance: Floats
    raw: Floats
    attitude: Floats
    sigma: float
    believed: float
    source: np.uint64
    entries: NDArray[np.int64]
    columns: NDArray[np.int64]


def vehicle_of(
    scenario: Scenario, trajectory: Trajectory, ref: Reference, layout: StateLayout, imu: ImuBelief,
    epoch_tick: NDArray[np.int64],
) -> Vehicle | None:  # fmt: skip
    """Return the settings of a case whose filter has an attitude reference; None for any other."""
    card, sensor = scenario.filter, sensor_of(scenario, "attitude")
    if not isinstance(sensor, AttitudeReferenceCard):
        return None
    dt = 1.0 / scenario.imu.rate
    modelled = layout.motion >= 0
    walk = np.zeros((ref.dtheta.shape[0], 6))
    if modelled:
        walk[:] = walks(card.envelope or EnvelopeCard(), trajectory, ref)
    noise = np.array([imu.gyro_random_walk**2 / dt] * 3 + [imu.accel_random_walk**2 / dt] * 3)
    return Vehicle(
        on=measures(scenario, sensor, trajectory.events, ref.t[epoch_tick]),
        modelled=modelled,
        motion=layout.motion,
        bias=layout.parameters[0].offset,
        rate=ref.dtheta / dt,
        force=ref.dvel / dt,
        walk=walk,
        variance=noise,
        raw=noise + np.array([imu.gyro_bias**2] * 3 + [imu.accel_bias**2] * 3),
        attitude=np.ascontiguousarray(ref.q_b_i[epoch_tick]),
        sigma=sensor.sigma,
        believed=sensor_model(scenario, sensor).sigma ** 2,
        source=source_word(ATTITUDE_NOISE),
        entries=np.zeros(1, dtype=np.int64),
        columns=ATT + np.arange(3, dtype=np.int64)[:, None],
    )


def walks(card: EnvelopeCard, trajectory: Trajectory, ref: Reference) -> Floats:
    """Return the variances (n_imu, 6) of the steps of rate (roll, pitch, yaw) and acceleration into each tick.

    Commanded is the attitude of the ascent. Its nozzle does not move: that of a vehicle under control does, see
    `rotation_loop`.
    """
    t = ref.t[:-1]
    found = envelopes(
        card, t, burning(trajectory, t), changes(trajectory), ref.w_ib_b[:-1, 1:], np.zeros((t.size, 2))
    )  # fmt: skip
    return np.hstack([found.turning, found.jerk]) ** 2 * (t[1] - t[0]) ** 2


def burning(trajectory: Trajectory, t: Floats) -> NDArray[np.bool_]:
    """Return whether a motor burns at times t (n,): from lift-off or an ignition to the next cut-off (`burns`)."""
    found = np.zeros(t.size, dtype=bool)
    for start, end in burns(trajectory):
        found |= (t >= start) & (t < end)
    return found


def burns(trajectory: Trajectory) -> list[tuple[float, float]]:
    """Return start and end (s) of each burn by the names of events; one whose cut-off has no name lasts to the end."""
    marks = sorted((t, bool(re.search("cutoff", name))) for name, t in trajectory.events.items()
                   if name == "liftoff" or re.search("ignition|cutoff", name))  # fmt: skip
    found: list[tuple[float, float]] = []
    start: float | None = None
    for t, off in marks:
        if off and start is not None:
            found.append((start, t))
            start = None
        elif not off and start is None:
            start = t
    return found if start is None else [*found, (start, trajectory.end)]
