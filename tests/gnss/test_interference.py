import math

import numpy as np
import pytest

from lvnav_trade.gnss.fault_cards import Jamming, Spoofing
from lvnav_trade.gnss.interference import cn0_under_jamming, jamming_density, spoofer_errors
from lvnav_trade.gnss.link import LinkCard
from lvnav_trade.gnss.visibility import sky
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.quantities.conditions import FlightProfile
from lvnav_trade.quantities.frames import ecef_from_geodetic, eci_from_ecef, rotation_e_n
from lvnav_trade.quantities.line_of_sight import sight
from lvnav_trade.trajectory.flight import motion
from tests.gnss.test_reception import LATITUDE, LONGITUDE, four, gps, receiver, vertical

AT = {"latitude": f"{math.degrees(LATITUDE)} deg", "longitude": f"{math.degrees(LONGITUDE)} deg", "height": "600 m"}
CHIPS = 1.023e6


def jammer(start="-10 s", duration="40 s", **changes):
    return Jamming(**({**AT, "power": "0 dBW", "start": start, "duration": duration} | changes))


def density(card, t=(-15.0, -5.0), rocket=None, **changes):
    """Return what a jammer is worth at a vehicle that stands 1 km above it, or flies."""
    rocket, t = rocket or vertical(), np.array(t)
    return jamming_density([card], LinkCard(), receiver(**changes), rocket, t, motion(rocket, t))


def test_a_narrow_band_leaves_the_chipping_rate_less_the_jammers_excess():
    # far beyond the noise (C/N0)_e = Q R_c / (J / S): 60.1 dB less J / S
    found = cn0_under_jamming(
        np.array([45.0]), np.array([-160.0]), 10.0 ** (0.1 * (-160.0 + 40.0)) / CHIPS * np.ones(1)
    )
    assert found[0] == pytest.approx(10.0 * math.log10(CHIPS) - 40.0, abs=0.02)
    # J / S of equal worth as the noise halves C/N0
    equal = 10.0 ** (-0.1 * 45.0) * 10.0 ** (0.1 * -160.0)
    halved = cn0_under_jamming(np.array([45.0]), np.array([-160.0]), np.array([equal]))[0]
    assert halved == pytest.approx(45.0 - 3.0103, abs=1e-4)


def test_without_a_jammer_and_without_a_signal_nothing_changes():
    with np.errstate(all="raise"):
        found = cn0_under_jamming(np.array([45.0, -np.inf]), np.array([-160.0, -np.inf]), np.zeros(2))
    np.testing.assert_array_equal(found, [45.0, -np.inf])


def test_its_power_falls_with_the_square_of_the_distance_and_holds_while_it_lasts():
    found = density(jammer())
    lost = (4.0 * math.pi * 1000.0 * 1575.42e6 / SPEED_OF_LIGHT) ** 2
    np.testing.assert_allclose(found[:, 0], [0.0, 1.0 / lost / CHIPS], rtol=1e-6)
    rocket = vertical()
    near, far = density(jammer(), (-5.0, 3.0), rocket)[:, 0]
    assert near / far == pytest.approx((1.0 + 0.5 * 80.0 * 3.0**2 / 1000.0) ** 2, rel=1e-3)


def test_quality_and_both_antennas_count():
    plain = density(jammer())[1, 0]
    assert density(jammer(quality=2.22))[1, 0] == pytest.approx(plain / 2.22)
    pattern = {"kind": "cosine", "peak": "6 dBi", "exponent": 2.0}
    assert density(jammer(pattern=pattern))[1, 0] == pytest.approx(plain * 10.0**0.6)
    tilted = density(jammer(pattern=pattern, azimuth="70 deg", elevation="30 deg"))[1, 0]
    assert tilted == pytest.approx(plain * 10.0**0.6 * math.cos(math.radians(60.0)) ** 2, rel=1e-3)
    down = {"name": "tail", "boresight": [-1, 0, 0], "pattern": {"kind": "cosine", "peak": "3 dBi"}}
    up = {**down, "name": "nose", "boresight": [1, 0, 0]}
    tail, nose = density(jammer(), antennas=[down, up])[1]
    assert (tail / plain, nose / plain) == pytest.approx((10.0**0.3, 10.0 ** (0.3 - 1.5)))


def test_below_the_horizon_of_the_jammer_nothing_arrives():
    assert density(jammer(latitude="38 deg"))[1, 0] == 0.0
    assert density(jammer(height="2600 m"))[1, 0] == 0.0


def test_the_link_budget_feels_it_and_the_receiver_loses_what_is_too_weak():
    rocket, t = vertical(), np.arange(-15.0, -1.0)
    quiet = sky(gps(), four(), rocket, t)
    weak, strong = (sky(gps(), four(), rocket, t, [jammer(power=power)]) for power in ("-42 dBW", "0 dBW"))
    before, tracked = t < -10.0, quiet.is_tracked[5]
    np.testing.assert_array_equal(weak.cn0[before], quiet.cn0[before])
    fall = (quiet.cn0 - weak.cn0)[8:, tracked]
    assert np.all((fall > 1.0) & (fall < 30.0))
    assert np.all(weak.range_sigma[8:][:, tracked] > quiet.range_sigma[8:][:, tracked])
    assert tracked.sum() >= 4
    assert strong.is_tracked[4].sum() >= 4
    assert not strong.is_tracked[8:].any()


def test_ranges_of_a_spoofer_are_those_of_the_place_that_moves_away():
    class Flight:
        theta0, flight_profile = 0.0, FlightProfile({"lift_off": 0.0})

    card = Spoofing(start="4 s", duration="60 s", velocity=["3 m/s", "-2 m/s", "1 m/s"])
    place = ecef_from_geodetic(0.6, 0.3, 5e4)
    step = 1e-2
    t = 30.0 + step * np.arange(-1.0, 2.0)
    angle = 7.292115e-5 * t
    r_i = eci_from_ecef(np.tile(place, (3, 1)), angle)
    satellite = np.array([[2.0e7, 1.2e7, 8e6], [1.2e7, -1.0e7, 2.1e7]])
    speed = np.array([[1000.0, -2500.0, 1200.0], [-900.0, 2000.0, 2600.0]])
    turning = np.cross([0.0, 0.0, 7.292115e-5], r_i)
    line = satellite + speed * t[:, None, None] - r_i[:, None]
    rate = np.tile(speed, (3, 1, 1)) - turning[:, None]
    found = spoofer_errors([card], Flight, t, r_i, sight(line, rate))
    # the place, found in axes of the Earth, and its distance to the satellites
    offset = np.array([3.0, -2.0, 1.0]) * (t - 4.0)[:, None] @ rotation_e_n(0.6, 0.3)
    false = np.linalg.norm(line - eci_from_ecef(offset, angle)[:, None], axis=2)
    np.testing.assert_allclose(found[:, :, 0], false - np.linalg.norm(line, axis=2), atol=1e-6)
    np.testing.assert_allclose(found[1, :, 1], (found[2, :, 0] - found[0, :, 0]) / (2.0 * step), atol=1e-6)
    assert np.linalg.norm(offset[1]) == pytest.approx(26.0 * math.sqrt(14.0))
    assert not spoofer_errors([card], Flight, np.array([0.0, 3.0, 70.0]), r_i, sight(line, rate)).any()
