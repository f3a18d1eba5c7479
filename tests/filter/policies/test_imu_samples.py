"""Samples of the IMU as measurements in flight: lanes and one run, closed form, no noise, the baseline as a limit."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from lvnav_trade.filter.policies import imu_samples as samples
from lvnav_trade.filter.policies.epoch_differences import DifferenceProcessing, new_previous_epoch
from lvnav_trade.kernels.transition import POS
from lvnav_trade.quantities.shared_cards import steady_ratio
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.recording import N_SAMPLE_OUTPUT
from lvnav_trade.trajectory.guided.axis import filter_gain
from tests.both_engines.modelled import BASELINE, MODEL, UNKNOWN, modelled

SEED = 20261121


def columns(prepared_case, quantity):
    return [i for i, output in enumerate(prepared_case.outputs) if output.quantity == quantity]


@pytest.fixture(scope="module")
def runs():
    return run_block(modelled(), SEED, 0, 64)


def test_outputs_are_24_states_and_the_samples_beside_them(runs):
    prepared_case = modelled()
    assert prepared_case.layout.n_state == prepared_case.layout.n_estimated == 24
    assert len(prepared_case.outputs) == 24 + N_SAMPLE_OUTPUT == runs.err.shape[2]
    assert not runs.failed.any()


@pytest.mark.slow  # the kernel of one run by itself
@pytest.mark.parametrize("card", [MODEL, BASELINE])
def test_eight_lanes_and_one_run_at_a_time_agree_to_rounding(card):
    prepared_case = modelled(card)
    eight, one = run_block(prepared_case, SEED, 3, 2), run_block(prepared_case, SEED, 3, 2, uses_lanes=False)
    for name in ("err", "sigma"):
        assert np.max(np.abs(getattr(eight, name) - getattr(one, name)) / eight.sigma) < 1e-9


def test_the_filters_sigma_of_rate_and_acceleration_is_the_steady_closed_form(runs):
    prepared_case = modelled()
    noise = np.sqrt(prepared_case.options.vehicle.variance)
    for t in (10.0, 28.0):
        at, tick = int(np.argmin(np.abs(runs.t - t))), round(t * 200.0) - 1
        for axis, index in enumerate(columns(prepared_case, "rate")):
            closed = noise[0] * math.sqrt(steady_ratio(prepared_case.options.vehicle.walk[tick, axis], noise[0] ** 2))
            assert runs.sigma[0, at, index] == pytest.approx(closed, rel=0.01)
    # table 2 of Beaudoin et al.: the roll rate is 88 % better than the gyro
    assert 1.0 - runs.sigma[0, at, columns(prepared_case, "rate")[0]] / noise[0] == pytest.approx(0.881, abs=0.001)


def test_the_errors_are_as_large_as_the_gain_makes_the_samples_noise(runs):
    # The true rate hardly changes: through the gain K the noise alone leaves K / (2 - K) of its variance, and the error
    # lies below the filter's sigma, which has the drifting in it. 64 runs at 15 times, 1 s apart: 4 sigma are 9 %.
    prepared_case = modelled()
    noise = math.sqrt(prepared_case.options.vehicle.variance[0])
    K = steady_ratio((0.002 / 200.0) ** 2, noise**2)
    is_late = (runs.t > 4.0) & (runs.t < 19.5) & (runs.t == np.round(runs.t))
    roll = runs.err[:, is_late, columns(prepared_case, "rate")[0]]
    assert np.std(roll) == pytest.approx(noise * math.sqrt(K / (2.0 - K)), rel=0.09)
    raw = runs.err[:, is_late, columns(prepared_case, "raw_rate")[0]]
    assert np.std(raw) == pytest.approx(noise, rel=0.09)


def test_nees_and_nis_are_those_of_a_filter_that_expects_no_less_than_comes(runs):
    prepared_case = modelled()
    is_late = runs.t > 4.0
    assert 18.0 < runs.nees[:, is_late].mean() < 25.0
    assert 12.5 < runs.nis[:, 4:].mean() < 15.6
    assert (runs.n_row == 15).all()
    assert runs.innovation.shape[2] == 15
    assert np.isfinite(runs.innovation).all()
    assert prepared_case.t_epoch.size == runs.nis.shape[1]


def test_with_hardly_any_error_the_estimate_is_the_truth():
    tiny = modelled(MODEL, "base.imu=imu/kvh1750_003", **{
        "imu__gyro__random_walk": "1e-9 deg/sqrt(h)", "imu__accel__random_walk": "1e-9 m/s/sqrt(h)",
        "imu__gyro__bias_repeatability": "1e-9 deg/h", "imu__accel__bias_repeatability": "1e-9 mg",
        "initial__tilt": "1e-9 deg", "initial__heading": "1e-9 deg", "initial__position": "1e-6 m",
        "initial__velocity": "1e-9 m/s",
    })  # fmt: skip
    block = run_block(tiny, SEED, 0, 8)
    worst = np.abs(block.err[:, 1:]).max(axis=(0, 1))
    for quantity, limit in (("attitude", 1e-6), ("velocity", 1e-4), ("position", 1e-3), ("rate", 1e-9)):
        assert worst[columns(tiny, quantity)].max() < limit


def test_unknown_dynamics_are_the_baseline_within_a_percent(record_property):
    unknown, base = (run_block(modelled(card), SEED, 0, 64) for card in (UNKNOWN, BASELINE))
    is_late, i, j = unknown.t > 1.0, modelled(UNKNOWN), modelled(BASELINE)
    for quantity in ("attitude", "velocity", "position"):
        ratio = (
            unknown.sigma[:, is_late][:, :, columns(i, quantity)] / base.sigma[:, is_late][:, :, columns(j, quantity)]
        )
        record_property(f"sigma of {quantity}, unknown over baseline", f"{ratio.min():.5f} to {ratio.max():.5f}")
        assert np.abs(ratio - 1.0).max() < 0.01
    # the estimate of the rate is the sample, less the estimated bias
    for quantity, beside in (("rate", "corrected_rate"), ("acceleration", "corrected_acceleration")):
        got, sample = (unknown.err[:, is_late][:, :, columns(i, name)] for name in (quantity, beside))
        assert np.sqrt(np.mean((got - sample) ** 2) / np.mean(sample**2)) < 0.01


def test_the_scalar_filter_of_the_turning_vehicle_is_the_rate_of_the_24_states(record_property):
    # The turning vehicle's loop carries one scalar filter an axis; its sigma differs from that of the 24 states by less
    # than 2 %: attitude reference and receiver say next to nothing about a rate beside 200 samples a second.
    prepared_case = modelled()
    t, vehicle, samples = (
        prepared_case.reference.t,
        prepared_case.options.vehicle,
        prepared_case.options.reported_samples,
    )
    noise = vehicle.variance[1]
    variance, gains = samples.raw[1] - samples.variance[1] + math.radians(1.0) ** 2, []
    for k in range(t.size - 1):
        variance, gain = filter_gain(variance, vehicle.walk[k, 1], noise)
        gains.append((gain, variance))
    block = run_block(prepared_case, SEED, 0, 8)
    index = columns(prepared_case, "rate")[1]
    for at in (5.0, 15.0, 25.0):
        tick, hist = round(at * 200.0) - 1, int(np.argmin(np.abs(block.t - at)))
        ratio = block.sigma[0, hist, index] / math.sqrt(gains[tick][1])
        record_property(f"sigma of the rate at {at:g} s, 24 states over scalar", f"{ratio:.5f}")
        assert ratio == pytest.approx(1.0, abs=0.02)


def test_a_run_is_the_same_in_any_block():
    prepared_case = modelled()
    block, part = run_block(prepared_case, 7, 0, 10), run_block(prepared_case, 7, 8, 2)
    for name in ("err", "sigma", "nees", "nis", "innovation"):
        np.testing.assert_array_equal(getattr(block, name)[8:], getattr(part, name))
    assert len(prepared_case.channel_names) == 15
    assert prepared_case.channel_names[6:9] == ("attitude x", "attitude y", "attitude z")


def test_samples_correct_the_state_at_the_earlier_epoch_of_a_difference(monkeypatch):
    """In closed loop the error state is fed back at every tick: what samples tell of a clone goes into its estimate."""
    for name in ("correct_motion", "correct_receiver"):
        monkeypatch.setattr(samples, name, lambda *_: None)
    monkeypatch.setattr(samples, "correct_previous_epoch", samples.correct_previous_epoch.py_func)
    cloned = np.array([POS, POS + 1, POS + 2])
    differences = DifferenceProcessing(
        np.ones(3, bool), np.ones((1, 3), bool), 0, np.full((1, 1), -1.0), cloned, 9, False
    )
    model = SimpleNamespace(n_state=12, clock=-1, extra_offset=np.zeros(0, dtype=int))
    for open_loop, expected in ((None, [1.0, 2.0, 3.0]), (object(), [0.0, 0.0, 0.0])):
        work, previous_epoch = SimpleNamespace(x=np.zeros(12), nav=None), new_previous_epoch(differences, 1, 0, 12)
        work.x[9:] = 1.0, 2.0, 3.0
        samples._correct_closed.py_func(work, previous_epoch, open_loop, differences, model)
        np.testing.assert_array_equal(previous_epoch.antenna[0, :3], expected)
        assert np.any(work.x) == (open_loop is not None)
