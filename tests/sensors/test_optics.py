"""The direction of the Sun: a published position, the seasons, and a frame whose x axis is anywhere."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities.frames import gmst
from lvnav_trade.sensors.optics import sun_direction


def equatorial(epoch, t=0.0):
    """Right ascension and declination (deg) of the Sun: frame i with its x axis at the equinox."""
    t = np.array([t])
    x, y, z = sun_direction(epoch, t, gmst(epoch) + OMEGA * t)[0]
    return np.degrees(np.arctan2(y, x)) % 360.0, np.degrees(np.arcsin(z))


def test_it_stands_where_the_published_example_has_it():
    # Meeus, Astronomical Algorithms, example 25.a: 1992 October 13, 0 h dynamical time
    right_ascension, declination = equatorial("1992-10-13T00:00:00Z")
    assert right_ascension == pytest.approx(198.38083, abs=0.01)
    assert declination == pytest.approx(-7.78507, abs=0.01)


@pytest.mark.parametrize(
    ("epoch", "declination", "right_ascension"),
    [
        ("2024-03-20T03:06:00Z", 0.0, 0.0),
        ("2024-06-20T20:51:00Z", 23.44, 90.0),
        ("2024-12-21T09:21:00Z", -23.44, 270.0),
    ],
)
def test_seasons_begin_when_they_did(epoch, declination, right_ascension):
    found = equatorial(epoch)
    assert found[1] == pytest.approx(declination, abs=0.01)
    assert (found[0] - right_ascension + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.02)


def test_it_moves_by_a_degree_a_day_and_a_frame_turned_about_the_axis_sees_it_turned():
    start = equatorial("2024-03-20T12:00:00Z")[0]
    assert equatorial("2024-03-20T12:00:00Z", 86400.0)[0] - start == pytest.approx(0.91, abs=0.02)
    t, epoch = np.array([0.0, 300.0]), "2026-11-22T10:00:00Z"
    theta = gmst(epoch) + OMEGA * t
    one, other = sun_direction(epoch, t, theta), sun_direction(epoch, t, theta + 0.5)
    turn = np.array([[np.cos(0.5), -np.sin(0.5), 0.0], [np.sin(0.5), np.cos(0.5), 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(other, one @ turn.T, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(one, axis=1), 1.0, rtol=1e-12)
