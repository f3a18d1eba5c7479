"""One flight: compiled and interpreted alike, errors defined once, perfect sensors without error."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lvnav_trade.scenario.filter_models import filter_models
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.prepare import prepare
from lvnav_trade.simulation.run_arrays import new_work
from tests.building import INERTIAL, LOOSE, ascent, assumed_receiver, case, hop, loaded, prepare_hop, with_fields

ROOT = Path(__file__).resolve().parents[2]

INTERPRETED = """
import sys
import numpy as np
from lvnav_trade.simulation.montecarlo import run_block
from tests.simulation.test_flight_loop import brief
for kind in sys.argv[2:]:
    block = run_block(brief(kind), 5, 2, 1)
    file = f"{sys.argv[1]}/{kind}.npz"
    np.savez(file, err=block.err, sigma=block.sigma, nees=block.nees, nis=block.nis, z=block.innovation)
"""
FILTERS = ("tight_extended", "loose")


def brief(kind):
    """A flight of three seconds at 50 Hz with every error that a card can name."""
    scenario = loaded(f"base.filter=filters/{kind}")
    imu = with_fields(scenario.imu, rate="50 Hz", **{"gyro.quantisation": "1e-6 rad", "accel.quantisation": "1e-4 m/s"})
    receiver = with_fields(scenario.receiver, lever_b=["1 m", "0.5 m", "-0.3 m"])
    card = with_fields(scenario.filter, gate=2.5)
    scenario = scenario.model_copy(update={"imu": imu, "receiver": receiver, "filter": card})
    return prepare_hop(scenario, hop(2.0, 1.0))


@pytest.fixture(scope="module")
def interpreted(tmp_path_factory):
    """Folder of the runs of all filters in a process whose kernels are not compiled."""
    folder = tmp_path_factory.mktemp("interpreted")
    subprocess.run(
        [sys.executable, "-c", INTERPRETED, str(folder), *FILTERS],
        check=True, cwd=ROOT, timeout=300,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    return folder


@pytest.mark.parametrize("kind", FILTERS)
def test_compiled_and_interpreted_code_fly_the_same_run(kind, interpreted):
    block, other = run_block(brief(kind), 5, 2, 1, uses_lanes=False), np.load(interpreted / f"{kind}.npz")
    # the compiler keeps the order of operations: what may differ is the last bit of a library function
    for name in ("err", "sigma"):
        off = np.abs(getattr(block, name) - other[name]) / block.sigma
        assert off.max() < 1e-8
    np.testing.assert_allclose(other["sigma"], block.sigma, rtol=1e-12)
    np.testing.assert_allclose(other["nis"], block.nis, rtol=1e-6)
    assert np.array_equal(np.isnan(other["z"]), np.isnan(block.innovation))


def scene(settings=()):
    prepared_case = case(*settings)
    work, _ = new_work(prepared_case, uses_lanes=False)
    return prepared_case, work


PERFECT_RECEIVER = {
    "pseudorange_sigma": "0 m", "range_rate_sigma": "0 m/s", "solution.position_sigma": "0 m",
    "solution.velocity_sigma": "0 m/s", "clock.h0": 0.0, "clock.h_minus2": 0.0, "clock.initial_bias": "0 m",
    "clock.initial_drift": "0 m/s",
}  # fmt: skip


def perfect(*settings, lever=(0.0, 0.0, 0.0)):
    """The scenario without any true error; what the filter assumes stays as it was."""
    scenario = loaded(*settings)
    imu = with_fields(scenario.imu, gyro={}, accel={})
    receiver = with_fields(scenario.receiver, lever_b=[f"{x} m" for x in lever], **PERFECT_RECEIVER)
    initial = with_fields(scenario.initial, tilt="0 rad", heading="0 rad", position="0 m", velocity="0 m/s")
    matched = case(*settings)
    model = {
        "imu": _text(matched, "imu"), "receiver": _text(matched, "receiver"), "initial": _text(matched, "initial"),
    }  # fmt: skip
    card = with_fields(scenario.filter, **model)
    return scenario.model_copy(update={"imu": imu, "receiver": receiver, "initial": initial, "filter": card})


def _text(prepared_case, which):
    imu, _, initial = filter_models(prepared_case.scenario)
    return {"imu": imu, "receiver": assumed_receiver(prepared_case.scenario), "initial": initial}[which].model_dump(
        mode="json"
    )


@pytest.mark.parametrize("settings", [(), (LOOSE,), (INERTIAL,)], ids=["tight", "loose", "inertial"])
def test_with_perfect_sensors_and_a_perfect_start_the_estimate_is_the_truth(settings):
    block = run_block(prepare_hop(perfect(*settings)), 1, 0, 1)
    # strapdown at 200 Hz, 4 deg/s of roll and 3 g for 20 s: (rate x tick)^2 / 6 of 600 m/s is below 1e-5 m/s
    assert np.abs(block.err[0, :, 6:9]).max() < 1e-3
    assert np.abs(block.err[0, :, 3:6]).max() < 1e-4
    # the filter turns a velocity residual of 1e-4 m/s into tilt over the 600 m/s gained
    assert np.abs(block.err[0, :, 0:3]).max() < 1e-4 / 600.0


@pytest.mark.slow
@pytest.mark.parametrize("settings", [(), (LOOSE,), (INERTIAL,)], ids=["tight", "loose", "inertial"])
def test_with_perfect_sensors_the_whole_ascent_is_navigated_to_a_centimetre(settings):
    assert ascent().t_hist[-1] > 500.0
    block = run_block(prepare(perfect(*settings)), 1, 0, 1)
    assert np.linalg.norm(block.err[0, :, 6:9], axis=1).max() < 1e-2
