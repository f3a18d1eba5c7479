"""A vehicle that stands on its pad until lift-off, at a latitude, and nothing after it: alignment alone."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from lvnav_trade.quantities.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, quaternions, rotation_e_n
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.trajectory.attitude_algebra import body_axes
from lvnav_trade.trajectory.disturbances import OscillationCard, oscillations
from lvnav_trade.trajectory.truth import Trajectory, add_oscillations, attitude_spline, pad_phase, pad_times
from tests.building import loaded, prepare_hop, with_fields

THETA0 = 0.3
SENSORS = {
    "zero_velocity": {"kind": "zero_velocity", "sigma": "1 cm/s", "jitter": "1 cm/s"},
    "zero_rotation": {"kind": "zero_rotation", "sigma": "0.5 mrad", "jitter": "0.5 mrad", "attitude": "1 deg"},
    "pad_position": {"kind": "pad_position", "sigma": "1 cm", "jitter": "1 cm"},
    "azimuth": {"kind": "azimuth", "sigma": "20 arcsec"},
}  # fmt: skip
STILL = {"gyro.random_walk": "1e-6 deg/sqrt(h)", "gyro.rate_random_walk": "0 deg/h/sqrt(h)",
         "gyro.bias_repeatability": "0 deg/h", "accel.random_walk": "1e-6 mg/sqrt(Hz)",
         "accel.rate_random_walk": "0 mg/sqrt(h)", "accel.bias_repeatability": "0 mg"}  # fmt: skip
"""Fields of a unit that is nearly without error."""


@lru_cache(maxsize=8)
def pad(latitude: float, duration: float, sway: str = "") -> Trajectory:
    """Return the rest of an upright vehicle, its y axis to the east, at a latitude (deg), with an oscillation card."""
    r_e = ecef_from_geodetic(np.radians(latitude), np.radians(16.0), 10.0)
    _, east, down = rotation_e_n(np.radians(latitude), np.radians(16.0))
    t = pad_times(0.0, duration)
    up, right = (eci_from_ecef(np.tile(axis, (t.size, 1)), earth_angle(THETA0, t)) for axis in (-down, east))
    attitude = attitude_spline(t, quaternions(body_axes(up, right, np.zeros(t.size))))
    nominal = Trajectory(
        pad_phase(r_e, THETA0, 0.0, duration, attitude), {"liftoff": 0.0}, THETA0, "2024-03-20T12:00:00Z"
    )
    if not sway:
        return nominal
    cards = [OscillationCard.model_validate_json(sway)]
    return add_oscillations(nominal, oscillations(cards, nominal.events, (-duration, 0.0)))


def aligned(*sensors: str, imu: dict[str, str] | None = None, **fields: Any) -> Scenario:
    """Return the scenario of an alignment by some of SENSORS, with fields of the unit and of the scenario replaced; the
    unit works at 20 Hz.
    """
    found = {name: {**SENSORS[name], "name": name, "source": "test"} for name in sensors}
    base = loaded("base.imu=imu/tactical_fog_matched", "base.filter=filters/inertial", "base.imu.rate=20 Hz")
    unit = {f"imu.{name}": value for name, value in (imu or {}).items()}
    extra = ["standing_attitude"] if "zero_rotation" in sensors else []
    start = {"tilt": "1 deg", "heading": "4 deg", "position": "1 m", "velocity": "0.1 m/s"}
    return with_fields(base, **{
        "sensors": found, "filter.measurements": list(sensors), "filter.extra_states": extra, "initial": start, **unit,
        **fields,
    })  # fmt: skip


def prepared_case(scenario: Scenario, latitude: float, duration: float, sway: str = "") -> PreparedCase:
    """Prepare an alignment at a latitude (deg) over a duration (s)."""
    return prepare_hop(scenario, pad(latitude, duration, sway))
