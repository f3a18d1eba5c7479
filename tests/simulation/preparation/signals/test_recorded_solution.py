"""Recorded errors of a receiver: every run has its recording, and both engines agree on what it does."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.covariance.sources import source_names
from lvnav_trade.gnss.recorded_errors import ErrorTable, inertial_errors, sample_errors
from lvnav_trade.quantities.frames import earth_angle
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.signals.recorded_solution import SOURCE, recording_start
from lvnav_trade.trajectory.flight import motion
from tests.building import LOOSE, MATCHED, hop, loaded, prepare_hop, with_fields

TABLE = {
    "frame": "ned", "time": {"column": "t_s", "unit": "s"}, "position": {"columns": ["n_m", "e_m", "d_m"]},
    "velocity": {"columns": ["vn_m_s", "ve_m_s", "vd_m_s"]}, "outside": "repeat",
}  # fmt: skip
SEED = 7


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A recording of 40 s, 2 Hz: a drifting error of metres and centimetres per second."""
    path, draw = tmp_path_factory.mktemp("recording") / "errors.csv", np.random.default_rng(3)
    walk = np.cumsum(draw.standard_normal((80, 6)), axis=0) * np.array([0.7, 0.7, 1.5, 0.02, 0.02, 0.05])
    lines = [",".join(f"{x:.6f}" for x in (0.5 * k, *row)) for k, row in enumerate(walk - walk[0])]
    path.write_text("\n".join(["t_s,n_m,e_m,d_m,vn_m_s,ve_m_s,vd_m_s", *lines]) + "\n")
    return str(path)


@lru_cache(maxsize=8)
def recorded_case(file, quiet=True, **fields):
    """The short flight with a recording; quiet: hardly any error beside it."""
    scenario = loaded(MATCHED, LOOSE)
    small = {"solution.position_sigma": "1e-6 m", "solution.velocity_sigma": "1e-6 m/s"} if quiet else {}
    receiver = with_fields(scenario.receiver, **{"solution.error_table": {**TABLE, "file": file, **fields}}, **small)
    model = {
        "position_sigma": "3 m", "velocity_sigma": "0.1 m/s", "pseudorange_sigma": "2 m", "range_rate_sigma": "0.1 m/s",
        "clock_h0": 2e-21, "clock_h_minus2": 3e-24,
    }  # fmt: skip
    own = {"tilt": "0.1 deg", "heading": "0.1 deg", "position": "3 m", "velocity": "0.1 m/s", "clock_bias": "1 m",
           "clock_drift": "1 m/s"}  # fmt: skip
    update = {"receiver": receiver, "filter": with_fields(scenario.filter, receiver=model, initial=own)}
    if quiet:
        nothing = {"tilt": "0 deg", "heading": "0 deg", "position": "0 m", "velocity": "0 m/s"}
        update["initial"] = with_fields(scenario.initial, **nothing)
        sensors = {
            f"{sensor}.{name}": f"0 {unit}"
            for sensor, units in (
                ("gyro", ("deg/sqrt(h)", "deg/h", "deg/h/sqrt(h)")),
                ("accel", ("m/s/sqrt(h)", "mg", "mg/sqrt(h)")),
            )
            for name, unit in zip(("random_walk", "bias_repeatability", "rate_random_walk"), units, strict=True)
        }
        noisy = {**sensors, "gyro.bias_instability": "0 deg/h", "accel.bias_instability": "0 mg"}
        update["filter"] = with_fields(update["filter"], imu=IMU_MODEL)
        update["imu"] = with_fields(scenario.imu, **noisy)
    return prepare_hop(scenario.model_copy(update=update))


IMU_MODEL = {
    "gyro_random_walk": "0.05 deg/sqrt(h)", "accel_random_walk": "0.1 mg/sqrt(Hz)", "gyro_bias": "2 deg/h",
    "gyro_bias_walk": "1 deg/h/sqrt(h)", "accel_bias": "3 mg", "accel_bias_walk": "1 mg/sqrt(h)",
}  # fmt: skip


def every_start(prepared_case):
    """The errors (n_start, n_epoch, 6) of each start, frame i, from the rows themselves."""
    card = prepared_case.scenario.receiver.solution.error_table
    assert isinstance(card, ErrorTable)
    r_i = motion(hop(), prepared_case.sky.t).r_i  # the lever arm is zero
    theta = earth_angle(prepared_case.trajectory.theta0, prepared_case.sky.t)
    return inertial_errors(sample_errors(card, prepared_case.sky.t), card.frame, r_i, theta)


def test_mean_and_components_make_every_start_again(file):
    prepared_case = recorded_case(file, starts=9)
    found, n_start = prepared_case.recorded_errors, 9
    assert len(found.errors) == n_start - 1
    shapes = np.array([family.partial for family in found.errors])
    again = found.mean + np.einsum("mec,ms->sec", shapes, found.values)
    np.testing.assert_allclose(again, every_start(prepared_case), atol=1e-9)
    np.testing.assert_allclose(found.values.mean(axis=1), 0.0, atol=1e-9)
    np.testing.assert_allclose(found.values @ found.values.T / n_start, np.eye(n_start - 1), atol=1e-9)


def test_one_start_is_a_mean_and_no_source(file):
    prepared_case = recorded_case(file)
    assert prepared_case.recorded_errors.errors == ()
    assert SOURCE not in source_names(prepared_case)
    np.testing.assert_allclose(prepared_case.recorded_errors.mean, every_start(prepared_case)[0], atol=1e-12)


def test_a_tight_filter_sees_nothing_of_a_solution(file):
    scenario = loaded(MATCHED)
    receiver = with_fields(scenario.receiver, **{"solution.error_table": {**TABLE, "file": file, "starts": 4}})
    prepared_case = prepare_hop(scenario.model_copy(update={"receiver": receiver}))
    assert prepared_case.recorded_errors.errors == ()
    assert np.all(prepared_case.recorded_errors.mean == 0.0)


def test_starts_are_drawn_evenly_by_run_and_seed_alone():
    drawn = np.array([recording_start(SEED, run, 10) for run in range(2000)])
    counts = np.bincount(drawn, minlength=10)
    assert counts.size == 10
    assert np.sum((counts - 200.0) ** 2 / 200.0) < chi2.ppf(0.999, 9)
    assert [recording_start(SEED, run, 10) for run in (5, 3)] == [drawn[5], drawn[3]]
    assert not np.array_equal(drawn[:50], [recording_start(SEED + 1, run, 10) for run in range(50)])


def test_the_same_errors_in_every_run_are_the_mean_of_linear_covariance(file):
    prepared_case = recorded_case(file)
    runs, history = run_block(prepared_case, SEED, 0, 8), covariance(prepared_case)
    assert np.max(np.ptp(runs.err[:, :, 6:9], axis=0)) < 1e-4  # white noise of a micrometre is left
    size = np.linalg.norm(history.mean[-1, 6:9])
    assert size > 1.0
    np.testing.assert_allclose(runs.err.mean(axis=0)[:, 3:9], history.mean[:, 3:9], atol=2e-3 * size)


def test_errors_begun_anywhere_have_the_covariance_that_linear_covariance_gives_their_source(file):
    """Every start is flown, and the average over all starts is the answer: nothing is left to chance."""
    n_start = 6
    prepared_case = recorded_case(file, starts=n_start)
    runs, history = run_block(prepared_case, SEED, 0, 48), covariance(prepared_case)
    drawn = np.array([recording_start(SEED, run, n_start) for run in range(48)])
    assert set(drawn) == set(range(n_start))
    each = np.array([runs.err[drawn == start].mean(axis=0) for start in range(n_start)])
    mean, sigma = each.mean(axis=0), each.std(axis=0)
    np.testing.assert_allclose(mean[:, 6:9], history.mean[:, 6:9], atol=5e-3)
    late = prepared_case.t_hist > 3.0
    np.testing.assert_allclose(history.true_sigma[late, 3:9], sigma[late, 3:9], rtol=5e-3)
    source = history.budget[-1, history.sources.index(SOURCE), 6:9]
    np.testing.assert_allclose(np.sqrt(source), sigma[-1, 6:9], rtol=5e-3)


def test_the_backward_pass_finds_the_same_share(file):
    prepared_case = recorded_case(file, starts=6)
    history, budget = covariance(prepared_case), adjoint(prepared_case, float(prepared_case.t_hist[-1]))
    k = history.sources.index(SOURCE)
    forward = history.budget[-1, k, 6:9]
    np.testing.assert_allclose(budget.contribution[6:9, k].sum(axis=1), forward, rtol=1e-6)


def test_a_run_alone_flies_what_it_flew_in_its_block_of_eight(file):
    prepared_case = recorded_case(file, quiet=False, starts=6)
    block, alone = run_block(prepared_case, SEED, 0, 8), run_block(prepared_case, SEED, 5, 1, uses_lanes=False)
    np.testing.assert_allclose(alone.err[0], block.err[5], atol=1e-6)


def test_a_frozen_output_keeps_its_error(file):
    scenario = loaded(MATCHED, LOOSE)
    receiver = with_fields(scenario.receiver, **{"solution.error_table": {**TABLE, "file": file, "starts": 3}})
    fault = {"kind": "frozen_output", "start": "10 s", "duration": "3 s"}
    text = scenario.model_copy(update={"receiver": receiver}).model_dump(mode="json") | {"faults": [fault]}
    prepared_case = prepare_hop(Scenario.model_validate(text))
    held = np.flatnonzero(prepared_case.signals.is_frozen)
    assert held.size >= 2
    shapes = np.array([family.partial for family in prepared_case.recorded_errors.errors])
    for epoch in held:
        np.testing.assert_array_equal(prepared_case.signals.position[epoch], prepared_case.signals.position[epoch - 1])
        np.testing.assert_array_equal(shapes[:, epoch], shapes[:, epoch - 1])
