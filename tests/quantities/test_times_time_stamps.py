"""Time stamps that a file holds in single precision: restored to their grid, or reported with their rounding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.times import restore_time_stamps
from lvnav_trade.trajectory.files.rows import read_rows
from tests.trajectory.tables import card, path, write

TENTHS = 345_600.0 + 0.1 * np.arange(6000)
SIXTIETHS = 1000.0 + np.arange(3000) / 60.0


@pytest.mark.parametrize("meant", [TENTHS, SIXTIETHS, 0.001 * np.arange(9000)], ids=["0.1 s", "1/60 s", "1 ms"])
def test_times_of_single_precision_are_those_of_the_grid_again(meant: np.ndarray) -> None:
    rounded = meant.astype(np.float32).astype(float)
    found = restore_time_stamps(rounded, "s")
    worst = np.max(np.abs(rounded - meant))
    assert np.max(np.abs(found.column - meant)) < 0.02 * worst
    assert found.sigma == 0.0
    assert "single precision" in found.note


def test_so_are_those_that_a_text_file_holds_with_the_digits_of_single_precision() -> None:
    written = np.array([float(str(one)) for one in SIXTIETHS.astype(np.float32)])
    assert np.max(np.abs(restore_time_stamps(written, "s").column - SIXTIETHS)) < 1e-6


@pytest.mark.parametrize(
    "column",
    [TENTHS, SIXTIETHS, np.arange(500.0), np.cumsum(np.arange(1, 900) % 3 + 1) / 128.0, np.arange(3e6, 3e6 + 99.0)],
    ids=["0.1 s", "1/60 s", "seconds", "binary ticks", "milliseconds"],
)
def test_columns_with_all_digits_or_exact_ones_stay_as_they_are(column: np.ndarray) -> None:
    found = restore_time_stamps(column, "s")
    assert found.column is column
    assert (found.note, found.spacing) == ("", 0.0)


def test_a_rounding_that_no_grid_takes_back_is_said_and_makes_the_rows_noisy(tmp_path: Path) -> None:
    t = np.arange(0.0, 80.25, 0.5) + 0.1 * np.sin(np.arange(161))
    r, v = path(np.maximum(t, 0.0))
    columns = dict(zip(("t", "x", "y", "z", "vx", "vy", "vz"), np.column_stack([t, r, v]).T, strict=True))
    columns["t"] = (t + 50_000.0).astype(np.float32).astype(float)
    settings = write(tmp_path, columns, time={"column": "t", "unit": "s", "liftoff": 50_000.0})
    rows = read_rows(card(settings))
    assert [note for note in rows.notes if "0.0039 s apart, fit no grid" in note]
    late = 2.0**-8 / np.sqrt(12.0)
    speed = np.median(np.linalg.norm(v, axis=1))
    assert rows.noise[0] == pytest.approx(speed * late, rel=0.05)
    assert rows.noise[1] > 10.0 * late


def test_a_flight_with_times_of_single_precision_is_that_with_all_digits(tmp_path: Path) -> None:
    settings = write(tmp_path)
    names = ["t", "x", "y", "z", "vx", "vy", "vz"]
    table = np.loadtxt(settings["file"], delimiter=",", skiprows=1)
    file = tmp_path / "mine.parquet"
    shown = {"t": (table[:, 0] * 0.2 + 4000.0).astype(np.float32)}  # steps of 0.1, numbers 2.4e-4 apart
    pq.write_table(pa.table(shown | dict(zip(names[1:], table[:, 1:].T, strict=True))), file)
    time = {"column": "t", "unit": "s", "liftoff": 4000.0}
    quick = {"cutoff": "8 s"}
    rows = read_rows(card({**settings, "file": str(file), "time": time, "events": quick}))
    assert np.max(np.abs(rows.t - 0.2 * table[:, 0])) < 1e-9
    assert [note for note in rows.notes if "are restored to the grid" in note]
    shown["t"] = (table[:, 0] * 0.2 + 9e6).astype(np.float32)  # numbers one apart: rows share them
    pq.write_table(pa.table(shown | dict(zip(names[1:], table[:, 1:].T, strict=True))), file)
    with pytest.raises(InputError, match=r"repeats .* column 't': single precision resolves 1 s here"):
        read_rows(card({**settings, "file": str(file), "time": {**time, "liftoff": 9e6}, "events": {}}))
