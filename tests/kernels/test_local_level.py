"""Local geographic axes: places against geodetic coordinates, transport rate in closed form, motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.kernels.attitude import matrix
from lvnav_trade.kernels.earth import ECCENTRICITY_2, OMEGA, SEMI_MAJOR
from lvnav_trade.kernels.local_level import (
    ENU,
    NED,
    earth_rate,
    from_local,
    local_axes,
    place_position,
    place_rate,
    to_local,
    transport_rate,
)
from lvnav_trade.quantities.frames import ecef_from_geodetic, rotation_e_n

PLACES = [(-0.68, -1.08, 20.0), (0.0, 0.0, 0.0), (0.9, 3.0, 350e3), (1.5, -3.1, 1e6), (-0.01, 1.6, -50.0)]
SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # north, east, down to east, north, up


def place(latitude, longitude, height):
    normal = [math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude), math.sin(latitude)]
    return (1.0 + height / SEMI_MAJOR) * np.array(normal)


@pytest.mark.parametrize("at", PLACES)
def test_a_place_is_latitude_longitude_and_height(at):
    p = place(*at)
    np.testing.assert_allclose(place_position(*p), ecef_from_geodetic(*at), rtol=0, atol=1e-8)
    C = rotation_e_n(at[0], at[1])
    np.testing.assert_allclose(np.reshape(local_axes(NED, *p), (3, 3)), C, atol=1e-13)
    np.testing.assert_allclose(np.reshape(local_axes(ENU, *p), (3, 3)), SWAP @ C, atol=1e-13)


@pytest.mark.parametrize("code", [NED, ENU])
@pytest.mark.parametrize("at", PLACES)
def test_a_state_turns_into_local_axes_and_back(code, at):
    rng = np.random.default_rng(int(1e3 * abs(at[0])))
    q = rng.normal(size=4)
    nav = np.concatenate([q / np.linalg.norm(q), 1e3 * rng.normal(size=3), ecef_from_geodetic(*at)])
    turned = nav.copy()
    to_local(turned, code, 0, 4, 7)
    np.testing.assert_allclose(turned[7:], place(*at), rtol=0, atol=1e-9 / 6e6 + 3e-16)
    C = rotation_e_n(at[0], at[1])
    C = C if code == NED else SWAP @ C
    np.testing.assert_allclose(turned[4:7], C @ nav[4:7], atol=1e-9)
    attitude = np.reshape(matrix(*nav[:4]), (3, 3))
    np.testing.assert_allclose(np.reshape(matrix(*turned[:4]), (3, 3)), C @ attitude, atol=1e-13)
    from_local(turned, code, 0, 4, 7)
    turned[:4] *= np.sign(turned[:4] @ nav[:4])
    np.testing.assert_allclose(turned, nav, rtol=1e-13, atol=1e-8)


@pytest.mark.parametrize("at", PLACES)
def test_the_transport_rate_is_the_published_one(at):
    """vE / (N + h), -vN / (M + h), -vE tan(latitude) / (N + h), with the radii of the ellipsoid (Groves, eq. 5.44)."""
    latitude, _, height = at
    squash = 1.0 - ECCENTRICITY_2 * math.sin(latitude) ** 2
    prime = SEMI_MAJOR / math.sqrt(squash)
    meridian = SEMI_MAJOR * (1.0 - ECCENTRICITY_2) / squash**1.5
    north, east, down = 3000.0, 5000.0, -800.0
    along = east / (prime + height)
    expected = np.array([along, -north / (meridian + height), -along * math.tan(latitude)])
    p = place(*at)
    np.testing.assert_allclose(transport_rate(NED, *p, north, east, down), expected, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(transport_rate(ENU, *p, east, north, -down), SWAP @ expected, rtol=1e-9, atol=1e-15)
    turn = OMEGA * np.array([math.cos(latitude), 0.0, -math.sin(latitude)])
    np.testing.assert_allclose(earth_rate(NED, *p), turn, rtol=1e-10, atol=1e-18)


@pytest.mark.parametrize("at", PLACES)
def test_a_place_moves_as_its_position_does(at):
    p, v, step = place(*at), np.array([3000.0, 5000.0, -800.0]), 1e-3
    rate = np.array(place_rate(*p, NED, *v))
    ahead, behind = (np.array(place_position(*(p + sign * step * rate))) for sign in (1.0, -1.0))
    C = np.reshape(local_axes(NED, *p), (3, 3))
    np.testing.assert_allclose(C @ (ahead - behind) / (2.0 * step), v, atol=1e-3)
