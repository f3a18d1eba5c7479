"""Periodic relativistic term of the satellite clocks: in the true ranges, and in the receiver's correction."""

import numpy as np

from lvnav_trade.gnss.constellation import parts_of
from lvnav_trade.gnss.satellites import clock_relativity
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.earth import GM
from lvnav_trade.quantities.line_of_sight import falling
from lvnav_trade.quantities.records import Floats
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.true_flight import Flight

HALF_STEP = 0.5  # s to either side of a transmission for the rate of the true term
_CORRECTED_BY_THEIR_SYSTEM = "R"  # GLONASS broadcasts clocks with the term (ICD 5.1, section 3.3.3)


def relativity_left(scenario: Scenario, flight: Flight) -> Floats | float:
    """Return the residual of the satellites' relativistic clock term after correction, (n_epoch, n_sat, 2) m, m/s.

    A clock that is ahead stamps its signals as sent later, which shortens the measured range. The true term follows
    from the orbital elements, the correction from position and velocity (`clock_term`).
    """
    seen = flight.sky
    if not seen.tracked.any():
        return 0.0
    residual: Floats | float = 0.0
    if any(card.relativity for card in parts_of(scenario.constellation)):
        sent = seen.t[:, None] - flight.lines.sight.distance / SPEED_OF_LIGHT
        steps = (-HALF_STEP, 0.0, HALF_STEP)
        epoch = flight.trajectory.epoch
        before, now, after = (clock_relativity(scenario.constellation, epoch, sent + step) for step in steps)
        residual = -SPEED_OF_LIGHT * np.stack([now, (after - before) / (2.0 * HALF_STEP)], axis=2)
    if scenario.filter.corrections.relativity:
        # satellite velocities of the sky are by reception time
        passing = 1.0 - flight.lines.sight.rate / SPEED_OF_LIGHT
        term = clock_term(seen.r_i, seen.v_i / passing[..., None])
        of_system = np.array([letter != _CORRECTED_BY_THEIR_SYSTEM for letter in seen.systems])
        residual = residual - np.where(of_system[:, None], term, 0.0)
    return residual


def clock_term(r_i: Floats, v_i: Floats) -> Floats:
    """Return the effect of the periodic relativistic clock term on range and range rate, (..., 2) m, m/s.

    Canepa and Servidia, eq. 3.16: 2 r . v / c as a range. They print the lead of the clock in seconds, -2 r . v / c^2.

    Parameters
    ----------
    r_i, v_i
        (..., 3) m and m/s. Position and velocity of the satellite at transmission, frame i.
    """
    size = 2.0 / SPEED_OF_LIGHT * np.sum(r_i * v_i, axis=-1)
    rate = 2.0 / SPEED_OF_LIGHT * np.sum(v_i**2 + r_i * falling(r_i, GM), axis=-1)
    return np.stack([size, rate], axis=-1)
