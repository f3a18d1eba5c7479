"""Points of impact over a flight, their ellipses, and the corridor."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lvnav_trade.quantities.frames import ecef_from_geodetic
from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.mechanics import stored_states
from lvnav_trade.results.mechanics.free_fall import offsets
from lvnav_trade.results.mission.impact import ellipse
from lvnav_trade.results.tables.read import load
from tests import mission as flights
from tests import synthetic
from tests.results.mechanics.test_mission_errors import falling

INSIDE = "[['28 deg', '17 deg'], ['36 deg', '25 deg'], ['36 deg', '35 deg'], ['28 deg', '35 deg']]"


def with_corridor(polygon, probability=0.9):
    return synthetic.CAMPAIGN + f"corridor: {{polygon: {polygon}, probability: {probability}}}\n"


@pytest.fixture(scope="module")
def fall(tmp_path_factory):
    return load(flights.results(tmp_path_factory.mktemp("fall"), falling(), campaign=with_corridor(INSIDE)))


def test_a_vehicle_that_coasts_keeps_its_point_of_impact(fall):
    """Free fall with J2 is what it flies, so every stored state leads to the same place, at the same instant."""
    found = METRICS["impact"](fall)
    assert len(found) > 15
    assert np.ptp(found.latitude_deg) < 1e-7
    assert np.ptp(found.longitude_deg) < 1e-7
    np.testing.assert_allclose(np.diff(found.t_s + found.fall_s), 0.0, atol=1e-6)
    assert found.t_s.is_monotonic_increasing


def test_runs_have_the_sigma_that_linear_covariance_says(fall):
    row = METRICS["impact"](fall).set_index("event").loc["injection"]
    assert row.runs == 200
    assert row.mc_down_sigma_km / row.down_sigma_km == pytest.approx(1.0, abs=4.0 / np.sqrt(400))
    assert row.mc_cross_sigma_km / row.cross_sigma_km == pytest.approx(1.0, abs=4.0 / np.sqrt(400))
    assert row.down_filter_sigma_km == pytest.approx(row.down_sigma_km, rel=1e-9)


def test_the_ellipse_has_the_covariance_of_down_and_cross_range(fall):
    row = METRICS["impact"](fall).set_index("event").loc["injection"]
    major, minor = row.major_3sigma_km / 3.0, row.minor_3sigma_km / 3.0
    assert major**2 + minor**2 == pytest.approx(row.down_sigma_km**2 + row.cross_sigma_km**2, rel=1e-9)
    area = row.down_sigma_km * row.cross_sigma_km * np.sqrt(1.0 - row.correlation**2)
    assert major * minor == pytest.approx(area, rel=1e-9)
    latitude, longitude = ellipse(SimpleNamespace(**row))
    centre = ecef_from_geodetic(np.radians(row.latitude_deg), np.radians(row.longitude_deg), 0.0)
    outline = ecef_from_geodetic(np.radians(latitude), np.radians(longitude), 0.0)
    off = offsets(np.broadcast_to(centre, outline.shape), outline, np.radians(row.heading_deg)) * 1e-3
    assert np.abs(off[:, 0]).max() == pytest.approx(3.0 * row.down_sigma_km, rel=5e-3)
    assert np.abs(off[:, 1]).max() == pytest.approx(3.0 * row.cross_sigma_km, rel=5e-3)


def test_inside_a_wide_corridor_the_verdict_is_met_by_both(fall):
    found = METRICS["corridor"](fall).iloc[0]
    assert (found.verdict, found.mc_verdict) == ("met", "met")
    assert found.expected_probability == pytest.approx(1.0, abs=1e-12)
    assert found.margin_sigma > 100.0
    assert (found.runs, found.outside) == (200, 0)


def test_beside_a_corridor_the_verdict_is_violated_by_both(tmp_path):
    away = "[['28 deg', '17 deg'], ['36 deg', '17 deg'], ['36 deg', '25 deg']]"
    tables = load(flights.results(tmp_path, falling(), 80, campaign=with_corridor(away)))
    found = METRICS["corridor"](tables).iloc[0]
    assert (found.verdict, found.mc_verdict) == ("violated", "violated")
    assert found.expected_probability == 0.0
    assert found.margin_sigma < 0.0
    assert (found.runs, found.outside) == (80, 80)


def test_an_edge_through_the_error_leaves_the_part_of_the_runs_that_is_said(tmp_path, fall):
    """An edge one sigma of latitude north of the point: 84 % of the assumed points stay south of it."""
    row = METRICS["impact"](fall).set_index("event").loc["injection"]
    sample = np.degrees(ellipse_north(row))
    edge = row.latitude_deg + sample
    polygon = f"[['28 deg', '25 deg'], ['{edge} deg', '25 deg'], ['{edge} deg', '35 deg'], ['28 deg', '35 deg']]"
    tables = load(flights.results(tmp_path, falling(), campaign=with_corridor(polygon)))
    reported = METRICS["impact"](tables).set_index("event").loc["injection"]
    assert 1.0 - reported.mc_outside / reported.runs == pytest.approx(
        reported.corridor_probability, abs=4.0 * np.sqrt(0.14 / 200)
    )
    assert 0.7 < reported.corridor_probability < 0.95


def ellipse_north(row):
    latitude, _ = ellipse(SimpleNamespace(**row), 1.0)
    return np.radians(latitude.max() - row.latitude_deg)


def test_a_gate_that_rejects_too_much_takes_the_verdict_of_linear_covariance_away(tmp_path):
    campaign = with_corridor("[['-5 deg', '-5 deg'], ['5 deg', '-5 deg'], ['5 deg', '5 deg'], ['-5 deg', '5 deg']]")
    tables = load(synthetic.results(tmp_path, n_run=40, campaign=campaign, rejects=0.03))
    found = METRICS["corridor"](tables)
    assert set(found.verdict) == {"not applicable"}
    assert found.reason.iloc[0].startswith("the gate rejects")


def test_an_orbit_has_no_point_of_impact(tmp_path):
    tables = load(flights.results(tmp_path, n_run=0, campaign=with_corridor(INSIDE)))
    assert METRICS["impact"](tables).empty
    found = METRICS["corridor"](tables).iloc[0]
    assert (found.verdict, found.reason) == ("not applicable", "no point of impact in the flight")


def test_without_a_corridor_there_is_no_verdict(good):
    assert METRICS["corridor"](good).empty
    found = METRICS["impact"](good)
    assert found.corridor_probability.isna().all()
    assert np.isfinite(found.down_sigma_km).all()
    assert stored_states.state_at(good, "aaaaaaaaaaaa", "injection").t == pytest.approx(99.5)
