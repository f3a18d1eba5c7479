"""Range rates of the Doppler, and the periodic relativistic term of the satellites' clocks."""

import numpy as np

from lvnav_trade.gnss.constellation import constellation_parts
from lvnav_trade.gnss.satellites import clock_relativity, satellites
from lvnav_trade.gnss.visibility import antenna_motion, transmission
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.earth import GM
from lvnav_trade.quantities.line_of_sight import point_mass_gravitation
from lvnav_trade.quantities.records import Floats
from lvnav_trade.scenario.filter_models import carrier_smoothing, filter_measurements, has_receiver_solution
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.signals.lines_of_sight import lines_of
from lvnav_trade.simulation.preparation.true_flight import TrueFlight


def doppler_residual(scenario: Scenario, flight: TrueFlight) -> Floats | float:
    """Return the residual error of ranges and range rates by the averaging of the Doppler, (n_epoch, n_sat, 2) m, m/s.

    A mean over an interval differs from the rate at the epoch by half of the interval times the range acceleration.
    The true mean is the change of the range over the interval. The filter's model is that product on the nominal
    flight: an acceleration error of 1 mg would change it by 0.1 mm/s for 20 ms. The clock drift is that of the epoch.
    """
    if not _uses_doppler(scenario):
        return 0.0
    interval = scenario.receiver.doppler_interval
    interval_setting = scenario.filter.corrections.doppler_interval
    modelled_interval = interval if interval_setting == "matched" else interval_setting
    residual = 0.5 * modelled_interval * flight.lines.acceleration
    if interval > 0.0:
        residual = residual + _mean_rate(scenario, flight, interval) - flight.lines.sight.rate
    return np.stack([np.zeros_like(residual), residual], axis=2)


def _uses_doppler(scenario: Scenario) -> bool:
    """Return whether the Doppler is used, by the filter or by the receiver's solution."""
    smoothing = carrier_smoothing(scenario)
    if has_receiver_solution(scenario):
        return smoothing is None or smoothing.velocity == "doppler"
    return not {"range_rate", "velocity"}.isdisjoint(filter_measurements(scenario))


def _mean_rate(scenario: Scenario, flight: TrueFlight, interval: float) -> Floats:
    """Return the mean range rate over an interval before each epoch, (n_epoch, n_sat) m/s.

    Parameters
    ----------
    scenario, flight
        Validated model of the case, and its true flight.
    interval
        s. Length of the interval.
    """
    trajectory = flight.trajectory
    receiver = scenario.receiver
    sky = flight.sky
    t = np.maximum(sky.t - interval, trajectory.start)
    antenna_r_i, _ = antenna_motion(trajectory, receiver, t)
    orbits = satellites(scenario.constellation, trajectory.epoch)
    transmission_state = transmission(orbits, trajectory.theta0, t, antenna_r_i)
    earlier_sky = sky._replace(t=t, r_i=transmission_state.r_i, v_i=transmission_state.v_i)
    lever_b = np.array(receiver.lever_b)
    earlier_lines = lines_of(trajectory, lever_b, earlier_sky)
    range_change = flight.lines.sight.distance - earlier_lines.sight.distance
    time_difference = (sky.t - t)[:, None]
    return np.asarray(range_change / time_difference)


HALF_STEP = 0.5  # s to either side of a transmission for the rate of the true term
_CORRECTED_BY_THEIR_SYSTEM = "R"  # GLONASS broadcasts clocks with the term (ICD 5.1, section 3.3.3)


def relativity_residual(scenario: Scenario, flight: TrueFlight) -> Floats | float:
    """Return the residual of the satellites' relativistic clock term after correction, (n_epoch, n_sat, 2) m, m/s.

    A clock that is ahead stamps its signals as sent later, which shortens the measured range. The true term follows
    from the orbital elements, the correction from position and velocity (`clock_term`).
    """
    sky = flight.sky
    if not sky.is_tracked.any():
        return 0.0
    line = flight.lines.sight
    residual: Floats | float = 0.0
    if any(card.relativity for card in constellation_parts(scenario.constellation)):
        travel_time = line.distance / SPEED_OF_LIGHT
        transmission_time = sky.t[:, None] - travel_time
        epoch = flight.trajectory.epoch
        earlier_clock = clock_relativity(scenario.constellation, epoch, transmission_time - HALF_STEP)
        clock = clock_relativity(scenario.constellation, epoch, transmission_time)
        later_clock = clock_relativity(scenario.constellation, epoch, transmission_time + HALF_STEP)
        rate = (later_clock - earlier_clock) / (2.0 * HALF_STEP)
        residual = -SPEED_OF_LIGHT * np.stack([clock, rate], axis=2)
    if scenario.filter.corrections.relativity:
        # satellite velocities of the sky are by reception time
        passing = 1.0 - line.rate / SPEED_OF_LIGHT
        v_i = sky.v_i / passing[..., None]
        term = clock_term(sky.r_i, v_i)
        is_corrected = np.array([letter != _CORRECTED_BY_THEIR_SYSTEM for letter in sky.systems])
        correction = np.where(is_corrected[:, None], term, 0.0)
        residual = residual - correction
    return residual


def clock_term(r_i: Floats, v_i: Floats) -> Floats:
    """Return the effect of the periodic relativistic clock term on range and range rate, (..., 2) m, m/s.

    Canepa and Servidia, eq. 3.16: 2 r . v / c as a range. They print the lead of the clock in seconds, -2 r . v / c^2.

    Parameters
    ----------
    r_i, v_i
        (..., 3) m and m/s. Position and velocity of the satellite at transmission, frame i.
    """
    factor = 2.0 / SPEED_OF_LIGHT
    gravitation = point_mass_gravitation(r_i, GM)
    product_rate = v_i**2 + r_i * gravitation
    range_term = factor * np.sum(r_i * v_i, axis=-1)
    rate_term = factor * np.sum(product_rate, axis=-1)
    return np.stack([range_term, rate_term], axis=-1)
