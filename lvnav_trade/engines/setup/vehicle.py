"""The filter's model of the vehicle's motion: envelope of its changes, samples of the IMU as measurements."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.setup.envelopes import envelopes
from lvnav_trade.engines.setup.inputs import Samples
from lvnav_trade.filters.base import EnvelopeCard, ImuModel
from lvnav_trade.filters.samples import VehicleModel
from lvnav_trade.kernels.transition import ACCEL, CONSTANT, GYRO
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.layout import StateLayout
from lvnav_trade.records import Floats, Reference
from lvnav_trade.scenario import Scenario
from lvnav_trade.world.control.ascent import changes
from lvnav_trade.world.truth import Trajectory


def vehicle_of(
    scenario: Scenario, trajectory: Trajectory, ref: Reference, layout: StateLayout, imu: ImuModel
) -> VehicleModel | None:
    """Return a filter's model of the vehicle's motion; None where the samples of its IMU are not measurements."""
    if layout.motion < 0:
        return None
    dt = 1.0 / scenario.imu.rate
    blocks = layout.parameters
    columns = np.zeros((N_SAMPLE, 1 + len(blocks)), dtype=np.int64)
    columns[:, 0] = layout.motion + np.arange(N_SAMPLE)
    for number, block in enumerate(blocks, start=1):
        columns[:, number] = np.tile(block.offset + np.arange(3), 2)
    noise = np.array([imu.gyro_random_walk**2 / dt] * 3 + [imu.accel_random_walk**2 / dt] * 3)
    return VehicleModel(
        motion=layout.motion,
        blocks=np.array([[block.sensor, block.driver] for block in blocks], dtype=np.int64).reshape(-1, 2),
        columns=columns,
        walk=walks(scenario.filter.envelope or EnvelopeCard(), trajectory, ref),
        variance=noise,
        rate=ref.dtheta / dt,
        force=ref.dvel / dt,
    )


def samples_of(scenario: Scenario, ref: Reference, layout: StateLayout, imu: ImuModel) -> Samples | None:
    """Return what is reported of the IMU's samples; None where nothing is."""
    if not layout.samples:
        return None
    dt = 1.0 / scenario.imu.rate
    noise = np.array([imu.gyro_random_walk**2 / dt] * 3 + [imu.accel_random_walk**2 / dt] * 3)
    found = {(block.sensor, block.driver): number for number, block in enumerate(layout.parameters)}
    par = np.array([found.get((sensor, CONSTANT), -1) for sensor in (GYRO, ACCEL)], dtype=np.int64)
    bias = [layout.parameters[p].offset + i if p >= 0 else -1 for p in par for i in range(3)]
    return Samples(
        rate=ref.dtheta / dt,
        force=ref.dvel / dt,
        par=par,
        bias=np.array(bias, dtype=np.int64),
        raw=noise + np.array([imu.gyro_bias**2] * 3 + [imu.accel_bias**2] * 3),
        variance=noise,
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
