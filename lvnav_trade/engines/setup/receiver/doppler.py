"""Range rates of the Doppler as means over an interval, and as the filter models them."""

import numpy as np

from lvnav_trade.engines.setup.flight import Flight
from lvnav_trade.engines.setup.receiver.lines import lines_of
from lvnav_trade.filter_models import measured, smoothing_of, solves
from lvnav_trade.records import Floats
from lvnav_trade.scenario import Scenario
from lvnav_trade.world.receiver.visibility import antenna, transmission
from lvnav_trade.world.sky.satellites import satellites


def doppler_left(scenario: Scenario, flight: Flight) -> Floats | float:
    """Return what range rates differ by from those at the epoch because they are means, less what the filter models of
    that, (n_epoch, n_sat, 2) m, m/s.

    A mean over an interval lags by half of it times the acceleration along the line of sight. The true one is the
    change of the range over the interval; the model is that product at the epoch, on the nominal flight: an error of
    1 mg in the filter's own acceleration would change it by 0.1 mm/s in 20 ms. The receiver's clock has the drift of
    the epoch.
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
    """Return whether the receiver's Doppler is measured, by the filter or by the receiver's own solution."""
    smoothing = smoothing_of(scenario)
    if solves(scenario):
        return smoothing is None or smoothing.velocity == "doppler"
    return not {"range_rate", "velocity"}.isdisjoint(measured(scenario))


def _mean_rate(scenario: Scenario, flight: Flight, interval: float) -> Floats:
    """Return the change of the ranges over an interval (s) up to the epochs, by its length, (n_epoch, n_sat) m/s."""
    trajectory, seen = flight.trajectory, flight.sky
    t = np.maximum(seen.t - interval, trajectory.start)
    at, _ = antenna(trajectory, scenario.receiver, t)
    above = satellites(scenario.constellation, trajectory.epoch)
    sent = transmission(above, trajectory.theta0, t, at)
    earlier = lines_of(trajectory, np.array(scenario.receiver.lever_b), seen._replace(t=t, r_i=sent.r_i, v_i=sent.v_i))
    return np.asarray((flight.lines.sight.distance - earlier.sight.distance) / (seen.t - t)[:, None])
