"""The stored flight is that of the engines: the sky where anything is to be seen, states at events and on a grid."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lvnav_trade.quantities.frames import earth_angle, matrices, rotation_i_n
from lvnav_trade.quantities.records import IDLE, LOST
from lvnav_trade.results.mechanics import orbits as meanorbit
from lvnav_trade.results.tables.engine_tables import thresholds
from lvnav_trade.results.tables.flight_tables import STEP, flight_columns, state_columns
from lvnav_trade.results.tables.read import load
from lvnav_trade.simulation.preparation.signals.atmospheric_delays import Delays
from tests import synthetic
from tests.building import ascent

COV = synthetic.covariance()


def test_every_number_stands_in_its_row():
    prepared_case = synthetic.prepared_case()
    table = flight_columns(prepared_case, COV)["satellites"]
    at = 30 * synthetic.N_SAT + 5
    sky, delays = prepared_case.sky, prepared_case.atmospheric_delays
    assert (table["t_s"][at], table["satellite"][at], table["system"][at]) == (31.0, "G06", "G")
    assert (table["antenna_number"][at], table["state"][at]) == (2, "track")
    for column, values in {
        "azimuth_rad": sky.azimuth,
        "elevation_rad": sky.elevation,
        "cn0_db_hz": sky.cn0,
        "range_sigma_m": sky.range_sigma,
        "rate_sigma_m_per_s": sky.rate_sigma,
        "troposphere_m": delays.troposphere[:, :, 0],
        "troposphere_left_m": delays.residual[:, :, 0] - 2.5,
        "ionosphere_m": delays.ionosphere[:, :, 0],
        "ionosphere_left_m": 2.5 + 0.0 * sky.cn0,
    }.items():
        assert table[column][at] == pytest.approx(values[30, 5], abs=1e-12), column
    np.testing.assert_allclose(table["latency_s"][[0, -1]], [0.1, 0.3])


def test_delays_and_noise_are_those_of_measurements_alone(written):
    rows = load(written).satellites
    for column in ("troposphere_m", "ionosphere_left_m", "range_sigma_m"):
        assert (rows[column].isna() == ~rows.tracked).all()


def test_satellites_that_are_down_and_without_a_channel_are_left_out():
    made = synthetic.prepared_case()
    elevation, state, tracked = made.sky.elevation.copy(), made.sky.state.copy(), made.sky.is_tracked.copy()
    elevation[:, :3] = -0.2
    tracked[:, :2] = False
    state[:, 0], state[:, 1] = IDLE, LOST
    sky = made.sky._replace(elevation=elevation, state=state, is_tracked=tracked)
    table = flight_columns(SimpleNamespace(**{**vars(made), "sky": sky}), COV)["satellites"]
    assert set(table["satellite"]) == {f"G{k:02d}" for k in range(2, 9)}


def test_no_epoch_is_lost_where_nothing_is_up():
    made = synthetic.prepared_case()
    nothing = np.zeros_like(made.sky.is_tracked)
    sky = made.sky._replace(
        elevation=made.sky.elevation - 3.0, is_tracked=nothing, state=np.zeros_like(made.sky.state), transitions=()
    )
    tables = flight_columns(
        SimpleNamespace(**{**vars(made), "sky": sky, "atmospheric_delays": Delays(*made.atmospheric_delays)}), COV
    )
    assert len(tables["satellites"]["t_s"]) == synthetic.N_EPOCH
    assert set(tables["satellites"]["satellite"]) == {"G08"}
    assert tables["transitions"] == []


def test_a_fast_receiver_is_stored_once_a_second():
    made = synthetic.prepared_case()
    sky = made.sky._replace(t=made.sky.t / 10.0)
    table = flight_columns(SimpleNamespace(**{**vars(made), "sky": sky}), COV)["satellites"]
    np.testing.assert_allclose(np.unique(np.diff(np.unique(table["t_s"]))), 1.0)


def test_transitions_are_the_receivers(written):
    rows = load(written).transitions
    first = rows[(rows.case == "aaaaaaaaaaaa") & (rows.satellite == "G02")]
    assert list(zip(first.t_s, first.from_state, first.to_state, first.reason, strict=True)) == [
        (1.0, "idle", "track", "tracked from the start"),
        (60.0, "track", "lost", "fault"),
        (75.1, "lost", "search", "search"),
        (75.5, "search", "acquire", "found"),
        (76.0, "acquire", "track", "loops closed"),
    ]


def test_states_stand_at_events_and_on_a_coarse_grid(written):
    rows = load(written).states
    rows = rows[rows.case == "aaaaaaaaaaaa"]
    named = rows[rows.event != ""]
    assert dict(zip(named.event, named.t_s.round(9), strict=True)) == pytest.approx(synthetic.EVENTS)
    np.testing.assert_allclose(rows.t_s[rows.event == ""], np.arange(0.0, 99.0, STEP), atol=1e-9)


def test_a_state_tells_how_the_reporting_axes_lie(written):
    rows = load(written).states
    row = rows[(rows.case == "aaaaaaaaaaaa") & (rows.event == "injection")].iloc[0]
    r_i = row[[f"position_{axis}_m" for axis in "xyz"]].to_numpy(float)
    C_i_n = rotation_i_n(r_i, row.earth_angle_rad)
    np.testing.assert_allclose(
        matrices(row[[f"axes_q{k}_ratio" for k in range(4)]].to_numpy(float)), C_i_n.T, atol=1e-12
    )
    assert row.earth_angle_rad == pytest.approx(float(earth_angle(0.0, row.t_s)))


def orbits(trajectory, rate):
    """Return the osculating and the averaged orbit that the tables have of the injection of a shipped ascent."""
    settings = (f"base.trajectory=trajectories/{trajectory}", f"base.imu.rate={rate}", "base.filter=filters/inertial")
    prepared_case = ascent(*settings)
    n_hist, n = prepared_case.t_hist.size, len(prepared_case.outputs)
    nothing = np.zeros((n_hist, n))
    cov = COV._replace(t=prepared_case.t_hist, mean=nothing, true_cov=np.zeros((n_hist, n, n)),
                       formal_cov=np.zeros((n_hist, n, n)))  # fmt: skip
    found = state_columns(prepared_case, cov)["states"]
    at = found["event"].index("injection")
    r_i, v_i = (np.array([found[f"{name}_{axis}_{unit}"][at] for axis in "xyz"])
                for name, unit in (("position", "m"), ("velocity", "m_per_s")))  # fmt: skip
    assert found["t_s"][at] == prepared_case.trajectory.events["injection"]
    return meanorbit.osculating(r_i, v_i), meanorbit.mean(r_i, v_i)


@pytest.mark.parametrize(
    ("trajectory", "height", "rates"),
    [("two_stage_leo", 350e3, ("50 Hz", "100 Hz", "200 Hz")), ("churchill_sso", 500e3, ("50 Hz", "200 Hz"))],
)
def test_the_true_orbit_at_injection_is_the_target_at_any_rate_of_the_imu(trajectory, height, rates):
    found = [orbits(trajectory, rate) for rate in rates]
    for osculating, averaged in found:
        assert float(osculating.perigee) == pytest.approx(height, abs=1.0)
        assert float(averaged.semi_major_axis) == float(found[0][1].semi_major_axis)


def test_the_joint_covariance_has_the_trace_of_the_history(written):
    tables = load(written)
    rows = tables.joint_covariances.query("case == 'bbbbbbbbbbbb' and event == 'injection'")
    own = rows[rows.component == rows.other_component].set_index("component")
    growth = 3.0 * (1.0 + 0.01 * 99.5)
    velocity = own.true_si2[[f"velocity {axis}" for axis in "xyz"]].sum()
    position = own.formal_si2[[f"position {axis}" for axis in "xyz"]].sum()
    assert velocity == pytest.approx(np.sum((growth * synthetic.SIGMA[3:6]) ** 2), rel=1e-12)
    assert position == pytest.approx(np.sum((growth * synthetic.SIGMA[6:9]) ** 2), rel=1e-12)
    assert len(rows) == 21
    assert np.hypot.reduce(own.mean_si.to_numpy()[:3]) == pytest.approx(growth * 0.05, rel=1e-9)
    assert rows.mean_si.isna().sum() == 15


def test_outputs_without_velocity_leave_the_tables_empty():
    prepared_case = synthetic.prepared_case()
    prepared_case.outputs = synthetic.OUTPUTS[:3]
    found = flight_columns(prepared_case, COV)
    assert found["states"] == found["joint_covariances"] == {}


@pytest.mark.parametrize(("link", "found", "kept"), [(object(), 33.0, 25.0), (None, np.nan, np.nan)])
def test_thresholds_hold_where_there_is_a_link_budget(link, found, kept):
    tracking = SimpleNamespace(acquire_above=33.0, track_above=25.0)
    columns = thresholds(SimpleNamespace(receiver=SimpleNamespace(link=link, tracking=tracking)))
    np.testing.assert_equal(columns, {"acquire_above_db_hz": found, "track_above_db_hz": kept})
