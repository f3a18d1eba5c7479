"""The data dictionary: units and meanings."""

from __future__ import annotations

import pyarrow.parquet as pq
import pytest

from lvnav_trade.results.tables.dictionary import SUFFIXES, TABLES, arrow_schema, error_column, unit_at_end, unit_suffix
from lvnav_trade.results.tables.read import load
from tests import synthetic


def test_every_column_of_numbers_names_its_unit(written):
    for file in written.glob("*.parquet"):
        for field in pq.read_schema(file):
            if str(field.type) in ("double", "int64"):
                assert field.name.endswith(tuple(f"_{suffix}" for suffix in SUFFIXES)), f"{file.stem}.{field.name}"


def test_every_row_carries_the_digest_of_its_case(tmp_path):
    tables = load(synthetic.results(tmp_path / "watched", n_run=8, size=8, logic=True))
    # of a vehicle under control or guidance, which this one is not, of a spot check and a stream, not asked for
    absent = {
        "nozzle_travel",
        "nozzle_travel_history",
        "motion_statistics",
        "motion_history",
        "injections",
        "failed_injection_draws",
        "injection_expected",
        "injection_covariances",
        "spot_runs",
        "allan",
        "protection",
        "designs",  # of many
    }
    assert all(getattr(tables, name).empty for name in absent)
    for name in TABLES.keys() - absent:
        assert set(getattr(tables, name).case) == {"aaaaaaaaaaaa", "bbbbbbbbbbbb"}, name


def test_every_column_has_a_meaning():
    for name in TABLES:
        for field in arrow_schema(name):
            assert field.metadata[b"meaning"]


def test_error_columns_are_named_by_quantity_axis_and_unit():
    assert error_column("velocity", "3d", "m/s") == "velocity_3d_error_m_per_s"


@pytest.mark.parametrize(
    ("column", "name", "unit"),
    [
        ("axis_random_walk_rad_per_sqrt_s", "axis_random_walk", "rad/s**0.5"),
        ("axis_accel_random_walk_m_per_s_sqrt_s", "axis_accel_random_walk", "m/s**1.5"),
        ("velocity_m_per_s", "velocity", "m/s"),
        ("axis_accel_bias_m_per_s2", "axis_accel_bias", "m/s**2"),
        ("error_ratio", "error", "dimensionless"),
        ("axis_rate_hz", "axis_rate", "Hz"),
        ("cost", "cost", ""),
    ],
)
def test_a_column_s_unit_is_found_from_its_end(column: str, name: str, unit: str) -> None:
    found = unit_at_end(column)
    assert found[0] == name
    assert unit_suffix(found[1]) == unit_suffix(unit)
