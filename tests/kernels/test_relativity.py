"""Relativistic terms against the broadcast formula and published magnitudes."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.frames import Elements, earth_velocity, ecef_from_eci, state_from_elements
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.relativity import periodic, relativity, shapiro

BROADCAST_F = -4.442807633e-10  # s/m^(1/2), IS-GPS-200


@pytest.fixture(scope="module")
def ephemerides(refdata):
    """Mean anomaly at reference (rad), eccentricity, root of the semi-major axis (m^(1/2)) of a day's records."""
    lines = (refdata / "gnss/rinex2/brdc1820.10n").read_text().splitlines()
    body = lines[next(k for k, line in enumerate(lines) if "END OF HEADER" in line) + 1 :]

    def number(line, column):
        return float(line[3 + 19 * column : 22 + 19 * column].replace("D", "e"))

    rows = [
        (number(body[k + 1], 3), number(body[k + 2], 1), number(body[k + 2], 3)) for k in range(0, len(body) - 7, 8)
    ]
    return np.array(rows)


def eccentric(mean, e):
    E = mean + e * np.sin(mean)
    for _ in range(20):
        E = E - (E - e * np.sin(E) - mean) / (1.0 - e * np.cos(E))
    return E


def test_the_periodic_term_is_that_of_the_broadcast_file(ephemerides, record_property):
    mean, e, root = ephemerides.T
    E = eccentric(mean, e)
    clock = BROADCAST_F * e * root * np.sin(E)  # s, to be added to the satellite's clock offset
    anomaly = np.arctan2(np.sqrt(1.0 - e * e) * np.sin(E), np.cos(E) - e)
    r_i, v_i = state_from_elements(Elements(root**2, e, 0.96 + 0 * e, 1.0 + 0 * e, 0.5 + 0 * e, anomaly))
    ours = periodic(r_i, v_i)
    record_property("periodic term, largest of the file, m", float(np.abs(ours).max()))
    assert len(mean) > 300
    assert np.abs(ours).max() > 5.0
    assert ours == pytest.approx(-SPEED_OF_LIGHT * clock, abs=1e-3)


def test_the_periodic_term_is_the_same_in_both_frames():
    r_i, v_i = np.array([2.0e7, 1.2e7, 1.1e7]), np.array([-1.1e3, 3.0e3, 2.2e3])
    turned = ecef_from_eci(r_i, 0.7), ecef_from_eci(earth_velocity(r_i, v_i), 0.7)
    assert periodic(*turned) == pytest.approx(periodic(r_i, v_i), abs=1e-9)


def test_a_satellite_that_rises_looks_farther_away():
    # Rising, past perigee, its clock has run slow and is behind: the signal seems to have travelled longer.
    assert periodic([2.6e7, 0.0, 0.0], [100.0, 3.9e3, 0.0]) == pytest.approx(2.0 * 2.6e9 / SPEED_OF_LIGHT)


def test_gravity_delays_a_signal_by_two_centimetres():
    # Ashby, Living Reviews in Relativity 6 (2003) 1: "less than 2 cm" at the horizon, at GPS height.
    far, here = np.array([26.56e6, 0.0, 0.0]), np.array([6.378e6, 0.0, 0.0])
    horizon = np.array([6.378e6, np.sqrt(26.56e6**2 - 6.378e6**2), 0.0])
    assert shapiro(far, here) == pytest.approx(8.87e-3 * np.log(26.56 / 6.378), rel=1e-3)
    assert 0.0126 < shapiro(far, here) < shapiro(horizon, here) < 0.02


def test_both_terms_add():
    r_i, v_i, here = np.array([2.0e7, 1.2e7, 1.1e7]), np.array([-1.1e3, 3.0e3, 2.2e3]), np.array([6.4e6, 0.0, 0.0])
    assert relativity(r_i, v_i, here) == periodic(r_i, v_i) + shapiro(r_i, here)
