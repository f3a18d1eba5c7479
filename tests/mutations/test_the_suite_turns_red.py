"""The suite itself is tested: a seeded mistake in a copy of the package turns a named test red."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]


class Mutation(NamedTuple):
    """A mistake: in which file, what stands there, what is put in its place, and the test that must find it."""

    file: str
    old: str
    new: str
    found_by: str


OBSERVABLE = "tests/sensors/test_contract.py::test_a_row_is_the_derivative_of_the_predicted_measurement"
MUTATIONS = {
    "lever arm of a range with the wrong sign": Mutation(
        "sensors/ranges.py", "cross(ux, uy, uz, antenna_state[6], antenna_state[7], antenna_state[8])",
        "cross(antenna_state[6], antenna_state[7], antenna_state[8], ux, uy, uz)",
        OBSERVABLE,
    ),
    "lever arm's rate of a range rate with the wrong sign": Mutation(
        "sensors/ranges.py", "cross(ux, uy, uz, antenna_state[9], antenna_state[10], antenna_state[11])",
        "cross(antenna_state[9], antenna_state[10], antenna_state[11], ux, uy, uz)",
        OBSERVABLE,
    ),
    "lever arm of a position with the wrong sign": Mutation(
        "sensors/receiver_solution.py",
        "h[H_ATT + second] = antenna_state[arm + third]",
        "h[H_ATT + second] = -antenna_state[arm + third]",
        OBSERVABLE,
    ),
    "assumed variance four times too large, seen in the numbers": Mutation(
        "simulation/preparation/signals/noise.py", "variance = assumed_sigma(scenario, model, sky, line, name) ** 2",
        "variance = 4.0 * assumed_sigma(scenario, model, sky, line, name) ** 2",
        "tests/simulation/preparation/signals/test_receiver_measurements.py::test_the_variances_of_rows_are_the_squares_of_the_assumed_sigmas",
    ),
    "assumed variance four times too large, seen in the statistics": Mutation(
        "simulation/preparation/signals/noise.py", "variance = assumed_sigma(scenario, model, sky, line, name) ** 2",
        "variance = 4.0 * assumed_sigma(scenario, model, sky, line, name) ** 2",
        "tests/simulation/test_montecarlo.py::test_a_matched_filter_is_consistent",
    ),
    "weight of a row its variance instead of the inverse": Mutation(
        "kernels/covariance.py",
        "weight = where(is_accepted, inverse, 0.0)\n    step",
        "weight = where(is_accepted, s, 0.0)\n    step",
        "tests/kernels/test_covariance.py::test_a_row_is_the_update_of_kalman",
    ),
    "residual that forgets what earlier rows have moved": Mutation(
        "kernels/covariance.py", "residual = residual - entry * x[state]", "residual = residual + 0.0",
        "tests/kernels/test_covariance.py::test_rows_of_an_epoch_may_come_in_any_order",
    ),
    "time constant of the truth twice too long": Mutation(
        "simulation/preparation/imu.py", "math.exp(-step / term.time_constant)",
        "math.exp(-0.5 * step / term.time_constant)",
        "tests/imu/test_error_model.py::test_bias_instability_is_a_stationary_gauss_markov_process",
    ),
    "noise of a Gauss-Markov process scaled wrongly": Mutation(
        "simulation/preparation/imu.py", "expm1(-2.0 * step / term.time_constant)", "expm1(-step / term.time_constant)",
        "tests/imu/test_error_model.py::test_bias_instability_is_a_stationary_gauss_markov_process",
    ),
    "noise of the filter's Gauss-Markov state scaled wrongly": Mutation(
        "filter/model.py", "2.0 * axis_squares(sigma) * np.tanh", "axis_squares(sigma) * np.tanh",
        "tests/filter/test_model.py::test_a_gauss_markov_state_keeps_its_sigma_whatever_the_window",
    ),
    "measurement tagged half a tick early": Mutation(
        "simulation/preparation/signals/lines_of_sight.py", "vehicle = motion(trajectory, sky.t)",
        "vehicle = motion(trajectory, sky.t - 0.0025)",
        "tests/simulation/preparation/test_prepare.py::test_measurements_are_taken_on_ticks_where_the_increments_end",
    ),
    "attitude correction with the wrong sign": Mutation(
        "kernels/transition.py", "from_rotation(x[ATT], x[ATT + 1], x[ATT + 2])",
        "from_rotation(-x[ATT], -x[ATT + 1], -x[ATT + 2])",
        "tests/simulation/test_recording.py::test_an_error_that_is_injected_computed_and_fed_back_leaves_nothing",
    ),
    "true parameters that start without correlation to the filter's error": Mutation(
        "covariance/components.py", "cross[source, slot, states] += variance", "cross[source, slot, states] += 0.0",
        "tests/covariance/test_components.py"
        "::test_the_estimate_starts_at_zero_so_error_and_component_are_the_same_thing",
    ),
    "true errors that do not start in the filter's parameters at all": Mutation(
        "covariance/components.py", "sources[source, states[:, None], states] += variance",
        "sources[source, states[:, None], states] += 0.0",
        "tests/covariance/test_history.py::test_a_matched_filter_knows_its_own_error",
    ),
    "true covariance updated as if every gain were optimal": Mutation(
        "kernels/covariance.py", "- gain[i] * work[j] - work[i] * gain[j] + gain[i] * total * gain[j]",
        "- gain[i] * work[j]",
        "tests/kernels/test_joint.py::test_the_true_update_is_josephs_form_for_any_gain",
    ),
    "coning with the wrong sign": Mutation(
        "kernels/strapdown.py", "from_rotation(wx + coning_x,", "from_rotation(wx - coning_x,",
        "tests/kernels/test_strapdown.py::test_coning_drifts_as_the_closed_form_says",
    ),
    "thrust that turns the velocity error the wrong way": Mutation(
        "kernels/transition.py", "_skew(block, -sums[SUM_V], -sums[SUM_V + 1], -sums[SUM_V + 2])",
        "_skew(block, sums[SUM_V], sums[SUM_V + 1], sums[SUM_V + 2])",
        "tests/kernels/test_transition.py::test_a_block_is_the_difference_of_the_nonlinear_strapdown",
    ),
    "two satellites with the same noise": Mutation(
        "kernels/random.py", "word_like(run, index)", "word_like(run, epoch)",
        "tests/kernels/test_random.py::test_streams_of_another_source_epoch_satellite_run_or_seed_are_uncorrelated",
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy of what the tests need, and a cache of kernels that the mutations share where they may."""
    folder = tmp_path_factory.mktemp("mutated")
    for name in ("lvnav_trade", "tests", "configs", "campaigns"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", "mutations"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


def run(copy, test):
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--no-header", test],
        cwd=copy, capture_output=True, text=True, timeout=900, check=False,
        env={**os.environ, "PYTHONPATH": str(copy), "NUMBA_CACHE_DIR": str(copy / "cache")},
    )  # fmt: skip


def test_every_mistake_fits_the_source_once_and_names_a_test():
    for name, mutation in MUTATIONS.items():
        source = (ROOT / "lvnav_trade" / mutation.file).read_text(encoding="utf-8")
        assert source.count(mutation.old) == 1, name
        file, test = mutation.found_by.split("::")
        assert f"def {test}(" in (ROOT / file).read_text(encoding="utf-8"), name


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTATIONS)
def test_a_seeded_mistake_turns_its_named_test_red(copy, name):
    mutation = MUTATIONS[name]
    file = copy / "lvnav_trade" / mutation.file
    before = file.read_text(encoding="utf-8")
    assert before.count(mutation.old) == 1, "the mutation no longer fits the source"
    file.write_text(before.replace(mutation.old, mutation.new), encoding="utf-8")
    try:
        finished = run(copy, mutation.found_by)
    finally:
        file.write_text(before, encoding="utf-8")
    assert f"FAILED {mutation.found_by}" in finished.stdout, finished.stdout[-2000:]
    assert finished.returncode == pytest.ExitCode.TESTS_FAILED


@pytest.mark.slow
def test_the_copy_without_a_mistake_is_green(copy):
    """Otherwise a broken copy would pass for a mistake found."""
    kernels = {m.found_by for m in MUTATIONS.values() if "/engines/" not in m.found_by}
    for test in sorted(kernels):
        assert run(copy, test).returncode == pytest.ExitCode.OK
