"""Range rates from Doppler as means over an interval, and their model in the filter."""

import numpy as np

from lvnav_trade.gnss.satellites import satellites
from lvnav_trade.gnss.visibility import antenna, transmission
from lvnav_trade.quantities.records import Floats
from lvnav_trade.scenario.filter_models import measured, smoothing_of, solves
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.signals.lines_of_sight import lines_of
from lvnav_trade.simulation.preparation.true_flight import Flight


def doppler_left(scenario: Scenario, flight: Flight) -> Floats | float:
    """Return the residual error of ranges and range rates by the averaging of the Doppler, (n_epoch, n_sat, 2) m, m/s.

    A mean over an interval differs from the rate at the epoch by half of the interval times the range acceleration.
    The true mean is the change of the range over the interval. The filter's model is that product on the nominal
    flight: an acceleration error of 1 mg would change it by 0.1 mm/s for 20 ms. The clock drift is that of the epoch.
    """
    if not _takes_doppler(scenario):
        return 0.0
    interval, modelled = scenario.receiver.doppler_interval, scenario.filter.corrections.doppler_interval
    modelled = interval if modelled == "matched" else modelled
    lag = 0.5 * modelled * flight.lines.acceleration
    if interval > 0.0:
        lag = lag + _mean_rate(scenario, flight, interval) - flight.lines.sight.rate
    return np.stack([np.zeros_like(lag), lag], axis=2)


def _takes_doppler(scenario: Scenario) -> bool:
    """Return whether the Doppler is used, by the filter or by the receiver's solution."""
    smoothing = smoothing_of(scenario)
    if solves(scenario):
        return smoothing is None or smoothing.velocity == "doppler"
    return not {"range_rate", "velocity"}.isdisjoint(measured(scenario))


def _mean_rate(scenario: Scenario, flight: Flight, interval: float) -> Floats:
    """Return the mean range rate over the interval (s) before each epoch, (n_epoch, n_sat) m/s."""
    trajectory, seen = flight.trajectory, flight.sky
    t = np.maximum(seen.t - interval, trajectory.start)
    at, _ = antenna(trajectory, scenario.receiver, t)
    above = satellites(scenario.constellation, trajectory.epoch)
    sent = transmission(above, trajectory.theta0, t, at)
    earlier = lines_of(trajectory, np.array(scenario.receiver.lever_b), seen._replace(t=t, r_i=sent.r_i, v_i=sent.v_i))
    return np.asarray((flight.lines.sight.distance - earlier.sight.distance) / (seen.t - t)[:, None])
