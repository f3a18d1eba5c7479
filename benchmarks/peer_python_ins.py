"""python-ins (PyPI) on the work it offers nearest to ours: 15 states, 200 Hz unit, position and velocity at 1 Hz."""

from __future__ import annotations

import time
from typing import Any

SECONDS = 20.0


def _flight() -> tuple[Any, ...]:
    from pyins import sim, strapdown

    dt = 0.005
    trajectory, imu = sim.generate_sine_velocity_motion(dt, SECONDS, [50.0, 60.0, 100.0], [100.0, 0.0, 0.0], 1.0)
    return trajectory, strapdown.compute_increments_from_imu(imu, "rate")


def _measurements(trajectory: Any) -> list[Any]:
    from pyins import measurements, sim

    once_a_second = trajectory.iloc[200::200]
    position = sim.generate_position_measurements(once_a_second, 2.0, rng=1)
    velocity = sim.generate_ned_velocity_measurements(once_a_second, 0.1, rng=2)
    return [measurements.Position(position, 2.0), measurements.NedVelocity(velocity, 0.1)]


def speed(time_step: float) -> float:
    """Return simulated seconds per wall second of its feedback filter with covariance steps of `time_step` (s)."""
    from pyins import filters, inertial_sensor

    trajectory, increments = _flight()
    model = {"bias_sd": 1e-5, "noise": 1e-5, "bias_walk": 1e-8}
    gyro, accel = inertial_sensor.EstimationModel(**model), inertial_sensor.EstimationModel(**model)

    def run() -> None:
        filters.run_feedback_filter(
            trajectory.iloc[0],
            1.0,
            0.1,
            0.1,
            0.5,
            increments,
            gyro,
            accel,
            _measurements(trajectory),
            time_step=time_step,
        )

    run()
    start = time.perf_counter()
    run()
    return SECONDS / (time.perf_counter() - start)


def measure() -> dict[str, float]:
    """Return its speed at its default step (0.1 s) and at covariance steps of one IMU tick."""
    return {"python_ins_default_sim_s_per_s": speed(0.1), "python_ins_200_hz_sim_s_per_s": speed(0.005)}
