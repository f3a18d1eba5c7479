"""Two filters in a row, linearly, against the compiled receiver and against runs."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.filter.receivers.bancroft import fix
from lvnav_trade.filter.receivers.ekf_gnss import step
from lvnav_trade.filter.receivers.error_propagation import (
    SOLUTION,
    design_matrix,
    filter_epoch,
    filter_start,
    mismatch,
    noise_covariances,
    nominal_acceleration,
    point_gain,
    reported_covariance,
)
from lvnav_trade.filter.receivers.receiver import (
    FilterSettings,
    ReportedCovariance,
    new_receiver,
    point_model,
    receiver_filter,
    switch_on,
)
from tests.filter.receivers.dense import Outer, propagate
from tests.filter.receivers.scenes import ascending, clocks, errors, filter_runs, measure, scene, standing, true_ranges

POINT = point_model(ReportedCovariance(), 2.0, 0.1)


def model(factor=1.0, **changes):
    settings = {"range_sigma": 4.0, "rate_sigma": 0.2, "drive_sigma": 1.0, "clock_noise": 0.005}
    return receiver_filter(
        ReportedCovariance(factor=factor), 1.0, FilterSettings(start_acceleration=10.0, **(settings | changes))
    )


ADAPTED = {"range_sigma": 2.0, "rate_sigma": 0.1, "drive_sigma": 0.5,
           "drive_gain": 0.01, "range_gain": 1.0, "rate_gain": 0.01}  # fmt: skip


def gains_of(at, settings):
    """Gains of all epochs on the nominal motion."""
    found, slope = [], nominal_acceleration(at.v_i, at.n_used >= 4, 1.0)
    for k in range(len(at.t)):
        use = at.used[k, : at.n_used[k]]
        rows = design_matrix(at.r_i[k], at.v_i[k], at.satellite[k, use], at.moving[k, use])
        found.append(filter_epoch(found[-1].P, settings, rows, slope[k]) if k else filter_start(settings, POINT, rows))
    return found


def kernel(at, z, settings):
    receiver = new_receiver()
    switch_on(receiver, *at.r_i[0])
    for k in range(len(at.t)):
        step(receiver, settings, POINT, at.satellite[k], at.moving[k], at.used[k], at.n_used[k], z[k])
    return receiver


def test_the_gain_of_the_point_solution_is_its_derivative():
    at = scene(np.zeros(1), standing, n_sat=6)
    z, receiver = true_ranges(at)[0], new_receiver()

    def solve(change):
        receiver.position_guess[:] = at.r_i[0]
        fix(receiver, POINT, at.satellite[0], at.moving[0], at.used[0], 6, z + change.reshape(6, 2))
        return receiver.fix.copy()

    # ranges by metres, rates by decimetres a second: position is rounded to 1e-9 m
    steps = np.diag(np.tile([1.0, 0.1], 6))
    derivative = np.array([(solve(h) - solve(-h)) / (2.0 * h.max()) for h in steps]).T
    gain = point_gain(design_matrix(at.r_i[0], at.v_i[0], at.satellite[0], at.moving[0]))
    np.testing.assert_allclose(gain, derivative, rtol=0, atol=2e-7)
    assert np.abs(gain[3:6, 0::2]).max() > 1e-5  # a wrong position turns the lines of sight of the rates


@pytest.mark.parametrize("settings", [model(), model(**ADAPTED)])
def test_gains_and_covariance_are_those_of_the_compiled_filter(settings):
    """Without noise, after an antenna failure; the gain by moving one measurement of the last epoch."""
    at = scene(np.arange(0.0, 30.0), ascending, seen=[8] * 10 + [3] * 10 + [7] * 10)
    z, gains = true_ranges(at), gains_of(at, settings)
    receiver = kernel(at, z, settings)
    scale = np.sqrt(np.diag(gains[-1].P))
    # the filter linearises where it takes itself to be; during the failure that is some ten metres off
    np.testing.assert_allclose(
        receiver.P / np.outer(scale, scale), gains[-1].P / np.outer(scale, scale), rtol=0, atol=1e-5
    )
    np.testing.assert_allclose(
        reported_covariance(settings.reported_covariance, gains[-1].P), receiver.covariance, rtol=0, atol=1e-4
    )
    if settings.drive_gain == 0.0:  # else the fix moves the noise as well
        for slot, column, size in ((0, 0, 5.0), (3, 1, 0.5)):
            moved = z.copy()
            moved[-1, slot, column] += size
            response = (kernel(at, moved, settings).nav - receiver.nav) / size
            np.testing.assert_allclose(response, gains[-1].gain[:, 2 * slot + column], rtol=0, atol=1e-5)


def test_the_nominal_acceleration_stands_while_there_is_no_fix_and_then_spans_the_gap():
    velocity = np.zeros((7, 3))
    velocity[:, 0] = [0.0, 1.0, 3.0, 6.0, 10.0, 15.0, 21.0]
    fixed = np.array([False, True, True, False, False, True, True])
    found = nominal_acceleration(velocity, fixed, 0.5)
    np.testing.assert_allclose(found[:, 0], [0.0, 0.0, 4.0, 4.0, 4.0, 8.0, 12.0])
    np.testing.assert_array_equal(found[:, 1:], 0.0)


def test_adapted_noise_is_evaluated_on_the_nominal_acceleration():
    settings = model(**ADAPTED)
    noise, variance = noise_covariances(settings, np.array([30.0, 0.0, 0.0]), 4)
    assert np.diag(noise)[:3] == pytest.approx([9.0, 0.25, 0.25])
    assert variance == pytest.approx([30.0, 0.3, 30.0, 0.3])


N_RUN, N_EPOCH = 4000, 100
WALK = 0.05  # m/s per root second: the accelerometer of a toy unit


def outer():
    """Position and velocity on three axes, driven by white noise of acceleration: an inertial unit that never turns."""
    eye, zero = np.eye(3), np.zeros((3, 3))
    noise = WALK**2 * np.block([[eye / 3.0, eye / 2.0], [eye / 2.0, eye]])
    return Outer(np.block([[eye, eye], [zero, eye]]), noise, noise, np.eye(6))


START = np.diag([100.0] * 3 + [1.0] * 3)


def shared_errors(n_sat):
    """A Gauss-Markov error of every satellite's range: covariance, decay, partials."""
    partial = np.zeros((2 * n_sat, n_sat))
    partial[range(0, 2 * n_sat, 2), range(n_sat)] = 1.0
    return 1.5**2 * np.eye(n_sat), np.full(n_sat, np.exp(-1.0 / 60.0)), partial


def predicted(at, settings):
    n_sat = at.satellite.shape[1]
    shared, decay, partial = shared_errors(n_sat)
    used = [at.used[k, : at.n_used[k]] for k in range(len(at.t))]
    partials = [partial[np.stack([2 * use, 2 * use + 1], axis=1).ravel()] for use in used]
    pushes = mismatch(settings, np.gradient(at.v_i, axis=0), at.v_i, at.r_i)
    clock = 0.005**2 * np.array([[0.25, 0.5], [0.5, 1.0]])
    variances = [np.tile([4.0, 0.01], len(use)) for use in used]
    return propagate(
        gains_of(at, settings), pushes, clock, variances, settings, outer(), START, shared, decay, partials
    )  # fmt: skip


def runs(at, settings, n_run=N_RUN):
    """Errors (n_epoch, 12, n_run) of the navigation filter and of the receiver's solution, by the compiled receiver."""
    rng, n_sat, n = np.random.default_rng(21), at.satellite.shape[1], len(at.t)
    _, decay, _ = shared_errors(n_sat)
    z, bias = measure(at, clocks(rng, n, n_run, 1.0), rng), 1.5 * rng.standard_normal((n_sat, n_run))
    for k in range(n):
        z[k, :, 0] += bias
        bias = decay[:, None] * bias + 1.5 * np.sqrt(1.0 - decay[0] ** 2) * rng.standard_normal(bias.shape)
    solution = errors(at, filter_runs(at, settings, POINT, z)[0])
    filter_, gains = outer(), gains_of(at, settings)
    drive, P = np.linalg.cholesky(filter_.noise), START.copy()
    e, found = np.linalg.cholesky(START) @ rng.standard_normal((6, n_run)), np.empty((n, 12, n_run))
    for k in range(n):
        if k:
            e = filter_.phi @ e + drive @ rng.standard_normal((6, n_run))
            P = filter_.phi @ P @ filter_.phi.T + filter_.assumed
        reported = reported_covariance(settings.reported_covariance, gains[k].P)
        gain = P @ np.linalg.inv(P + reported)
        e = e - gain @ (e - solution[k])
        P = P - gain @ P
        found[k, :6], found[k, 6:] = e, solution[k]
    return found


@pytest.mark.parametrize("factor", [1.0, 10.0])
def test_the_joint_covariance_is_that_of_many_runs(factor, record_property):
    """Errors of both filters together, at epochs of the pad, of ascent and after a failure, in their own axes."""
    seen = np.full(N_EPOCH, 8)
    seen[60:75] = 3
    at, settings = scene(np.arange(-20.0, N_EPOCH - 20.0), ascending, seen=seen), model(factor)
    history, sample = predicted(at, settings), runs(at, settings)
    which = np.array([*range(6), *(6 + SOLUTION)])
    for k in (1, 19, 50, 74, N_EPOCH - 1):
        C, mean = history.covariance[k][np.ix_(which, which)], history.mean[k][which]
        root = np.linalg.inv(np.linalg.cholesky(C))
        white = root @ (sample[k] - mean[:, None])
        ratio = np.cov(white)
        assert np.abs(np.diag(ratio) - 1.0).max() < 4.5 * np.sqrt(2.0 / N_RUN)
        assert np.abs(ratio - np.diag(np.diag(ratio))).max() < 4.5 / np.sqrt(N_RUN)
        assert np.abs(white.mean(axis=1)).max() < 4.5 / np.sqrt(N_RUN)
    sigma = np.sqrt(np.diagonal(history.covariance[-1])[:6])
    shortcut = np.sqrt(np.diagonal(history.white[-1]))
    formal = np.sqrt(np.diagonal(history.formal[-1]))
    record_property(f"factor {factor:g}: true sigma, as white noise, formal",
                    [np.round(x, 3).tolist() for x in (sigma, shortcut, formal)])  # fmt: skip
    assert np.all(shortcut[:3] < 0.9 * sigma[:3])


def test_adaptation_by_noisy_fixes_changes_little_of_what_the_nominal_acceleration_predicts(record_property):
    at, settings = scene(np.arange(-20.0, 60.0), ascending), model(10.0, **ADAPTED)
    history, sample = predicted(at, settings), runs(at, settings, 800)
    ratio = sample[-1, 6:].std(axis=1) / np.sqrt(np.diagonal(history.covariance[-1])[6 + SOLUTION])
    record_property("receiver's sigma by runs over the nominal one, adapted", ratio.round(3).tolist())
    assert np.all(np.abs(ratio - 1.0) < 0.15)


def test_with_a_white_solution_the_shortcut_is_exact():
    """A receiver that keeps nothing of the epoch before, and ranges without shared errors."""
    at, settings = scene(np.arange(0.0, 20.0), standing), model()
    rows = [design_matrix(at.r_i[k], at.v_i[k], at.satellite[k], at.moving[k]) for k in range(20)]
    epochs = [filter_start(settings, POINT, row) for row in rows]
    nothing = np.zeros((0, 0))
    history = propagate(
        epochs, np.zeros((20, 11)), np.zeros((2, 2)), [np.tile([4.0, 0.01], 8)] * 20, settings, outer(), START, nothing,
        np.zeros(0), [np.zeros((16, 0))] * 20,
    )  # fmt: skip
    np.testing.assert_allclose(history.covariance[:, :6, :6], history.white, rtol=0, atol=1e-9)
    # and the navigation filter, reported the truth but for the turning of lines of sight by a wrong position, knows it
    scale = np.sqrt(np.diagonal(history.white[-1]))
    np.testing.assert_allclose(
        history.formal[-1] / np.outer(scale, scale), history.white[-1] / np.outer(scale, scale), rtol=0, atol=0.005
    )
