"""One small campaign on this machine, and as another processor would compute it: how far the tables differ."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.results.tables.dictionary import TABLES, arrow_schema
from lvnav_trade.results.tables.versions import across_machines

OTHER = {
    "OPENBLAS_CORETYPE": "Haswell",
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX2 FMA3 AVX512F AVX512_SKX",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
}
"""A processor without AVX2 and FMA, for the kernels, OpenBLAS, numpy and the functions of the C library."""


def test_the_manifest_says_it_of_every_table(written):
    said = json.loads((written / "manifest.json").read_text())["across_machines"]
    assert said == across_machines()
    assert set(said["bit_equal"]) ^ set(said["tolerance"]) == set(TABLES)
    for name, columns in said["undetermined"].items():
        assert set(columns) <= {field.name for field in arrow_schema(name) if field.type == "string"}


def computed(root: Path, folder: Path, environment: dict[str, str]) -> Path:
    command = [sys.executable, "-m", "lvnav_trade", "run", "campaigns/smoke.yaml", "--no-report", "--jobs=1"]
    found = subprocess.run(
        [*command, "--out", str(folder)], cwd=root, env={**os.environ, **environment}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr[-3000:]
    return folder


@pytest.mark.slow
def test_another_processor_gives_the_same_numbers_within_what_the_manifest_says(root, tmp_path, record_property):
    here, there = computed(root, tmp_path / "here", {}), computed(root, tmp_path / "there", OTHER)
    said = json.loads((here / "manifest.json").read_text())["across_machines"]
    assert json.loads((there / "manifest.json").read_text())["across_machines"] == said
    names = [{file.stem for file in folder.glob("*.parquet")} for folder in (here, there)]
    assert names[0] == names[1] >= {"history", "runs", "budget"}
    for name in names[0]:
        ours, theirs = (pd.read_parquet(folder / f"{name}.parquet") for folder in (here, there))
        assert ours.shape == theirs.shape
        if name in said["bit_equal"]:
            pd.testing.assert_frame_equal(ours, theirs, check_exact=True)
            continue
        numbers = ours.select_dtypes("float").columns
        rest = [c for c in ours.columns if c not in numbers and c not in said["undetermined"].get(name, ())]
        pd.testing.assert_frame_equal(ours[rest], theirs[rest], check_exact=True)
        shares = [share(ours[column].to_numpy(), theirs[column].to_numpy()) for column in numbers]
        assert max(shares, default=0.0) <= said["tolerance"][name], name
        record_property(f"{name}, largest difference over the size of its column", f"{max(shares, default=0.0):.1e}")


def share(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Return the largest difference as a share of the largest size; infinite where other rows are empty."""
    if not np.array_equal(np.isfinite(ours), np.isfinite(theirs)):
        return np.inf
    ours, theirs = ours[np.isfinite(ours)], theirs[np.isfinite(theirs)]
    largest = np.abs(ours).max(initial=0.0)
    return float(np.abs(ours - theirs).max() / largest) if largest else float(np.abs(theirs).max(initial=0.0))
