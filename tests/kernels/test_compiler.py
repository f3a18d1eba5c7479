"""Kernels compiled by numba's own classes alone give the same bits."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

FEW = """
import numpy as np
from numba.core.registry import CPUDispatcher
from lvnav_trade.kernels.earth import gravity_j4
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import view

@jit
def step(x):
    x[0] = x[0] * 3.0 + 0.1

@jit
def step_lanes(x):
    step(view(x))

x = np.linspace(0.0, 1.0, 8).reshape(1, 8)
step_lanes(x)
print(type(step) is CPUDispatcher, x.tobytes().hex(), np.array(gravity_j4(4.0e6, 3.0e6, 4.1e6)).tobytes().hex())
"""
WHOLE = """
import hashlib
from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.simulation.preparation.prepare import prepare
from lvnav_trade.simulation.montecarlo import run_block

case = prepare(cases(load("campaigns/demo.yaml"))[-1].scenario, 10.0)
found = covariance(case)
runs = run_block(case, 1, 0, 8)
budget = adjoint(case, float(case.t_hist[-1]))
arrays = (found.true_sigma, found.formal_sigma, found.budget, runs.err, runs.sigma, runs.nis, budget.contribution)
print([hashlib.sha256(array.tobytes()).hexdigest()[:8] for array in arrays])
"""


def said(program: str, folder: Path, plain: bool) -> str:
    root = Path(__file__).resolve().parents[2]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder), "PYTHONPATH": str(root)}
    environment["LVNAV_TRADE_PLAIN_NUMBA"] = str(int(plain))
    (folder / "program.py").write_text(program)  # numba keeps nothing of a program without a file
    command = [sys.executable, str(folder / "program.py")]
    return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=root, check=True).stdout


def test_numba_alone_computes_the_same_numbers_in_a_folder_of_its_own(tmp_path: Path) -> None:
    ours, plain = said(FEW, tmp_path, False).split(), said(FEW, tmp_path, True).split()
    assert (ours[0], plain[0]) == ("False", "True")
    assert ours[1:] == plain[1:]
    assert sum(path.name.startswith("kernels-plain-") for path in tmp_path.iterdir()) == 1


@pytest.mark.slow
def test_numba_alone_flies_the_same_covariance_and_runs(tmp_path: Path) -> None:
    assert said(WHOLE, tmp_path, False) == said(WHOLE, tmp_path, True)
