"""Every error of an inertial unit, drawn many times, against its closed form; bounds are five sigma of the estimate."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from pydantic import ValidationError

from lvnav_trade.imu.allan import overlapping
from lvnav_trade.imu.error_model import AccelCard, GyroCard, ImuCard, error_terms, lag
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.jit import array_jit
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.quantities.records import Reference
from lvnav_trade.simulation.imu_sensing import sense
from lvnav_trade.simulation.preparation.imu import imu_truth_of

DEG, HOUR, G = math.pi / 180.0, 3600.0, 9.80665
KEY = seed_words(7)
RATE, FORCE = np.array([0.3, -0.5, 0.8]), np.array([30.0, -4.0, 7.0])  # rad/s, m/s^2
GYRO, ACCEL = slice(0, 3), slice(3, 6)


class Inside(NamedTuple):
    """The part of a run's work arrays that the unit uses."""

    run: np.ndarray
    nav: np.ndarray
    true_par: np.ndarray
    true_tables: np.ndarray
    increments: np.ndarray
    remainder: np.ndarray


@array_jit
def collect(out, work, unit, k0, k1):
    """Fill out (n_run, n_tick, 6) with what the unit puts out in runs 0, 1, ..."""
    for run in range(out.shape[0]):
        work.run[0] = np.uint64(run)
        processes.zero_all(work.true_par)
        work.remainder[:] = 0.0
        processes.start(work.true_par, unit.sigma, unit.sources, k0, k1, work.run[0])
        processes.gather(work.true_tables, work.true_par, unit.sensors, unit.drivers)
        sense(work, None, unit, None, 0, out.shape[1], (k0, k1))
        out[run] = work.increments


def simulate(gyro=None, accel=None, n_run=2000, seconds=2.0, rate=100.0, moving=True, start=0.0, **unit_fields):
    """Return increments (n_run, n_tick, 6) less those of an ideal unit, divided by the tick: errors of the level."""
    card = ImuCard(
        name="x", source="x", rate=f"{rate} Hz", gyro=GyroCard(**(gyro or {})), accel=AccelCard(**(accel or {})),
        **unit_fields,
    )  # fmt: skip
    n, dt = round(seconds * rate), 1.0 / rate
    ideal = dt * np.tile(np.concatenate([RATE, FORCE]) * moving, (n, 1))
    t, none = start + dt * np.arange(n + 1), np.zeros((n + 1, 3))
    dtheta, dvel = (np.ascontiguousarray(ideal[:, at]) for at in (GYRO, ACCEL))
    ref = Reference(t, none, none, np.zeros((n + 1, 4)), none, none, dtheta, dvel)
    blocks = tuple(error_terms(card))
    unit = imu_truth_of(SimpleNamespace(imu=card, faults=()), ref, blocks, {})
    n_true = max(1, len(blocks))
    work = Inside(
        np.zeros(1, dtype=np.uint64),
        np.zeros(10),
        np.zeros((n_true, 3)),
        np.zeros((2, processes.N_TABLE)),
        np.zeros((n, 6)),
        np.zeros(6),
    )
    out = np.empty((n_run, n, 6))
    collect(out, work, unit, *KEY)
    return (out - ideal) / dt


def has_sigma(sample, sigma):
    """Whether a sample of Gaussians has mean zero and standard deviation sigma, within five sigma of each estimate."""
    n = sample.size
    right_mean = abs(np.mean(sample)) < 5.0 * sigma / math.sqrt(n)
    return right_mean and abs(np.std(sample) / sigma - 1.0) < 5.0 / math.sqrt(2.0 * n)


def test_a_card_of_zeros_puts_out_the_increments_of_the_ideal_unit():
    assert np.abs(simulate(n_run=3)).max() < 1e-13


def test_white_noise_integrates_to_a_random_walk_of_the_datasheets_size():
    error = simulate({"random_walk": "0.2 deg/sqrt(h)"}, {"random_walk": "100 ug/sqrt(Hz)"}, seconds=1.0)
    angle, velocity = error[:, :, GYRO].sum(1) * 0.01, error[:, :, ACCEL].sum(1) * 0.01
    assert has_sigma(angle, 0.2 * DEG / 60.0)  # after one second: N sqrt(1 s)
    assert has_sigma(velocity, 100e-6 * G)


def test_the_allan_deviation_of_white_noise_at_one_second_is_its_random_walk():
    error = simulate({"random_walk": "0.2 deg/sqrt(h)"}, {"random_walk": "100 ug/sqrt(Hz)"}, n_run=1, seconds=4000.0)[0]
    levels = error.reshape(4000, 100, 6).mean(axis=1)
    deviation = np.sqrt(0.5 * np.mean(np.diff(levels, axis=0) ** 2, axis=0))
    # 3999 differences, neighbours correlated by -1/2: 3 / (4 n) of relative variance of the deviation, times five
    bound = 5.0 * math.sqrt(0.75 / 3999)
    np.testing.assert_allclose(deviation[GYRO] / (0.2 * DEG / 60.0), 1.0, rtol=0, atol=bound)
    np.testing.assert_allclose(deviation[ACCEL] / (100e-6 * G), 1.0, rtol=0, atol=bound)


def test_white_noise_of_ticks_and_axes_is_uncorrelated():
    error = simulate({"random_walk": "0.2 deg/sqrt(h)"}, {"random_walk": "100 ug/sqrt(Hz)"}, n_run=1, seconds=4000.0)[0]
    n = len(error)
    unit = error / error.std(axis=0)
    assert np.abs(unit.T @ unit / n - np.eye(6)).max() < 5.0 / math.sqrt(n)
    assert np.abs(unit[1:].T @ unit[:-1] / n).max() < 5.0 / math.sqrt(n)


def test_repeatability_is_one_draw_a_run_on_every_axis():
    error = simulate({"bias_repeatability": "3 deg/h"}, {"bias_repeatability": "2 mg"})
    assert np.ptp(error, axis=1).max() < 1e-12
    assert has_sigma(error[:, 0, GYRO], 3.0 * DEG / HOUR)
    assert has_sigma(error[:, 0, ACCEL], 2e-3 * G)
    assert np.abs(np.corrcoef(error[:, 0].T) - np.eye(6)).max() < 5.0 / math.sqrt(2000)


def test_each_axis_has_the_sigma_that_a_list_states_for_it():
    deg_h = [1.0, 5.0, 20.0]
    error = simulate(
        {"bias_repeatability": [f"{one} deg/h" for one in deg_h]},
        {"scale_factor": ["100 ppm", 0, "900 ppm"], "random_walk": [0, "50 ug/sqrt(Hz)", "200 ug/sqrt(Hz)"]},
    )
    for axis, one in enumerate(deg_h):
        assert has_sigma(error[:, 0, axis], one * DEG / HOUR)
    assert has_sigma(error[:, :, 3].mean(axis=1), 100e-6 * FORCE[0])
    noise = math.sqrt(1.0 / (2.0 * 1.0))  # of a mean over 2 s, for a density of one
    assert has_sigma(error[:, :, 4].mean(axis=1), 50e-6 * G * noise)
    assert has_sigma(error[:, :, 5].mean(axis=1), math.hypot(200e-6 * G * noise, 900e-6 * FORCE[2]))


@pytest.mark.parametrize("seconds", [1.0, 4.0])
def test_a_rate_random_walk_grows_with_the_root_of_time(seconds):
    error = simulate(
        {"rate_random_walk": "5 deg/h/sqrt(h)"}, {"rate_random_walk": "1 mg/sqrt(h)"}, seconds=seconds + 0.1
    )
    assert np.abs(error[:, 0]).max() < 1e-12  # it starts from zero, and steps at 10 Hz
    last = error[:, -1]
    assert has_sigma(last[:, GYRO], 5.0 * DEG / HOUR / 60.0 * math.sqrt(seconds))
    assert has_sigma(last[:, ACCEL], 1e-3 * G / 60.0 * math.sqrt(seconds))


def test_bias_instability_is_a_stationary_gauss_markov_process():
    sigma, tau = 2.0 * DEG / HOUR, 3.0
    error = simulate(
        {"bias_instability": "2 deg/h", "instability_time": "3 s"}, n_run=4000, seconds=9.1, moving=False
    )[:, :, 0]  # fmt: skip
    n = error.shape[0]
    for t in (0, 300, 900):
        assert has_sigma(error[:, t], sigma)
    for steps in (1, 10, 30, 90):
        expected = math.exp(-0.1 * steps / tau)
        product = np.mean(error[:, 0] * error[:, 10 * steps]) / sigma**2
        # variance of the mean product of two unit normals of correlation r: (1 + r^2) / n
        assert abs(product - expected) < 5.0 * math.sqrt((1.0 + expected**2) / n)


def test_a_process_that_steps_faster_is_the_same_process():
    for process_rate in ("5 Hz", "50 Hz"):
        error = simulate(
            {"bias_instability": "2 deg/h", "instability_time": "0.5 s", "rate_random_walk": "5 deg/h/sqrt(h)"},
            seconds=1.21, process_rate=process_rate,
        )[:, :, GYRO]  # fmt: skip
        walk = 5.0 * DEG / HOUR / 60.0
        step = 1.0 / float(process_rate.split()[0])
        grown = step * math.floor(1.2 / step + 1e-9)
        assert has_sigma(error[:, 120], math.hypot(2.0 * DEG / HOUR, walk * math.sqrt(grown)))


def test_a_scale_factor_multiplies_the_axis_own_input():
    error = simulate({"scale_factor": "300 ppm"}, {"scale_factor": "1500 ppm"})[:, 0]
    assert has_sigma(error[:, GYRO] / RATE, 300e-6)
    assert has_sigma(error[:, ACCEL] / FORCE, 1500e-6)


def test_scale_factor_drift_is_a_random_walk_of_the_scale_factor():
    error = simulate({"scale_factor_drift": "350 ppm/sqrt(year)"}, seconds=2.05)[:, -1, GYRO]
    assert has_sigma(error / RATE, 350e-6 * math.sqrt(2.0 / (365.25 * 86400.0)))


def test_misalignment_brings_in_the_other_two_axes_each_with_an_angle_of_its_own():
    error = simulate({"misalignment": "0.5 mrad"}, {"misalignment": "2 mrad"})[:, 0]
    for axis in range(3):
        others = [(axis + 1) % 3, (axis + 2) % 3]
        assert has_sigma(error[:, axis], 0.5e-3 * np.linalg.norm(RATE[others]))
        assert has_sigma(error[:, 3 + axis], 2e-3 * np.linalg.norm(FORCE[others]))
    assert np.abs(np.corrcoef(error.T) - np.eye(6)).max() < 5.0 / math.sqrt(2000)


def test_g_sensitivity_turns_specific_force_of_any_axis_into_rate():
    error = simulate({"g_sensitivity": "10 deg/h/g"})[:, 0]
    assert has_sigma(error[:, GYRO], 10.0 * DEG / HOUR / G * np.linalg.norm(FORCE))
    assert np.abs(error[:, ACCEL]).max() < 1e-12


def test_nonlinearity_is_its_fraction_of_the_input_at_full_scale_and_grows_with_the_square():
    error = simulate(
        {"nonlinearity": "100 ppm", "full_scale": "2 rad/s"}, {"nonlinearity": "300 ppm", "full_scale": "30 g"}
    )[:, 0]
    assert has_sigma(error[:, GYRO] / RATE**2, 100e-6 / 2.0)
    assert has_sigma(error[:, ACCEL] / FORCE**2, 300e-6 / (30.0 * G))


@pytest.mark.parametrize(("convention", "floor"), [("coefficient", 0.664 * 3.0), ("floor", 3.0)])
def test_fitted_processes_put_out_the_flat_allan_deviation_of_a_bias_instability(convention, floor):
    fit = {"processes": 4, "shortest": "1 s", "longest": "300 s", "convention": convention}
    card = {"bias_instability": "3 deg/h", "instability_fit": fit}
    error = simulate(card, n_run=12, seconds=4000.0, rate=10.0, moving=False)[:, :, GYRO]
    streams = error.transpose(1, 0, 2).reshape(40_000, -1)
    level = np.sqrt(np.mean(overlapping(streams, 0.1, [20, 60, 200, 600]) ** 2, axis=1))
    # 36 streams of 66 intervals of the longest time: 1.5 % a deviation, and 1 % of the fit
    np.testing.assert_allclose(level, floor * DEG / HOUR, rtol=0.06)


def test_a_fit_is_one_cause_of_several_parts():
    fitted = GyroCard(bias_instability="3 deg/h", instability_fit={"processes": 3})
    plain = GyroCard(bias_instability="3 deg/h", instability_time="30 s")
    blocks = error_terms(ImuCard(name="x", source="x", gyro=fitted, accel=AccelCard()))
    assert [(b.name, b.term_index) for b in blocks] == [("gyro bias instability", k) for k in range(3)]
    (alone,) = error_terms(ImuCard(name="x", source="x", gyro=plain, accel=AccelCard()))
    assert (alone.sigma, alone.time_constant) == (plain.bias_instability, 30.0) == plain.instability
    slowest = fitted.instability_processes[-1]
    one = fitted.instability  # what a bias state of a matched filter has of them
    assert one.sigma == pytest.approx(math.hypot(*(p.sigma for p in fitted.instability_processes)), rel=1e-12)
    drift = [p.sigma * math.sqrt(2.0 / p.time_constant) for p in (one, slowest)]
    assert drift[0] == pytest.approx(drift[1], rel=1e-12)


def test_a_fit_spans_a_decade_or_more():
    with pytest.raises(ValidationError, match="longest averaging time should be ten times the shortest"):
        GyroCard(bias_instability="3 deg/h", instability_fit={"processes": 2, "shortest": "10 s", "longest": "50 s"})


def test_errors_of_different_causes_are_independent():
    error = simulate({"bias_repeatability": "3 deg/h"})[:, 0, GYRO]
    other = simulate({"scale_factor": "300 ppm"})[:, 0, GYRO]
    accel = simulate(None, {"bias_repeatability": "2 mg"})[:, 0, ACCEL]
    for sample in (other, accel):
        assert np.abs(np.corrcoef(error.T, sample.T)[:3, 3:]).max() < 5.0 / math.sqrt(2000)


def test_one_cause_is_drawn_the_same_whatever_else_the_card_names():
    alone = simulate({"bias_repeatability": "3 deg/h"}, n_run=5)
    other = simulate({"scale_factor": "300 ppm", "misalignment": "1 mrad"}, n_run=5)
    both = simulate({"bias_repeatability": "3 deg/h", "scale_factor": "300 ppm", "misalignment": "1 mrad"}, n_run=5)
    np.testing.assert_allclose(both, alone + other, rtol=0, atol=1e-12)


def test_quantisation_puts_out_whole_steps_and_holds_back_at_most_half_of_one():
    step, dt = 1e-4, 0.01
    error = simulate({"quantisation": "0.1 mrad"}, {"quantisation": "3 mm/s"}, n_run=1, seconds=20.0)[0]
    put_out = (error[:, GYRO] + RATE) * dt / step
    # level times tick over step: rounding of numbers of order 100 over 1e-4
    np.testing.assert_allclose(put_out, np.rint(put_out), rtol=0, atol=1e-9)
    held_back = np.cumsum(error, axis=0) * dt
    assert np.abs(held_back[:, GYRO]).max() <= 0.5 * step * (1.0 + 1e-6)
    assert np.abs(held_back[:, ACCEL]).max() <= 0.5 * 3e-3 * (1.0 + 1e-6)


def test_what_quantisation_holds_back_is_uniform_over_a_step_once_noise_stirs_it():
    step = 1e-4
    error = simulate({"quantisation": "0.1 mrad", "random_walk": "0.01 rad/s**0.5"}, n_run=4000, seconds=1.0)
    noise = simulate({"random_walk": "0.01 rad/s**0.5"}, n_run=4000, seconds=1.0)
    held_back = (error - noise).sum(axis=1)[:, GYRO].ravel() * 0.01 / step
    n = held_back.size
    assert abs(np.mean(held_back)) < 5.0 * math.sqrt(1.0 / 12.0 / n)
    # fourth moment of a uniform law: variance of the variance is (1/80 - 1/144) / n
    assert abs(np.var(held_back) - 1.0 / 12.0) < 5.0 * math.sqrt((1.0 / 80.0 - 1.0 / 144.0) / n)


def test_a_temperature_ramp_is_the_same_in_every_run_and_holds_its_end():
    ramp = {"start": "0 s", "end": "2 s", "amplitude": ["10 deg/h", "-5 deg/h", "0 deg/h"]}
    error = simulate({"temperature": ramp}, seconds=4.0, n_run=3, start=-1.0)[:, :, GYRO]
    np.testing.assert_array_equal(error[0], error[2])
    t = -1.0 + 0.1 * (np.arange(40) + 0.5)  # it is taken at the middle of each process step
    expected = np.clip(t / 2.0, 0.0, 1.0)[:, None] * np.array([10.0, -5.0, 0.0]) * DEG / HOUR
    np.testing.assert_allclose(error[0].reshape(40, 10, 3).mean(axis=1), expected, rtol=0, atol=1e-12)


def test_a_settled_input_passes_any_bandwidth_unchanged():
    increments = 0.005 * np.tile([1.0, -2.0, 3.0], (50, 1))
    np.testing.assert_allclose(lag(increments, 10.0, 0.005), increments, rtol=1e-14)
    assert lag(increments, None, 0.005) is increments


def test_a_ramp_comes_late_by_the_time_constant():
    bandwidth, dt = 5.0, 0.001
    t = dt * (np.arange(2000) + 0.5)
    out = lag(np.tile(dt * 3.0 * t[:, None], 3), bandwidth, dt) / dt
    # the input is held over each tick, which shifts a ramp by nothing on average
    np.testing.assert_allclose(out[-1], 3.0 * (t[-1] - 1.0 / (2.0 * math.pi * bandwidth)), rtol=0, atol=1e-9)


def test_a_step_is_followed_exponentially_and_nothing_of_it_is_lost():
    bandwidth, dt = 5.0, 0.002
    tau = 1.0 / (2.0 * math.pi * bandwidth)
    level = np.concatenate([np.zeros(10), np.ones(500)])
    out = lag(dt * np.tile(level[:, None], 3), bandwidth, dt)[:, 0]
    t = dt * np.arange(500 + 1)
    exact = np.diff(t + tau * np.exp(-t / tau))  # integral of 1 - exp(-t / tau) over each tick
    np.testing.assert_allclose(out[10:], exact, rtol=0, atol=1e-15)
    np.testing.assert_allclose(out[:10], 0.0, atol=0)


def test_a_sine_at_the_bandwidth_is_halved_in_power():
    bandwidth, dt = 5.0, 0.0005
    t = dt * np.arange(20001)
    w = 2.0 * math.pi * bandwidth
    increments = np.diff(-np.cos(w * t) / w)
    out = lag(np.tile(increments[:, None], 3), bandwidth, dt)[10000:, 0]
    # holding the input over a tick changes the phase by half a tick, the size by (w dt)^2 / 24
    assert np.std(out) / np.std(increments) == pytest.approx(math.sqrt(0.5), rel=1e-4)


@pytest.mark.parametrize(
    "card", [{"random_walk": 0.2}, {"random_walk": "0.2 deg"}, {"drift": "1 deg/h"}, {"scale_factor": "nan ppm"}]
)
def test_a_number_without_a_unit_a_wrong_unit_and_an_unknown_row_are_refused(card):
    with pytest.raises(ValidationError):
        GyroCard(**card)
