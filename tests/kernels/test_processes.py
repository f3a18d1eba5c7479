"""Parameters of an inertial unit: gathered, put into increments, taken off again. Statistics: tests of world.imu."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels import processes
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import WIDTH, view
from lvnav_trade.kernels.processes import N_TABLE, compensate, gather, quantise, zero_all
from lvnav_trade.kernels.transition import ACCEL, GYRO, SQUARE, driver

DT = 0.005
W, F = np.array([0.1, -0.2, 0.3]), np.array([30.0, -4.0, 7.0])
EVERY = [(sensor, kind) for sensor in (GYRO, ACCEL) for kind in range(SQUARE + 1)]


def tables(values, pairs):
    out = np.full((2, N_TABLE), np.nan)
    gather(out, np.asarray(values, dtype=float), *(np.array(column) for column in zip(*pairs, strict=True)))
    return out


def error_of(table, own, other):
    own, other = own * DT, other * DT
    return np.array([processes.error(table, a, *own, *other, own[a] ** 2 / DT, DT) for a in range(3)])


@pytest.mark.parametrize(("sensor", "kind"), EVERY)
def test_a_block_puts_its_value_times_its_driver_into_the_increment(sensor, kind):
    value = np.array([1e-3, -2e-3, 3e-3])
    table = tables([value], [(sensor, kind)])
    own, other = (W, F) if sensor == GYRO else (F, W)
    np.testing.assert_allclose(error_of(table[sensor], own, other), DT * value * driver(kind, *own, *other), rtol=1e-13)
    assert not table[1 - sensor].any()


def test_blocks_of_one_driver_add_up():
    once = tables([[1.0, 2.0, 3.0], [10.0, 20.0, 30.0]], [(GYRO, 0), (GYRO, 0)])
    np.testing.assert_array_equal(once, tables([[11.0, 22.0, 33.0]], [(GYRO, 0)]))


def test_no_blocks_at_all_give_tables_of_zeros():
    out = np.full((2, N_TABLE), np.nan)
    none = np.zeros(0, dtype=np.int64)
    gather(out, np.zeros((1, 3)), none, none)
    assert not out.any()


def unit_errors(size):
    rng = np.random.default_rng(1)
    return tables(size * rng.standard_normal((len(EVERY), 3)) * np.array([1e-3]), EVERY)


def sensed(table):
    """Increments of ideal ones with these errors on them."""
    out = DT * np.tile(np.concatenate([W, F]), (4, 1))
    out[:, :3] += error_of(table[GYRO], W, F)
    out[:, 3:] += error_of(table[ACCEL], F, W)
    return out


def test_what_is_put_in_is_taken_off_to_third_order():
    """Two passes leave the cube of the relative error: an error ten times smaller leaves a thousandth."""
    left = []
    for size in (1.0, 0.1):
        table = unit_errors(size)
        increments = sensed(table)
        compensate(increments, 4, table[GYRO], table[ACCEL], False, DT)
        left.append(np.abs(increments / DT - np.concatenate([W, F])).max())
    assert left[0] < 0.1
    assert left[0] / left[1] == pytest.approx(1000.0, rel=0.5)


def test_biases_alone_are_taken_off_exactly_on_the_short_way():
    table = tables([[1e-3, 2e-3, 3e-3], [0.1, 0.2, 0.3]], [(GYRO, 0), (ACCEL, 0)])
    short, full = sensed(table), sensed(table)
    compensate(short, 4, table[GYRO], table[ACCEL], True, DT)
    compensate(full, 4, table[GYRO], table[ACCEL], False, DT)
    np.testing.assert_allclose(short / DT, np.tile(np.concatenate([W, F]), (4, 1)), rtol=1e-13)
    np.testing.assert_allclose(full, short, rtol=1e-13)


@pytest.mark.parametrize("value", [0.0, 0.49, 0.51, -3.2, 1e6 + 0.3])
def test_quantisation_gives_the_nearest_whole_step_and_keeps_the_rest(value):
    out, left = quantise(value * 1e-3, 0.1e-3, 1e-3)
    assert out / 1e-3 == pytest.approx(round(value + 0.1), abs=1e-6)
    assert out + left == pytest.approx(value * 1e-3 + 0.1e-3, abs=1e-12)
    assert abs(left) <= 0.5e-3 * (1.0 + 1e-6)


@jit
def zero_lanes(values):
    zero_all(view(values))


def test_a_matrix_is_set_to_zero_in_all_lanes():
    one, eight = np.ones((3, 4)), np.ones((3, 4, WIDTH))
    zero_all(one)
    zero_lanes(eight)
    assert not one.any()
    assert not eight.any()
