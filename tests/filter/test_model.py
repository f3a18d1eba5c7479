"""What a filter card means in numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.filter.assumed import ImuModel, ReceiverModel
from lvnav_trade.filter.card import FilterCard
from lvnav_trade.filter.model import build_filter_model, window_tables
from lvnav_trade.filter.states import POSITION, PSEUDORANGE, RANGE_RATE, VELOCITY, FilterMeasurements, state_layout
from lvnav_trade.kernels.covariance import predict
from lvnav_trade.kernels.transition import ATT, POS, SQUARE, VEL
from lvnav_trade.quantities.state_layout import ErrorTerm, StateLayout
from lvnav_trade.sensors.receiver_observables import Channels

IMU = ImuModel(
    gyro_random_walk="0.03 deg/sqrt(h)", accel_random_walk="50 ug/sqrt(Hz)",
    gyro_bias="1 deg/h", gyro_bias_walk="0.1 deg/h/sqrt(h)", accel_bias="2 mg", accel_bias_time="60 s",
    gyro_scale_factor="300 ppm", gyro_misalignment="0.5 mrad", gyro_g_sensitivity="1 deg/h/g",
)  # fmt: skip
RECEIVER = ReceiverModel(
    pseudorange_sigma="2 m", range_rate_sigma="0.1 m/s", position_sigma="3 m", velocity_sigma="0.2 m/s",
    clock_h0=2e-21, clock_h_minus2=3e-24,
)  # fmt: skip
SECONDS = np.array([0.0, 0.1])
SATELLITES = ("G01", "G02", "E05")
SEEN = (True, False, True)


RANGES, SOLUTION = ("pseudorange", "range_rate"), ("position", "velocity")


def card(**fields):
    return FilterCard(**{"name": "f", "source": "test", "measurements": RANGES, **fields})


def channels(listed=RANGES):
    return Channels(listed == RANGES, SATELLITES, ("G", "G", "E"), SEEN)


def accepted(lever=(0.0, 0.0, 0.0), **fields):
    return built(card(**fields), IMU, lever, fields.get("measurements", RANGES))


def built(states, imu, lever=(0.0, 0.0, 0.0), listed=RANGES):
    taken = FilterMeasurements(imu, RECEIVER, channels(listed), lever_arms=np.array([lever]))
    layout = state_layout(states, taken)
    return layout, build_filter_model(states, layout, taken, SECONDS)


def test_extra_states_take_one_block_for_each_driver():
    layout, model = accepted(extra_states=("gyro_scale_factor", "gyro_misalignment", "gyro_g_sensitivity"))
    assert layout.n_state == 17 + 3 * (1 + 2 + 3)
    assert not model.biases_only
    offsets = [b.offset for b in layout.parameters]
    assert offsets == sorted(set(offsets))
    assert layout.clock == max(offsets) + 3


def test_a_state_may_be_considered_without_being_named_among_the_extra_ones():
    layout, _ = accepted(consider=("gyro_scale_factor",))
    assert [b.name for b in layout.parameters] == ["gyro_bias", "accel_bias", "gyro_scale_factor"]
    assert layout.n_state == layout.n_estimated + 3


def test_neglected_biases_are_left_out():
    layout, _ = accepted(neglect=("gyro_bias", "accel_bias"))
    assert layout.parameters == ()
    assert layout.n_state == 11


def test_rows_stand_for_the_states_they_depend_on():
    layout, with_lever = accepted(lever=(1.0, 0.0, 0.0))
    _, without = accepted()
    _, loose = accepted(lever=(1.0, 0.0, 0.0), measurements=SOLUTION)
    no_bias, unbiased = accepted(lever=(1.0, 0.0, 0.0), neglect=("gyro_bias",))
    assert list(without.n_entry) == [4, 7] * 3
    assert list(with_lever.n_entry) == [7, 13] * 3
    assert list(unbiased.n_entry) == [7, 10] * 3
    assert list(without.channel_type) == [PSEUDORANGE, RANGE_RATE] * 3
    assert list(loose.channel_type) == [POSITION] * 3 + [VELOCITY] * 3
    gyro_bias = layout.parameters[0].offset  # an antenna swings with the rate that the gyro gives, less its bias
    attitude, velocity, position, rate = (set(range(at, at + 3)) for at in (ATT, VEL, POS, gyro_bias))
    assert columns(with_lever, 0) == position | attitude | {layout.clock}
    assert columns(with_lever, 1) == position | attitude | velocity | rate | {layout.clock + 1}
    assert columns(unbiased, 1) == position | attitude | velocity | {no_bias.clock + 1}
    assert columns(loose, 0) == position | attitude
    assert columns(loose, 5) == velocity | attitude | rate


def columns(model, channel):
    return set(model.column[channel, : model.n_entry[channel]].tolist())


def test_a_range_bias_has_a_state_for_each_satellite_that_is_ever_seen():
    layout, model = accepted(extra_states=("range_bias", "timing"))
    biases, timing = layout.extras
    assert (biases.labels, timing.labels) == (("G01", "E05"), ("",))
    assert layout.n_estimated == layout.n_state == 17 + 3
    assert columns(model, 0) == {POS, POS + 1, POS + 2, layout.clock, biases.offset, timing.offset}
    assert biases.offset not in columns(model, 1)  # a bias of the range is none of its rate
    assert columns(model, 2) == {POS, POS + 1, POS + 2, layout.clock, timing.offset}
    assert list(model.extra_offset) == [17, 18, 19]
    assert list(model.extra_member[0]) == [0, -1, -1, -1, 1, -1]


def test_the_time_of_a_further_system_is_a_state_of_its_satellites_only():
    layout, model = accepted(extra_states=("time_offset",))
    (block,) = layout.extras
    assert block.labels == ("E",)
    assert [block.offset in columns(model, channel) for channel in range(6)] == [False] * 4 + [True, False]


def test_a_considered_extra_state_stands_behind_all_estimated_ones():
    layout, _ = accepted(extra_states=("range_bias",), consider=("range_bias", "gyro_bias"))
    assert layout.n_estimated == 9 + 3 + 2
    assert min(layout.extras[0].offset, *(p.offset for p in layout.parameters if p.name == "gyro_bias")) == 14


def test_states_of_a_solution_are_none_of_a_tight_filter():
    tight, _ = accepted(extra_states=("position_bias",))
    loose, _ = accepted(extra_states=("position_bias",), measurements=SOLUTION)
    assert tight.extras == ()
    assert loose.extras[0].labels == ("x", "y", "z")
    assert loose.n_state == 18


def test_noise_densities_are_the_cards_own_and_add_in_square():
    layout, model = accepted(attitude_noise="0.04 deg/sqrt(h)", velocity_noise="0 ug/sqrt(Hz)")
    unit = math.radians(0.01) / 60.0
    np.testing.assert_allclose(model.noise[1, ATT : ATT + 3], 0.1 * (5.0 * unit) ** 2)  # 3, 4, 5
    np.testing.assert_allclose(model.noise[1, VEL : VEL + 3], 0.1 * (50e-6 * 9.80665) ** 2)
    np.testing.assert_array_equal(model.noise[1, POS : POS + 3], 0.0)
    walk = math.radians(0.1) / 3600.0 / 60.0
    np.testing.assert_allclose(model.noise[1, 9:12], 0.1 * walk**2)
    np.testing.assert_array_equal(model.noise[0], 0.0)  # a window of no ticks changes nothing
    np.testing.assert_array_equal(model.decay[0], 1.0)
    clock = np.array([299792458.0**2 * 1e-21, 299792458.0**2 * 2.0 * math.pi**2 * 3e-24])
    np.testing.assert_allclose(model.noise[1, layout.clock :], 0.1 * clock)


def _carried(seconds, total, tau=2.0, sigma=3.0):
    """Variance of one Gauss-Markov state after `total` seconds of windows, from its steady state."""
    block = ErrorTerm("gyro_bias", 0, 0, 0, sigma, 0.0, tau, offset=9)
    layout = StateLayout((block,), -1, 12, 12)
    decay, noise = window_tables(layout, np.zeros(12), np.array([seconds]))
    P = np.diag([0.0] * 9 + [sigma**2] * 3)
    none = np.zeros(0, dtype=np.int64)
    for _ in range(round(total / seconds)):
        predict(P, np.zeros((0, 9)), none, none, decay[0], noise[0], -1, seconds)
    return P[9, 9]


@pytest.mark.parametrize("seconds", [0.005, 0.1, 1.0])
def test_a_gauss_markov_state_keeps_its_sigma_whatever_the_window(seconds):
    # the steady state is exact for any window: half of the noise enters before it decays, half after
    assert _carried(seconds, total=100.0) == pytest.approx(9.0, rel=1e-9)


def test_a_nonlinearity_is_the_slope_of_the_scale_factor_and_its_walk_covers_it():
    imu = IMU.model_copy(update={
        "accel_nonlinearity": 3e-4, "accel_full_scale": 300.0, "accel_scale_factor": 1e-3,
        "accel_scale_factor_walk": 2e-5,
    })  # fmt: skip
    states = card(extra_states=("accel_scale_factor", "accel_nonlinearity"))
    layout, model = built(states, imu)
    scale, slope = (
        next(b for b in layout.parameters if b.name == f"accel_{name}") for name in ("scale_factor", "nonlinearity")
    )
    assert slope.sigma == pytest.approx(1e-6, rel=1e-12)  # 1/(m/s^2)
    assert slope.driver == SQUARE
    np.testing.assert_allclose(model.noise[:, scale.offset], SECONDS * 4e-10, rtol=1e-12)


def test_settings_reach_the_numbers_of_the_kernels():
    _, plain = accepted()
    _, other = accepted(gate=3.0, update="joseph", gravity="j2", transition_order=1)
    assert math.isinf(plain.gate_squared)
    assert other.gate_squared == 9.0
    assert (plain.joseph, other.joseph) == (False, True)
    assert plain.strapdown.gravity != other.strapdown.gravity
    assert set(other.block_kinds) != set(plain.block_kinds)
    assert plain.has_decay  # the accelerometer bias has a time constant here
