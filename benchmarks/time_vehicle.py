"""The filter of 24 states that takes every sample of a 200 Hz unit as six measurements: simulated seconds per wall
second and core, the same flight without its model of the vehicle, and linear covariance.
"""

from __future__ import annotations

from benchmarks.common import best
from benchmarks.time_flight import speed
from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.covariance.history import covariance
from lvnav_trade.simulation.preparation.prepare import prepare


def measure() -> dict[str, float]:
    """Return speeds of runs with and without the model of the vehicle, seconds a run, and seconds of covariance."""
    study = campaign_file("campaigns/drdc/rates_and_accelerations.yaml")
    found = {case.axes["filter"]: case.scenario for case in cases(load(study)) if "published" in case.axes["imu"]}
    modelled, baseline = prepare(found["vehicle model"]), prepare(found["baseline"])
    flown = speed(modelled)
    return {
        "vehicle_24_states_sim_s_per_s_core": flown,
        "vehicle_24_states_s_per_run": float(modelled.reference.t[-1] - modelled.reference.t[0]) / flown,
        "vehicle_baseline_18_states_sim_s_per_s_core": speed(baseline),
        "vehicle_24_states_lincov_s": best(lambda: covariance(modelled), 2),
    }
