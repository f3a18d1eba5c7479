"""The strapdown's algorithm in flight: its error in both engines, at ratios that divide nothing, in every frame."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.prepare import prepare
from tests.building import MATCHED, ascent, loaded

SPINNING = (
    "base.trajectory=trajectories/shefex2_class", "base.imu=imu/navigation_matched", "base.imu.rate=400 Hz",
    "base.filter=filters/inertial", "base.trajectory.apogee=null", "base.trajectory.end_altitude=60 km",
)  # fmt: skip
"""A rocket that spins; its last stage burns along the rail, which is not solved for an apogee."""


QUIET = (
    "base.imu.gyro.random_walk=1e-9 deg/sqrt(h)", "base.imu.accel.random_walk=1e-9 m/s/sqrt(h)",
    "base.imu.gyro.rate_random_walk=0 deg/h/sqrt(h)", "base.imu.accel.rate_random_walk=0 mg/sqrt(h)",
    "base.imu.gyro.bias_repeatability=0 deg/h", "base.imu.accel.bias_repeatability=0 mg",
    "base.initial.tilt=1e-9 deg", "base.initial.heading=1e-9 deg", "base.initial.position=1e-6 m",
    "base.initial.velocity=1e-9 m/s",
)  # fmt: skip


@cache
def spinning(algorithm="two_sample", ratio=1):
    settings = (f"base.filter.strapdown.algorithm={algorithm}", f"base.filter.strapdown.ratio={ratio}")
    return prepare(loaded(*SPINNING, *settings), history=20.0)


@cache
def algorithm_errors(algorithm, ratio):
    """Errors of eight runs less those of the full rate with the same draws, (8, n_hist, 9): the algorithm's own."""
    case, full = spinning(algorithm, ratio), spinning()
    return run_block(case, 4, 0, 8).err[..., :9] - run_block(full, 4, 0, 8).err[..., :9]


def at(case, event):
    return int(np.argmin(np.abs(case.t_hist - case.trajectory.events[event])))


@pytest.mark.parametrize(("algorithm", "ratio"), [("summed", 3), ("summed", 5), ("two_sample", 8), ("optimised", 5)])
def test_the_algorithms_error_is_the_same_in_runs_and_in_the_mean_of_linear_covariance(algorithm, ratio):
    case = spinning(algorithm, ratio)
    own, mean = algorithm_errors(algorithm, ratio), covariance(case).mean - covariance(spinning()).mean
    for event in ("stage1_cutoff", "stage2_cutoff", "apogee", "end"):
        hist = at(case, event)
        for block in (slice(0, 3), slice(3, 6), slice(6, 9)):
            expected, found = mean[hist, block], own[:, hist, block].mean(axis=0)
            left = (1e-6, 2e-3, 0.5)[block.start // 3]  # rad, m/s, m: of the second order
            assert np.linalg.norm(found - expected) < 0.02 * np.linalg.norm(expected) + left


def test_the_full_rate_errs_on_a_body_that_spins_and_is_exact_on_one_that_does_not():
    case = prepare(loaded(*SPINNING, *QUIET), history=20.0)
    mean, errors = covariance(case).mean, run_block(case, 4, 0, 8).err[..., :9]
    hist = at(case, "stage1_cutoff")
    assert np.linalg.norm(mean[hist, 6:9]) > 0.1  # m
    for block in (slice(0, 3), slice(3, 6), slice(6, 9)):
        assert np.allclose(errors[:, hist, block], mean[hist, block], atol=0.02 * np.linalg.norm(mean[hist, block]))
    assert np.array_equal(covariance(spinning()).mean, covariance(spinning("optimised")).mean)  # of one increment
    assert not ascent(MATCHED).model.strapdown.is_error_included


@pytest.mark.parametrize("ratio", [3, 7])
def test_a_ratio_that_divides_no_window_flies_in_whole_steps(ratio):
    case = spinning("optimised", ratio)
    schedule = case.schedule
    assert not np.any(schedule.n_tick % ratio)
    assert schedule.n_tick.sum() == case.reference.dtheta.shape[0] // ratio * ratio
    # covariance steps of 40 ticks lie at the strapdown step nearest to them
    steps = np.rint(np.arange(0, 4000, 40) / ratio).astype(int) * ratio
    assert set(steps) <= {0, *np.cumsum(schedule.n_tick)}
    assert np.all(np.isfinite(run_block(case, 4, 0, 8).err))


def error(algorithm, ratio, event="apogee"):
    """Attitude (rad), velocity (m/s) and position (m) error of an algorithm."""
    own = algorithm_errors(algorithm, ratio)[:, at(spinning(), event)].mean(axis=0)
    return [float(np.linalg.norm(own[block])) for block in (slice(0, 3), slice(3, 6), slice(6, 9))]


def test_a_slower_strapdown_errs_more_and_compensation_eases_it():
    plain = np.array([error("summed", ratio) for ratio in (2, 3, 4, 5)])
    compensated = np.array([error("optimised_present", ratio) for ratio in (2, 3, 4, 5)])
    assert np.all(np.diff(plain, axis=0) > 0.0)
    # velocity and position have the aliases of vibration up to 500 Hz in them, which do not grow step by step
    assert np.all(np.diff(compensated[:, 0]) > 0.0)
    assert np.all(compensated[:, 1:] < 0.5 * plain[:, 1:])
    assert np.all(compensated[:, 0] < 0.1 * plain[:, 0])


def test_the_frame_of_mechanisation_changes_nothing_in_closed_loop():
    runs = {
        frame: run_block(ascent(MATCHED, f"base.filter.mechanisation={frame}"), 3, 0, 8).err
        for frame in ("inertial", "earth", "pad", "ned", "enu")
    }
    for frame in ("earth", "pad", "ned", "enu"):
        assert np.abs(runs[frame][..., 6:9] - runs["inertial"][..., 6:9]).max() < 1e-3  # m, over the ascent
        assert not np.array_equal(runs[frame], runs["inertial"])


def test_linear_covariance_does_not_depend_on_the_frame():
    frames = ("inertial", "earth", "ned")
    inertial, *others = (covariance(ascent(MATCHED, f"base.filter.mechanisation={frame}")) for frame in frames)
    for other in others:
        np.testing.assert_allclose(other.formal_sigma, inertial.formal_sigma, rtol=1e-5)
