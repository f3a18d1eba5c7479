"""Mutants of files of data: trajectories, IMU logs, recorded errors, almanacs, ephemerides."""

from __future__ import annotations

import gzip
import io
import os
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.gnss.almanac import read_almanac
from lvnav_trade.gnss.precise import read_positions
from lvnav_trade.gnss.rinex import read_navigation
from lvnav_trade.quantities.data_file import column_names, read_columns
from lvnav_trade.simulation.recorded.imu_log import read_log
from lvnav_trade.trajectory.files.guesses import guess
from tests.fuzzing.mutants import Outcome, flipped, mutated, outcome_of

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = Path(os.environ.get("LVNAV_REFDATA") or ROOT.parent / "shared" / "refdata")


class Sample(NamedTuple):
    """A file that is mutated: its name, its content, and what reads it."""

    name: str
    content: bytes
    read: Callable[[Path], Any]


def _finite(found: Any) -> None:
    """Hold every number that was read against what is a number."""
    if isinstance(found, float | np.floating):
        assert np.isfinite(found)
    elif isinstance(found, np.ndarray) and found.dtype.kind == "f":
        assert not np.isinf(found).any()
    elif isinstance(found, dict):
        for one in found.values():
            _finite(one)
    elif isinstance(found, tuple | list):
        for one in found:
            _finite(one)


def _table(path: Path) -> None:
    names = column_names(str(path))
    numbers, places = read_columns(str(path), names, ",")
    assert np.isfinite(numbers).all()
    assert len(places) == len(numbers)
    guess(str(path))


def _log(path: Path) -> None:
    found = read_log(str(path))
    _finite(tuple(found))


def _sky(reader: Callable[[Path], Any]) -> Callable[[Path], None]:
    return lambda path: _finite(reader(path))


def _imu_log() -> str:
    rows = np.random.default_rng(1).standard_normal((60, 6)) * 1e-3
    head = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2\n"
    return head + "".join(f"{0.01 * k:.2f},{','.join(f'{value:.6f}' for value in row)}\n" for k, row in enumerate(rows))


def _head(name: str, lines: int, last: str = "") -> bytes:
    """Return the first lines of a reference file; empty where it is absent."""
    path = REFERENCE / "gnss" / name
    if not path.is_file():
        return b""
    content = path.read_bytes()
    if path.suffix == ".gz":
        content = gzip.decompress(content)
    return ("\n".join(content.decode("latin-1").split("\n")[:lines]) + last).encode("latin-1")


def samples() -> list[Sample]:
    """Return the files that are mutated; those made of reference data are left out where it is absent."""
    table = "\n".join((ROOT / "configs/trajectories/example_table.csv").read_text().split("\n")[1:80]) + "\n"
    errors = "\n".join((ROOT / "configs/receivers/l1_recorded.csv").read_text().split("\n")[:60]) + "\n"
    parquet = io.BytesIO()
    pd.read_csv(io.StringIO(table)).to_parquet(parquet, index=False)
    mixed = _head("rinex3/VILL00ESP_R_20181700000_01D_MN.rnx.gz", 120)
    found = [
        Sample("rows.csv", table.encode(), _table),
        Sample("errors.csv", errors.encode(), _table),
        Sample("rows.parquet", parquet.getvalue(), _table),
        Sample("log.csv", _imu_log().encode(), _log),
        Sample("brdc.10n", _head("rinex2/brdc1820.10n", 60), _sky(read_navigation)),
        Sample("mixed.rnx", mixed, _sky(read_navigation)),
        Sample("mixed.rnx.gz", gzip.compress(mixed, mtime=0) if mixed else b"", _sky(read_navigation)),
        Sample("orbits.sp3", _head("sp3/igs15904.sp3", 160, "\nEOF\n"), _sky(read_positions)),
        Sample("yuma.alm", _head("almanac/gps_yuma_wk819_2015.alm", 60), _sky(read_almanac)),
        Sample("sem.al3", _head("almanac/gps_sem_wk387_2007.al3", 40), _sky(read_almanac)),
    ]
    return [one for one in found if one.content]


def try_one(seed: int, folder: Path) -> Outcome:
    """Make the mutant of a seed and read it."""
    draw, every = random.Random(f"data {seed}"), samples_once()
    sample = every[seed % len(every)]
    binary = sample.name.endswith((".gz", ".parquet")) or draw.random() < 0.1
    if binary:
        content, change = flipped(sample.content, draw)
    else:
        text, change = mutated(sample.content.decode("utf-8"), draw)
        content = text.encode("utf-8", errors="replace")
    path = folder / sample.name
    path.write_bytes(content)
    return outcome_of(lambda: sample.read(path), f"{sample.name}: {change}")


_SAMPLES: list[Sample] = []


def samples_once() -> list[Sample]:
    if not _SAMPLES:
        _SAMPLES.extend(samples())
    return _SAMPLES
