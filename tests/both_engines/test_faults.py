"""Every fault acts in both engines, by the same amount, and only while it lasts."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.covariance.history import covariance
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import LOOSE, MATCHED, loaded, prepare_hop, with_fields

RUNS, ALPHA = 400, 1e-3
DURING = {"start": "12 s", "duration": "5 s"}
FAULTS = {
    "noise": {"kind": "degraded_noise", "factor": 5.0, **DURING},
    "bias": {"kind": "range_bias", "size": "30 m", "drift": "1 m/s", **DURING},
    "jump": {"kind": "clock_jump", "start": "14 s", "size": "20 m"},
    "wild": {"kind": "wild_samples", "sigma": "40 m", **DURING},
    "late": {"kind": "latency_change", "by": "20 ms", **DURING},
    "gyro": {"kind": "gyro_bias_step", "size": ["60 deg/h", "0 deg/h", "30 deg/h"], **DURING},
    "accel": {"kind": "accel_bias_step", "size": ["10 mg", "0 mg", "-5 mg"], **DURING},
    "drift": {"kind": "clock_drift", "rate": "0.8 m/s", "start": "12.4 s", "duration": "5 s"},
    "spoofed": {"kind": "spoofing", "velocity": ["0.8 m/s", "-0.6 m/s", "0.4 m/s"], **DURING},
    "gyro scale": {"kind": "gyro_scale_factor_step", "size": ["1 %", "0 %", "-2 %"], **DURING},
    "accel scale": {"kind": "accel_scale_factor_step", "size": ["3000 ppm", "0 ppm", "0 ppm"], **DURING},
    "dead": {"kind": "dead_axis", "sensor": "gyro", "axis": 1, "start": "12 s", "duration": "0.2 s"},
    "stuck": {
        "kind": "dead_axis",
        "sensor": "accelerometer",
        "axis": 1,
        "output": "last",
        "start": "19.8 s",
        "duration": "0.24 s",
    },
    "dropped": {"kind": "dropped_samples", "start": "12 s", "duration": "20 ms", "instead": "last"},
    "outage": {"kind": "satellite_outage", "keep": 2, **DURING},
}


@lru_cache(maxsize=64)
def prepare_case(fault, *settings):
    scenario = loaded(MATCHED, *settings)
    return prepare_hop(with_fields(scenario, faults=[FAULTS[fault]] if fault else []))


@pytest.mark.parametrize("settings", [(), (LOOSE,)], ids=["tight", "loose"])
@pytest.mark.parametrize("fault", FAULTS)
def test_monte_carlo_and_linear_covariance_agree_on_it(fault, settings):
    prepared_case = prepare_case(fault, *settings)
    history, block = covariance(prepared_case), run_block(prepared_case, 3, 0, RUNS)
    at = [int(np.argmin(np.abs(prepared_case.t_hist - t))) for t in (11.0, 13.0, 16.0, 20.0, 30.0)]
    size = history.true_sigma[at, :9]
    # a mean of many sigmas has its own sampling error, and 1 % of it is not linear
    off = np.abs(block.err[:, at, :9].mean(axis=0) - history.mean[at, :9])
    assert np.all(off < 5.0 * size / np.sqrt(RUNS) + 0.01 * np.abs(history.mean[at, :9])), (off / size).round(2)
    tail = ALPHA / 2 / size.size
    low, high = chi2.ppf([tail, 1.0 - tail], RUNS - 1) / (RUNS - 1)
    ratio = block.err[:, at, :9].var(axis=0, ddof=1) / size**2
    assert np.all((ratio > low) & (ratio < high)), ratio.round(2)


@pytest.mark.parametrize("fault", FAULTS)
def test_it_changes_nothing_before_it_begins(fault):
    one, two = (run_block(prepare_case(which), 3, 0, 8) for which in (fault, None))
    before, after = one.t < 12.0 - 1e-9, one.t >= 15.0
    np.testing.assert_array_equal(one.err[:, before], two.err[:, before])
    assert not np.array_equal(one.err[:, after], two.err[:, after])


def test_the_output_is_clipped_at_full_scale_in_both_engines():
    """Closed form: a specific force f along x, clipped at c, leaves f - c; the rest is within the range."""
    scenario = with_fields(loaded(MATCHED, "base.filter=filters/inertial"), **{"imu.accel.full_scale": "29.5 m/s^2"})
    prepared_case = prepare_hop(scenario)
    history, block = covariance(prepared_case), run_block(prepared_case, 3, 0, 80)
    at = int(np.argmin(np.abs(block.t - 10.0)))
    wanted = np.linalg.norm(prepared_case.reference.dvel[:2000] - prepared_case.unit.dvel[:2000], axis=1).sum()
    speed = np.linalg.norm(history.mean[at, 3:6])
    assert speed == pytest.approx(wanted, rel=2e-3)  # the body turns by 10 deg, along its x axis as the force
    assert 3.0 < speed < 5.1
    spread = history.true_sigma[at, 3:6]
    off = np.abs(block.err[:, at, 3:6].mean(axis=0) - history.mean[at, 3:6])
    assert np.all(off < 5.0 * spread / np.sqrt(80) + 0.01 * speed)


@pytest.mark.parametrize(("kind", "state", "own"), [("accel", slice(3, 6), "dvel"), ("gyro", slice(0, 3), "dtheta")])
def test_unaided_a_step_of_scale_factor_errs_by_its_share_of_what_is_sensed(kind, state, own):
    fault = {"kind": f"{kind}_scale_factor_step", "size": ["1000 ppm"] * 3, "start": "5 s", "duration": "20 s"}
    prepared_case = prepare_hop(with_fields(loaded(MATCHED, "base.filter=filters/inertial"), faults=[fault]))
    history = covariance(prepared_case)
    at = int(np.argmin(np.abs(history.t - 9.0)))
    sensed = getattr(prepared_case.reference, own)[1000:1800]  # 5 s to 9 s at 200 Hz, body axes
    wanted = 1e-3 * np.linalg.norm(sensed.sum(axis=0))
    assert np.linalg.norm(history.mean[at, state]) == pytest.approx(wanted, rel=5e-3)


def test_a_frozen_output_holds_the_satellites_and_pulls_the_estimate_behind():
    scenario = with_fields(loaded(MATCHED), faults=[{"kind": "frozen_output", "start": "12 s", "duration": "4 s"}])
    prepared_case = prepare_hop(scenario)
    held = np.flatnonzero(prepared_case.signals.is_frozen)
    assert prepared_case.t_epoch[held].tolist() == [12.0, 13.0, 14.0, 15.0]
    assert np.all(prepared_case.signals.satellite_by_slot[held] == prepared_case.signals.satellite_by_slot[held[0] - 1])
    history, block = covariance(prepared_case), run_block(prepared_case, 3, 0, 80)
    at = int(np.argmin(np.abs(block.t - 15.0)))
    mean = block.err[:, at, 6:9].mean(axis=0)
    assert np.linalg.norm(mean) > 1000.0  # kilometres a second, and the filter assumes what it gets
    np.testing.assert_allclose(mean, history.mean[at, 6:9], rtol=0.02, atol=30.0)


def test_a_disturbance_of_gravity_has_its_line_in_the_budget():
    scenario = with_fields(loaded(MATCHED), gravity={"sigma": "3e-2 m/s^2", "time": "20 s"})
    prepared_case = prepare_hop(scenario)
    history, block = covariance(prepared_case), run_block(prepared_case, 3, 0, RUNS)
    line = history.budget[:, history.sources.index("gravity disturbance")]
    assert line[-1, 3:9].max() > 0.01 * history.true_sigma[-1, 3:9].max() ** 2
    ratio = block.err[:, [20, 30], 3:9].var(axis=0) / history.true_sigma[[20, 30], 3:9] ** 2
    tail = ALPHA / 2 / ratio.size
    low, high = chi2.ppf([tail, 1.0 - tail], RUNS) / RUNS
    assert np.all((ratio > low) & (ratio < high)), ratio.round(2)


def test_unaided_a_constant_disturbance_of_gravity_grows_as_of_a_constant_force():
    """Closed form: a constant error g of gravity gives g t in velocity and g t^2 / 2 in position."""
    scenario = with_fields(
        loaded(MATCHED, "base.filter=filters/inertial"), gravity={"sigma": "1e-3 m/s^2", "time": None}
    )
    history = covariance(prepare_hop(scenario))
    line = history.budget[:, history.sources.index("gravity disturbance")]
    at = int(np.argmin(np.abs(history.t - 10.0)))
    # the gradient of gravitation turns 1.5e-6 t^2 of it
    np.testing.assert_allclose(np.sqrt(line[at, 3:6]), 1e-2, rtol=1e-3)
    np.testing.assert_allclose(np.sqrt(line[at, 6:9]), 5e-2, rtol=1e-3)
