"""The data dictionary: units and meanings."""

from __future__ import annotations

import pyarrow.parquet as pq

from lvnav_trade.store.read import load
from lvnav_trade.store.schema import SUFFIXES, TABLES, arrow_schema, error_column
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
        "nozzle",
        "movement",
        "turning",
        "motion",
        "injections",
        "injection_budget",
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
