"""Variables of the receiver's noise tables along a trajectory: altitude, specific force, jerk."""

from collections.abc import Sequence

import numpy as np

from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, geodetic_from_ecef, matrices
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.shared_cards import Dynamics, NoiseFactor, noise_factor
from lvnav_trade.trajectory.flight import Trajectory, motion

HALF_STEP = 0.05  # s to either side of a time for the change of specific force


def dynamics_at(trajectory: Trajectory, t: Floats) -> Dynamics:
    """Return altitude, specific force and jerk at times t (n,) s since lift-off.

    Jerk is the change of specific force in frame i over 0.1 s, which covers jumps of thrust.
    """
    at = motion(trajectory, t)
    height = geodetic_from_ecef(ecef_from_eci(at.r_i, earth_angle(trajectory.theta0, t)))[2]
    ends = [np.clip(t + shift, trajectory.start, trajectory.end) for shift in (-HALF_STEP, HALF_STEP)]
    before, after = (motion(trajectory, end) for end in ends)
    first, last = (np.einsum("nij,nj->ni", matrices(end.q_b_i), end.f_b) for end in (before, after))
    jerk = np.linalg.norm(last - first, axis=1) / (ends[1] - ends[0])
    return Dynamics(np.asarray(height), np.linalg.norm(at.f_b, axis=1), jerk)


def factors(
    tables: Sequence[NoiseFactor], measurements: Sequence[str], trajectory: Trajectory, t: Floats
) -> list[Floats | float]:
    """Return the factor (n, 1) on the sigma of each measurement at times t (n,) s; the number 1 without tables."""
    if not tables:
        return [1.0 for _ in measurements]
    at = dynamics_at(trajectory, t)
    return [noise_factor(tables, measurement, at)[:, None] for measurement in measurements]
