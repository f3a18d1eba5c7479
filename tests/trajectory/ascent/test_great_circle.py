"""The great circle of a ground track: its start, and its derivatives against differences of positions."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.quantities.frames import ecef_from_geodetic, rotation_e_n
from lvnav_trade.trajectory.ascent.great_circle import circle_coordinates
from lvnav_trade.trajectory.ascent.vehicle_cards import Site

SITE = Site(latitude="-38.6 deg", longitude="-62 deg", height="20 m")
AZIMUTH = 1.1


def test_the_circle_starts_at_the_site_by_the_azimuth():
    latitude, longitude, derivatives = circle_coordinates(SITE, AZIMUTH, np.zeros(1), np.zeros(1))
    assert latitude[0] == pytest.approx(SITE.latitude, abs=1e-14)
    assert longitude[0] == pytest.approx(SITE.longitude, abs=1e-14)
    north, east = derivatives[0]
    assert np.arctan2(east, north) == pytest.approx(AZIMUTH, abs=1e-12)


def test_the_derivatives_are_those_of_the_position():
    psi, height = np.linspace(0.0, 0.4, 5), np.full(5, 1e5)
    step = 1e-5
    latitude, longitude, derivatives = circle_coordinates(SITE, AZIMUTH, psi, height)
    after, before = (
        ecef_from_geodetic(*circle_coordinates(SITE, AZIMUTH, psi + sign * step, height)[:2], height)
        for sign in (1.0, -1.0)
    )
    slope_n = np.einsum("kij,kj->ki", rotation_e_n(latitude, longitude), (after - before) / (2.0 * step))
    assert slope_n[:, :2] == pytest.approx(derivatives, abs=0.01)
    assert slope_n[:, 2] == pytest.approx(0.0, abs=0.01)
