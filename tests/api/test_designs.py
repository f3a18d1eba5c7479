"""Cases of results from Python: the same table everywhere."""

from __future__ import annotations

import pandas as pd
import pytest

import lvnav_trade
from lvnav_trade import api
from lvnav_trade.quantities.errors import InputError
from tests import synthetic


def test_cases_are_the_table_that_results_have(tmp_path) -> None:
    folder = synthetic.results(tmp_path, n_run=8)
    found = api.cases(folder)
    pd.testing.assert_frame_equal(lvnav_trade.load(folder).cases, found.rows)
    assert found.rows.attrs["units"]["velocity_m_per_s"] == "m/s"
    assert "2 of 2 cases" in str(found)
    assert list(found.columns.column) == list(found.rows.columns)


def test_cases_are_chosen_sorted_and_reduced_to_columns(tmp_path) -> None:
    folder = synthetic.results(tmp_path, n_run=8)
    found = api.cases(folder, ["velocity > 0"], ["-velocity"], ["imu", "velocity"])
    assert list(found.rows.columns) == ["axis_imu", "velocity_m_per_s"]
    assert list(found.rows.axis_imu) == ["coarse", "fine"]
    with pytest.raises(InputError, match="no column 'velocty'"):
        api.cases(folder, columns=["velocty"])
