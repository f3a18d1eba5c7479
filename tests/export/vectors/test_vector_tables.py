"""Reference vectors are those of a filter: another one, written apart, agrees from their files alone."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.export.vectors import vector_tables as made
from lvnav_trade.export.vectors.vector_files import _table_content
from lvnav_trade.simulation import montecarlo
from lvnav_trade.simulation.montecarlo import TapedRun
from lvnav_trade.simulation.run_arrays import new_work
from lvnav_trade.simulation.tape import new_tape
from tests.both_engines.covering import DIMENSIONS
from tests.export.cases import prepared_of
from tests.export.vectors.independent import covariance_of, error, state_of, tables_of, transition, updated

TIGHT = {"measurements": "ranges", "correction": "closed"}
SOME = (0, 1, 17, 58)
ROUNDING = 5e-8  # in sigmas; the last digit of a range is 4e-9 m, and processors round a sum of several differently


@pytest.fixture(scope="module")
def found():
    return made.vectors_of(prepared_of(TIGHT), 4, 0)


@pytest.fixture(scope="module")
def stored(found):
    return tables_of({f"{name}.csv": _table_content(table.frame, "csv") for name, table in found.items()})


def _sigma(P):
    return np.sqrt(np.diagonal(P))


def _imu(stored):
    return stored["imu"].iloc[:, 2:].to_numpy(), float(np.diff(stored["imu"].t_s[:2])[0])


def _apart(P, expected):
    return np.abs((P - expected) / np.outer(_sigma(expected), _sigma(expected))).max()


@pytest.mark.parametrize("epoch", SOME)
def test_a_textbook_update_gives_innovations_estimates_and_covariance(stored, epoch, record_property):
    rows, (imu, dt) = stored["estimates"].set_index(["stage", "epoch"]), _imu(stored)
    before, window = state_of(rows.loc[("before", epoch)]), stored["windows"].set_index("epoch").loc[epoch]
    last = int(window.first_tick + window.n_tick) - 1
    rate = (imu[last, :3] - before.bias[:3] * dt) / dt
    P = covariance_of(stored["covariance"], "before", epoch)
    state, P, ratios = updated(before, P, rate, stored, epoch)
    measured = stored["measurements"][stored["measurements"].epoch == epoch]
    after = covariance_of(stored["covariance"], "after", epoch)
    assert len(ratios) == stored["epochs"].n_accepted[epoch] > 8
    apart = error(state_of(rows.loc[("after", epoch)]), state) / _sigma(after)
    record_property(f"innovations of epoch {epoch}", np.abs(ratios - measured.innovation_ratio).max())
    assert ratios == pytest.approx(measured.innovation_ratio, abs=ROUNDING)
    assert np.abs(apart).max() < ROUNDING
    assert _apart(P, after) < ROUNDING
    assert np.abs(error(state, before)).max() > 1e-4  # the update has moved it


@pytest.mark.parametrize("epoch", SOME)
def test_a_strapdown_of_its_own_propagates_to_the_next_epoch(stored, epoch, record_property):
    rows, (imu, dt) = stored["estimates"].set_index(["stage", "epoch"]), _imu(stored)
    windows, model = stored["windows"], stored["model"]
    ends = {k: windows.index[windows.epoch == k][0] for k in (epoch, epoch + 1)}
    state, P = state_of(rows.loc[("after", epoch)]), covariance_of(stored["covariance"], "after", epoch)
    for window in windows.loc[ends[epoch] + 1 : ends[epoch + 1]].itertuples():
        samples = imu[window.first_tick : window.first_tick + window.n_tick]
        state, phi = transition(state, samples, dt)
        half = 0.5 * np.diag(model[model.length == window.length].noise_si)
        P = phi @ (P + half) @ phi.T + half
    expected = covariance_of(stored["covariance"], "before", epoch + 1)
    apart = error(state_of(rows.loc[("before", epoch + 1)]), state) / _sigma(expected)
    record_property(f"propagation from epoch {epoch}, sigma", np.abs(apart).max())
    assert np.abs(apart).max() < 2e-6
    assert _apart(P, expected) < 2e-5


def test_the_start_is_that_of_the_states_table(stored):
    P = covariance_of(stored["covariance"], "start", -1)
    assert _sigma(P) == pytest.approx(stored["states"].initial_sigma_si)
    assert list(stored["covariance"].columns[4:]) == list(stored["states"]["column"])
    first = stored["estimates"].iloc[0]
    assert (first.stage, first.epoch, first.t_s) == ("start", -1, 0.0)
    assert np.linalg.norm(first[[f"quaternion_{part}" for part in "wxyz"]].astype(float)) == pytest.approx(1.0)


def test_a_table_read_from_csv_has_the_numbers_to_the_last_bit(found, stored):
    for name in ("imu", "estimates", "covariance"):
        numbers = found[name].frame.select_dtypes("number")
        np.testing.assert_array_equal(stored[name][numbers.columns].to_numpy(), numbers.to_numpy())


def _level(dimension, word):
    return next(name for name, card in DIMENSIONS[dimension].items() if word in str(card))


@pytest.fixture
def empty(monkeypatch):
    """Let runs have tapes of zeros: no kernel is compiled."""

    def zeros(prepared_case, seed, run):
        work, _ = new_work(prepared_case, uses_lanes=False)
        tape = new_tape(work, len(prepared_case.unit.dtheta), prepared_case.t_epoch.size)
        return TapedRun(tape, work.innovation, work.n_row, work.n_reject)

    monkeypatch.setattr(made, "record_run", zeros)
    assert made.record_run is not montecarlo.record_run


@pytest.mark.parametrize(
    ("levels", "table", "columns"),
    [
        ({"correction": "open"}, "estimates", {"error_velocity_x_m_per_s", "error_gyro_bias_z_rad_per_s"}),
        ({"measurements": _level("measurements", "tdcp")}, "measurements", {"satellite", "variance_si"}),
        ({"measurements": "solution"}, "measurements", {"measured_si", "unit"}),
        ({"measurements": "ranges, star tracker"}, "sensors", {"output_3_si", "earth_angle_rad", "known_3_si"}),
        ({"measurements": "solution", "receiver": "point"}, "reported_covariance", {"c_0_0_si", "c_5_5_si"}),
        ({"measurements": "solution", "latency": "extrapolated"}, "epochs", {"delay_s"}),
    ],
)
def test_tables_describe_the_columns_that_they_have(empty, levels, table, columns):
    found = made.vectors_of(prepared_of(levels), 4, 0)
    assert columns <= set(found[table].frame.columns)
    for one in found.values():
        assert list(one.frame.columns) == list(one.columns)
        assert all(meaning for _, meaning in one.columns.values())
    rows = found["measurements"].frame
    assert set(rows.unit) <= {"m", "m/s", "rad"}
    assert ("satellites" in found) == bool(rows.satellite.any())
    assert ("sensors" in found) == ("rad" in set(rows.unit)) == bool(rows.measured_si.isna().any())
    assert ("reported_covariance" in found) == (levels.get("receiver") == "point")
