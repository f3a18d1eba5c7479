"""States and joint covariances are those of the flight, at events and on a coarse grid."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.frames import earth_angle, matrices, rotation_i_n
from lvnav_trade.store import load
from lvnav_trade.store.states import STEP, state_tables
from tests import synthetic


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


def test_the_joint_covariance_has_the_trace_of_the_history(written):
    tables = load(written)
    rows = tables.joint[(tables.joint.case == "bbbbbbbbbbbb") & (tables.joint.event == "injection")]
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
    prepared = synthetic.prepared()
    prepared.outputs = synthetic.OUTPUTS[:3]
    found = state_tables(prepared, synthetic.covariance())
    assert all(column == [] for table in found.values() for column in table.values())
