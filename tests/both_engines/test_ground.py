"""Ground stations and a baro-altimeter in both engines: they agree, and meet the closed form of one measurement."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.covariance.history import covariance
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, geodetic_from_ecef, rotation_i_n
from lvnav_trade.sensors.ground_station import StationCard
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.sensors import flight_view
from tests.building import INERTIAL, MATCHED, SITE_R, flight, loaded, prepare_hop, turning, with_fields

N_RUN = 200
BELOW = geodetic_from_ecef(ecef_from_eci(SITE_R, earth_angle(0.3, 0.0)))
LATITUDE, LONGITUDE = (math.degrees(float(angle)) for angle in BELOW[:2])
STATION = {
    "kind": "ground_station", "name": "radar", "source": "test", "latitude": f"{LATITUDE - 1.0!r} deg",
    "longitude": f"{LONGITUDE - 2.0!r} deg", "range_sigma": "5 m", "angle_sigma": "0.2 mrad", "range_bias": "10 m",
    "angle_bias": "0.1 mrad", "survey": "3 m", "refraction": "10 percent", "longest_range": "1000 km",
    "elevation_above": "3 deg",
}  # fmt: skip
BAROMETER = {"kind": "barometer", "name": "baro", "source": "test", "sigma": "10 Pa", "bias": "30 m",
             "scale": "1 percent", "flow": "1 percent", "highest": "86 km"}  # fmt: skip
START = {"initial.position": "100 m", "initial.velocity": "0.5 m/s"}


def tracked(filters=INERTIAL, measurements=(), **sensors):
    base = loaded(MATCHED, filters)
    names = [*base.filter.measurements, *measurements, "ground_tracking"]
    return with_fields(base, **{"filter.measurements": names, "sensors": sensors or {"radar": STATION}, **START})


def climbing():
    """Return a flight through 10 km: the short flight begins there, at a launcher's speed."""
    r = SITE_R * (1.0 - 177e3 / np.linalg.norm(SITE_R))
    along = 20.0 * r / np.linalg.norm(r)
    return flight([(20.0, lambda t: along)], turning, r=r, v=np.cross([0.0, 0.0, 7.292115e-5], r) + 15.0 * along)


def agree(case, trajectory=None, quantities=slice(0, 9)):
    prepared_case = prepare_hop(case, trajectory)
    cov, block = covariance(prepared_case), run_block(prepared_case, 7, 0, N_RUN)
    np.testing.assert_array_equal(cov.n_row, block.n_row[0])
    assert cov.n_row.max() > 0
    expected = np.hypot(cov.true_sigma[-1], cov.mean[-1])[quantities]
    ratio = np.sqrt((block.err[:, -1, quantities] ** 2).mean(axis=0)) / expected
    low, high = np.sqrt(chi2.ppf([5e-5, 1.0 - 5e-5], N_RUN) / N_RUN)
    assert np.all((low < ratio) & (ratio < high)), ratio
    return prepared_case, cov


def test_both_engines_agree_on_a_station_with_every_error_and_name_each_in_the_budget():
    _, cov = agree(tracked())
    assert {"station range bias", "station angle bias", "station survey", "refraction"} <= set(cov.sources)
    assert cov.true_sigma[-1, 6:9].max() < 60.0  # m; 100 m without it


def test_both_engines_agree_on_two_stations_of_different_scalars_and_a_barometer():
    ranging = {**STATION, "name": "ranging", "longitude": f"{LONGITUDE + 3.0!r} deg", "measures": ["range"],
               "angle_sigma": "0 rad", "angle_bias": "0 rad", "rate": "0.5 Hz"}  # fmt: skip
    angles = {**STATION, "measures": ["azimuth", "elevation"], "range_sigma": "0 m", "range_bias": "0 m"}
    case = tracked(measurements=["pressure_altitude"], ranging=ranging, angles=angles, baro=BAROMETER)
    prepared_case, cov = agree(case, climbing())
    assert prepared_case.channels.names[6:] == (
        "ranging range",
        "angles azimuth",
        "angles elevation",
        "pressure_altitude",
    )
    assert {"barometer bias", "barometer scale", "barometer port", "station survey ranging"} <= set(cov.sources)


@pytest.mark.parametrize("bias", [0.0, 40.0])
def test_one_range_leaves_the_closed_form_along_the_line_of_sight(bias):
    """Before, the position is known to S on every axis; K = S^2 / (S^2 + s^2) along the line, where true errors are the
    noise s and a bias b that the filter does not know: (1 - K)^2 S^2 + K^2 (s^2 + b^2)."""
    station = {**STATION, "measures": ["range"], "angle_sigma": "0 rad", "angle_bias": "0 rad", "survey": "0 m",
               "refraction": "0 percent", "range_bias": f"{bias!r} m", "range_sigma": "20 m", "from": "0.5 s",
               "until": "1.5 s"}  # fmt: skip
    case = tracked(radar=station)
    prepared_case = prepare_hop(case)
    cov = covariance(prepared_case)
    assert cov.n_row.sum() == 1
    view = flight_view(prepared_case.trajectory, np.array([1.0]))
    line = StationCard.model_validate(station).lines_of_sight(view).partials[0, 0]
    C_i_n = rotation_i_n(view.r_i, view.theta)[0]
    along, S, s = C_i_n @ line, math.hypot(100.0, 0.5), 20.0
    K = S**2 / (S**2 + s**2)
    at = int(np.argmin(np.abs(cov.t - 1.0)))
    for values, error in ((cov.true_sigma, (1.0 - K) ** 2 * S**2 + K**2 * (s**2 + bias**2)),
                          (cov.formal_sigma, (1.0 - K) * S**2)):  # fmt: skip
        expected = np.sqrt(S**2 * (1.0 - along**2) + along**2 * error)
        np.testing.assert_allclose(values[at, 6:9], expected, rtol=2e-3)


def test_a_station_that_never_sees_the_vehicle_measures_nothing():
    prepared_case = prepare_hop(tracked(radar={**STATION, "longest_range": "100 km"}))
    assert covariance(prepared_case).n_row.sum() == 0
