"""The verb cases: designs of results chosen, sorted, written."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq

from lvnav_trade import api
from tests.cli.calling import call


def test_cases_are_listed_by_a_condition_in_an_order(variants: Path) -> None:
    base = str(variants / "base")
    every = call("cases", base)
    assert every.exit_code == 0
    assert every.stdout.splitlines()[-1] == "2 of 2 cases"
    coarse = call("cases", base, "--where", "imu == coarse", "--json")
    content = json.loads(coarse.stdout)
    assert [one["axis_imu"] for one in content["cases"]] == ["coarse"]
    assert content["total"] == 2
    shown = call("cases", base, "--columns", "imu, velocity", "--sort", "-velocity", "--limit", "1").stdout.splitlines()
    assert shown[0].split() == ["axis_imu", "velocity_m_per_s"]
    assert shown[-1] == "2 of 2 cases, 1 of them shown"


def test_units_are_listed_instead(variants: Path) -> None:
    lines = call("cases", str(variants / "base"), "--units").stdout.splitlines()
    assert next(line for line in lines if line.startswith("position_m ")).split()[1] == "metre"


def test_cases_are_written_as_csv_and_parquet_with_units(variants: Path, tmp_path: Path) -> None:
    base = str(variants / "base")
    for name in ("designs.csv", "deep/designs.parquet"):
        assert call("cases", base, "--out", str(tmp_path / name)).stdout.endswith(f"written: {tmp_path / name}\n")
    rows = api.cases(base).rows
    read = pd.read_csv(tmp_path / "designs.csv")
    pd.testing.assert_frame_equal(read, rows, check_dtype=False)
    table = pq.read_table(tmp_path / "deep/designs.parquet")
    pd.testing.assert_frame_equal(table.to_pandas(), rows, check_dtype=False)
    assert table.schema.field("velocity_m_per_s").metadata[b"unit"] == b"metre per second"
    refused = call("cases", base, "--out", str(tmp_path / "designs.xlsx"))
    assert (refused.exit_code, refused.stderr) == (2, f"{tmp_path / 'designs.xlsx'}: should end in .csv or .parquet\n")


def test_what_is_wrong_is_one_line(variants: Path) -> None:
    for options in (["--where", "velocty < 1"], ["--sort", "velocty"], ["--columns", "velocty"], ["--limit", "0"]):
        result = call("cases", str(variants / "base"), *options)
        assert result.exit_code == 2
        assert result.stderr.count("\n") == 1
