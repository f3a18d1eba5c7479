"""How far a flight lies from one on record: speed and altitude over time, times of events."""

from __future__ import annotations

import numpy as np

from lvnav_trade.frames import earth_angle, earth_velocity, ecef_from_eci, geodetic_from_ecef
from lvnav_trade.world.ascent.record import read
from lvnav_trade.world.ascent.vehicle import Recorded, Site
from lvnav_trade.world.truth import Trajectory, motion


def differences(recorded: Recorded, flight: Trajectory, site: Site) -> dict[str, float | str]:
    """Return the facts of the comparison: flight minus record.

    Of speed relative to the Earth (m/s) and altitude over the site (m): RMS, the greatest and its time (s), over the
    record from lift-off to injection; of every event on record the difference in s. InputError where the record is
    broken.
    """
    facts: dict[str, float | str] = {"compared_with": recorded.source}
    if recorded.file is not None:
        record = read(recorded.file)
        flown = (record.t >= 0.0) & (record.t <= flight.events["injection"])
        at = motion(flight, record.t[flown])
        speed = np.linalg.norm(earth_velocity(at.r_i, at.v_i), axis=1) - record.speed[flown]
        height = geodetic_from_ecef(ecef_from_eci(at.r_i, earth_angle(flight.theta0, at.t)))[2]
        altitude = height - site.height - record.altitude[flown]
        for name, unit, residual in (("speed", "m_s", speed), ("altitude", "m", altitude)):
            worst = int(np.argmax(np.abs(residual)))
            facts[f"record_{name}_rms_{unit}"] = float(np.sqrt(np.mean(residual**2)))
            facts[f"record_{name}_worst_{unit}"] = float(residual[worst])
            facts[f"record_{name}_worst_at_s"] = float(at.t[worst])
    for name, time in recorded.events.items():
        if name in flight.events:
            facts[f"{name}_after_record_s"] = flight.events[name] - time
    return facts
