"""A ground station's range, azimuth and elevation: plain geometry, derivatives, errors that last, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.kernels.strapdown import N_NAV, Q, R
from lvnav_trade.quantities.frames import earth_angle, ecef_from_geodetic, eci_from_ecef, rotation_e_n
from lvnav_trade.sensors.ground_station import SCALARS, StationCard, fill
from lvnav_trade.sensors.jacobian_row import H_POS, N_ENTRY, add
from lvnav_trade.sensors.sensor import FlightView

SITE = (-2.3, -44.4, 50.0)
CARD = {
    "name": "radar", "source": "none", "latitude": f"{SITE[0]} deg", "longitude": f"{SITE[1]} deg",
    "height": f"{SITE[2]} m", "range_sigma": "5 m", "angle_sigma": "0.1 mrad", "longest_range": "500 km",
}  # fmt: skip
# Azimuth, elevation (deg) and range (m): around, across north, low, high.
LOOKS = [(80.0, 30.0, 1e5), (359.9999, 10.0, 4e5), (0.0001, 10.0, 4e5), (200.0, 3.0, 8e5), (300.0, 80.0, 3e4)]
THETA0 = 0.7


def view(places, t=100.0):
    """The flight of a vehicle at Earth-fixed places (n, 3), all at one time."""
    n = len(places)
    theta = np.full(n, earth_angle(THETA0, t))
    zero = np.zeros((n, 3))
    return FlightView(np.full(n, t), eci_from_ecef(places, theta), zero, np.zeros((n, 4)), np.zeros(n), theta, zero,
                      "2026-08-01T12:00:00Z")  # fmt: skip


def placed(azimuth, elevation, distance, site=SITE):
    """The Earth-fixed place that a station sees there."""
    a, e = np.radians([azimuth, elevation])
    ned = distance * np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), -np.sin(e)])
    lat, lon = np.radians(site[:2])
    return ecef_from_geodetic(lat, lon, site[2]) + rotation_e_n(lat, lon).T @ ned


def station(**fields):
    return StationCard.model_validate({**CARD, **fields})


FLIGHT = view([placed(*look) for look in LOOKS])


def test_the_truth_is_plain_geometry():
    found = station().truth(FLIGHT)
    expected = [(r, np.radians(a), np.radians(e)) for a, e, r in LOOKS]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7)


def innovations(card, k, moved, observed):
    """Rows and innovations of a filter whose position is off by `moved` (m, frame i)."""
    H, z, nav = np.full((3, N_ENTRY), np.nan), np.full(3, np.nan), np.zeros(N_NAV)
    nav[Q], nav[R : R + 3] = 1.0, FLIGHT.r_i[k] + moved
    fill(H, z, 0, observed, nav, card.filter_parameters(card.matched_model(), FLIGHT)[k])
    return H, z


@pytest.mark.parametrize("k", range(len(LOOKS)))
@pytest.mark.parametrize("measures", [SCALARS, ("range",), ("azimuth", "elevation"), ("elevation",)])
def test_innovations_are_differences_of_the_geometry_and_rows_their_derivatives(k, measures):
    own = {"measures": measures}
    own |= {} if "range" in measures else {"range_sigma": "0 m"}
    own |= {} if set(measures) != {"range"} else {"angle_sigma": "0 rad"}
    card, n = station(**own), len(measures)
    truth, out = np.zeros(4), np.zeros(4)
    truth[:n] = card.truth(FLIGHT)[k]
    add(out, truth, 0.0, 0.0, 0.0)
    H, z = innovations(card, k, np.zeros(3), out)
    np.testing.assert_allclose(z[:n], 0.0, atol=1e-8)
    assert np.all(np.isnan(z[n:]))  # rows that are not its own stay
    reach = 1e-3 * LOOKS[k][2]
    for axis in range(3):
        step = reach * np.eye(3)[axis]
        up, down = (innovations(card, k, sign * step, out)[1][:n] for sign in (1.0, -1.0))
        scale = np.array([1.0 if name == "range" else 1.0 / LOOKS[k][2] / np.cos(np.radians(LOOKS[k][1]))
                          for name in measures])  # fmt: skip
        np.testing.assert_allclose(H[:n, H_POS + axis], (down - up) / (2.0 * reach), rtol=0.0, atol=2e-4 * scale.max())
        elsewhere = FLIGHT._replace(r_i=FLIGHT.r_i + step)
        lost = card.truth(elsewhere)[k] - truth[:n]
        turns = np.round(lost / (2.0 * np.pi)) * [name == "azimuth" for name in measures]
        expected = lost - 2.0 * np.pi * turns
        np.testing.assert_allclose(up, -expected, rtol=1e-6, atol=1e-8)
    assert not np.any(np.delete(H[:n], range(H_POS, H_POS + 3), axis=1))


def test_an_azimuth_across_north_does_not_jump():
    card = station()
    observed = np.array([*card.truth(FLIGHT)[1], 0.0])
    observed[1] = 1e-4  # beyond north, where the reference is short of it
    z = innovations(card, 1, np.zeros(3), observed)[1]
    assert z[1] == pytest.approx(1e-4 + 2 * np.pi - np.radians(LOOKS[1][0]), abs=1e-9)


def test_a_survey_error_is_the_station_standing_elsewhere():
    card = station(survey="10 m")
    (survey,) = [error for error in card.correlated_errors() if error.source == "station survey"]
    found = survey.partials(FLIGHT, 3)
    lat, lon = np.radians(SITE[:2])
    C_e_n = rotation_e_n(lat, lon)
    for label, direction in (("north", C_e_n[0]), ("east", C_e_n[1]), ("up", -C_e_n[2])):
        k = survey.labels.index(label)
        # a station that is off by d sees what one in place sees of a vehicle that is off by -d
        shifted = view(np.array([placed(*look) for look in LOOKS]) - 5.0 * direction)
        before = view(np.array([placed(*look) for look in LOOKS]) + 5.0 * direction)
        change = card.truth(shifted) - card.truth(before)
        change[:, 1] -= 2 * np.pi * np.round(change[:, 1] / (2 * np.pi))
        np.testing.assert_allclose(found[:, :, k], change / 10.0, rtol=1e-5, atol=1e-9)


def test_the_residual_refraction_of_a_high_line_is_that_of_a_flat_atmosphere():
    card = station(refraction="10 percent", height="0 m")
    steep = view([placed(10.0, 60.0, 4e4, (*SITE[:2], 0.0))])
    (air,) = [error for error in card.correlated_errors() if error.source == "refraction"]
    found = air.partials(steep, 3)[0, :, 0]
    N, H, h, e = 315e-6, 7350.0, 4e4 * np.sin(np.radians(60.0)), np.radians(60.0)
    share = 1.0 - np.exp(-h / H)
    assert found[0] == pytest.approx(N * H * share / np.sin(e), rel=2e-3)  # 2.6 m
    assert found[1] == 0.0
    assert found[2] == pytest.approx(N / np.tan(e) * (1.0 - H / h * share), rel=5e-3)  # 0.14 mrad
    assert (air.sigma, air.field) == (0.1, "refraction")


def test_biases_act_on_their_scalars_only():
    card = station(range_bias="10 m", angle_bias="0.1 mrad")
    by_source = {error.source: error.partials(FLIGHT, 3)[0] for error in card.correlated_errors()}
    np.testing.assert_array_equal(by_source["station range bias"], [[1.0], [0.0], [0.0]])
    np.testing.assert_array_equal(by_source["station angle bias"], [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


def test_it_measures_above_its_mask_and_within_its_range():
    assert station(elevation_above="5 deg").is_available(FLIGHT).tolist() == [True, True, True, False, True]
    assert station(longest_range="900 km", elevation_below="50 deg").is_available(FLIGHT).tolist() == [1, 1, 1, 1, 0]
    below = view([placed(80.0, -1.0, 1e5)])
    assert not station().is_available(below).any()


@pytest.mark.parametrize(
    ("fields", "reported"),
    [
        ({"latitude": "95 deg"}, "latitude: is between"),
        ({"measures": []}, "at least 1 item"),
        ({"measures": ["range", "range"]}, "is listed twice"),
        ({"measures": ["range"]}, "angle_sigma: no effect: the station measures no angle"),
        ({"measures": ["azimuth"]}, "range_sigma: no effect"),
        ({"measures": ["range"], "angle_sigma": "0 rad", "angle_bias": "1 mrad"}, "angle_bias: no effect"),
        ({"range_sigma": "0 m"}, "range_sigma: is missing, or zero"),
        ({"longest_range": "0 m"}, "greater than 0"),
        ({"elevation_above": "20 deg", "elevation_below": "10 deg"}, "elevation_above: should be less"),
    ],
)
def test_what_cannot_be_is_refused(fields, reported):
    with pytest.raises(ValidationError, match=reported):
        station(**fields)


def test_the_matched_model_has_the_cards_own_numbers():
    card = station(range_bias="7 m")
    model = card.matched_model()
    assert (model.range_sigma, model.angle_sigma, model.range_bias) == (5.0, 1e-4, 7.0)
    np.testing.assert_allclose(card.assumed_variance(model, FLIGHT), [[25.0, 1e-8, 1e-8]])
