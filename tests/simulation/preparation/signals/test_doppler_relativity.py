"""Relativistic term of satellite clocks: closed form, precise orbits, and what a correction leaves in both engines."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.gnss.broadcast import broadcast_ephemerides
from lvnav_trade.gnss.precise import precise_ephemerides, read_positions
from lvnav_trade.gnss.rinex import read_navigation
from lvnav_trade.gnss.satellites import nearest_records
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.earth import GM, OMEGA
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.signals.doppler import clock_term
from tests.building import LOOSE, MATCHED, loaded, prepare_hop, with_fields
from tests.trajectory.products import gps_time

ECCENTRICITY = 0.02
ORBITS = {"constellation.eccentricity": ECCENTRICITY, "constellation.perigee": "40 deg"}
SWITCHES = [(False, False), (True, False), (False, True), (True, True)]


@lru_cache(maxsize=8)
def hop(true: bool, corrected: bool, *settings: str):
    fields = ORBITS | {"constellation.relativity": true, "filter.corrections.relativity": corrected}
    return prepare_hop(with_fields(loaded(MATCHED, *settings), **fields))


def added(true: bool, corrected: bool):
    """Return what ranges and range rates of a case have beyond those without any term, of satellites in use."""
    case, plain = hop(true, corrected), hop(False, False)
    used = np.unique(plain.signals.satellite_by_slot[plain.signals.satellite_by_slot >= 0])
    return [(getattr(case.signals, name) - getattr(plain.signals, name))[:, used] for name in ("range", "rate")], used


def test_the_true_term_is_that_of_the_elements():
    """Range 2 sqrt(GM a) e sin E / c, rate by E' = n / (1 - e cos E): Kepler's equation solved anew, by bisection."""
    (size, rate), used = added(True, False)
    case = hop(True, False)
    card = case.scenario.constellation
    a = card.semi_major_axis
    r, v = case.sky.r_i[:, used], case.sky.v_i[:, used]
    radius = np.linalg.norm(r, axis=-1)
    cosine = (1.0 - radius / a) / ECCENTRICITY  # of E
    sine = np.sum(r * v, axis=-1) / (ECCENTRICITY * np.sqrt(GM * a))
    # the velocity is of an orbit with the secular rates of J2, and by reception time: parts in 1e4
    np.testing.assert_allclose(cosine**2 + sine**2, 1.0, atol=2e-3)
    most = 2.0 * ECCENTRICITY * np.sqrt(GM * a) / SPEED_OF_LIGHT
    assert 13.6 < most < 13.8
    np.testing.assert_allclose(size, most * sine, atol=5e-3)
    slope = most * cosine * np.sqrt(GM / a**3) * a / radius
    np.testing.assert_allclose(rate, slope, atol=2e-6)
    assert np.abs(size).max() > 3.0


def test_position_and_velocity_give_the_term_of_the_elements():
    (size, rate), _ = added(True, True)
    np.testing.assert_allclose(size, 0.0, atol=4e-3)  # secular rates of J2 apart, of 13.7 m
    np.testing.assert_allclose(rate, 0.0, atol=2e-6)
    np.testing.assert_allclose(added(False, True)[0][0], -added(True, False)[0][0], atol=4e-3)


def test_the_correction_agrees_with_broadcast_elements_on_precise_orbits(refdata):
    """Eq. 3.16 on positions and velocities of IGS final orbits, against F e sqrt(A) sin E of the broadcast."""
    time = gps_time(2010, 7, 1, 12, 0, 0)
    records = nearest_records(read_navigation(refdata / "gnss/rinex2/brdc1820.10n").ephemerides, time)
    file = read_positions(refdata / "gnss/sp3/igs15904.sp3")
    names = sorted(set(records) & set(file.r_e))
    above, final = (
        broadcast_ephemerides([records[name] for name in names], time),
        precise_ephemerides([file], names, time),
    )
    t = np.linspace(-1800.0, 1800.0, 7)[:, None]
    r, v = final.ecef(t)
    term = clock_term(r, v + OMEGA * np.stack([-r[..., 1], r[..., 0], 0.0 * r[..., 0]], axis=-1))
    common = [name for name in above.names if name in final.names]
    term = term[:, [final.names.index(name) for name in common]]
    expected = -SPEED_OF_LIGHT * above.relativity(t)[:, [above.names.index(name) for name in common]]
    assert len(common) > 25
    assert np.abs(expected).max() > 10.0
    np.testing.assert_allclose(term[..., 0], expected, atol=0.03)  # elements are fitted to some hours


@pytest.mark.parametrize("settings", [(), (LOOSE,)], ids=["tight", "loose"])
@pytest.mark.parametrize("switches", SWITCHES)
def test_runs_and_linear_covariance_have_the_same_mean_error(switches, settings):
    case = hop(*switches, *settings)
    history, runs = covariance(case), run_block(case, 3, 0, 200)
    at, columns = [10, -1], slice(3, 9)
    off = (runs.err[:, at].mean(axis=0) - history.mean[at])[:, columns] / history.true_sigma[at][:, columns]
    assert np.abs(off).max() * np.sqrt(200) < 4.5
    alike = switches in ((False, False), (True, True))
    shift = np.abs(history.mean[at][:, 6:9]).max()
    assert (shift < 0.02) if alike else (shift > 0.5)


def test_a_circular_constellation_has_no_term():
    with pytest.raises((InputError, ValueError), match="circular orbits have no periodic term"):
        loaded("base.constellation.relativity=true")
