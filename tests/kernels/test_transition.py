"""The blocks of the transition against differences of the nonlinear strapdown, and linear against nonlinear growth."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.filter.model import transition_blocks
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.attitude import from_rotation, multiply, small_rotation
from lvnav_trade.kernels.earth import gravity_gradient
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import J2, N_SUM, SUM_C, SUM_F, SUM_TH, SUM_V, Q, R, V, full_rate
from lvnav_trade.kernels.transition import ACCEL, ATT, GYRO, POS, SQUARE, VEL, driver, fill
from lvnav_trade.quantities.state_layout import ErrorTerm

N_DRIVER = SQUARE + 1
RATE, FORCE = np.array([0.02, -0.05, 0.08]), np.array([35.0, 4.0, -6.0])  # rad/s, m/s^2: a sharp turn at 3.6 g
NAMES = ["own input", "own rolled by one", "own rolled by two", "other x", "other y", "other z", "own squared"]


def parameters():
    """Every driver on both sensors, in states from 9 on."""
    kinds = [(sensor, kind) for sensor in (GYRO, ACCEL) for kind in range(N_DRIVER)]
    return tuple(ErrorTerm("any", 0, sensor, kind, 0.0, offset=9 + 3 * at) for at, (sensor, kind) in enumerate(kinds))


PARAMETERS = parameters()
N_STATE = 9 + 3 * len(PARAMETERS)


def true_window(n_tick, dt):
    """Navigation state, the tick before, and increments of a window: steady turn, thrust growing by 10 % a second."""
    t = dt * (np.arange(-1, n_tick) + 0.5)
    rate = RATE * np.ones((n_tick + 1, 1))
    force = FORCE * (1.0 + 0.1 * t[:, None])
    increments = dt * np.concatenate([rate, force], axis=1)
    q = np.array(from_rotation(0.1, 0.2, -0.1))
    for _ in range(9):
        q = np.array(multiply(*q, *from_rotation(0.1, 0.2, -0.1)))
    nav = np.concatenate([q / np.linalg.norm(q), [5200.0, -1800.0, 3100.0], [4.1e6, -3.0e6, 4.3e6]])
    return nav, increments[0], increments[1:]


def tables_of(values):
    tables = np.zeros((2, processes.N_TABLE))
    sensors = np.array([p.sensor for p in PARAMETERS])
    kinds = np.array([p.driver for p in PARAMETERS])
    processes.gather(tables, values.reshape(-1, 3), sensors, kinds)
    return tables


def sensed(increments, tables, dt):
    """Increments as a unit with these errors puts them out (no noise)."""
    out = increments.copy()
    for k, (w, f) in enumerate(zip(increments[:, :3], increments[:, 3:], strict=True)):
        for axis in range(3):
            out[k, axis] += processes.error(tables[0], axis, *w, *f, w[axis] ** 2 / dt, dt)
            out[k, 3 + axis] += processes.error(tables[1], axis, *f, *w, f[axis] ** 2 / dt, dt)
    return out


def grown(x, n_tick, dt):
    """Error (truth minus estimate) at the end of the window of an estimate that starts off by x (n_state,)."""
    nav, before, increments = true_window(n_tick, dt)
    hat = nav.copy()
    hat[Q : Q + 4] = multiply(*from_rotation(*(-x[ATT : ATT + 3])), *nav[Q : Q + 4])
    hat[V : V + 3] -= x[VEL : VEL + 3]
    hat[R : R + 3] -= x[POS : POS + 3]
    # a sensor's error of p is one that the estimate does not take off
    tables = tables_of(x[9:])
    both = sensed(np.vstack([before, increments]), tables, dt)
    sums = np.zeros(N_SUM)
    mechanise(hat, sums, both[0].copy(), both[1:], n_tick, dt, full_rate(J2), 0.0)
    mechanise(nav, sums, before.copy(), increments, n_tick, dt, full_rate(J2), 0.0)
    out = np.empty(9)
    out[ATT : ATT + 3] = small_rotation(*nav[Q : Q + 4], *hat[Q : Q + 4])
    out[VEL : VEL + 3] = nav[V : V + 3] - hat[V : V + 3]
    out[POS : POS + 3] = nav[R : R + 3] - hat[R : R + 3]
    return out, sums, nav


# Steps large enough to drown rounding at 7e6 m, and in the linear range.
STEPS = np.concatenate([
    np.full(3, 1e-3), np.full(3, 1.0), np.full(3, 100.0),
    np.repeat([1e-4, 1e-3, 1e-3, 1e-3, 1e-4, 1e-4, 1e-4, 1e-2], 3),
    np.repeat([1e-2, 1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2, 1e-4], 3),
])  # fmt: skip


def differences(n_tick, dt):
    """Central differences of the window's map, (9, n_state)."""
    columns = []
    for j in range(N_STATE):
        x = np.zeros(N_STATE)
        x[j] = STEPS[j]
        columns.append((grown(x, n_tick, dt)[0] - grown(-x, n_tick, dt)[0]) / (2.0 * STEPS[j]))
    return np.array(columns).T


def filled(n_tick, dt):
    """Phi - I of `fill` (9, n_state), with the sums of the true window and the position at its end."""
    _, sums, nav = grown(np.zeros(N_STATE), n_tick, dt)
    return multiplied(2, sums, nav[R : R + 3], n_tick * dt)


def multiplied(order, sums, r, seconds):
    rows, columns, kinds, drivers = transition_blocks(PARAMETERS, order)
    blocks, phi = np.full((rows.size, 9), np.nan), np.eye(N_STATE)
    fill(blocks, kinds, drivers, sums, *r, seconds)
    for row, column, block in zip(rows, columns, blocks, strict=True):
        phi[row : row + 3] += block.reshape(3, 3) @ phi[column : column + 3]
    return (phi - np.eye(N_STATE))[:9]


def deviation(n_tick, dt):
    """Return fill minus differences, and the differences, with the identity taken off."""
    exact = differences(n_tick, dt)
    exact[:, :9] -= np.eye(9)
    return filled(n_tick, dt) - exact, exact


WINDOW = (20, 0.005)  # 10 Hz of a 200 Hz unit


@pytest.fixture(scope="module")
def at_ten_hertz():
    return deviation(*WINDOW)


BLOCKS = [
    ("velocity from attitude", VEL, ATT), ("position from attitude", POS, ATT), ("velocity from position", VEL, POS),
    ("position from velocity", POS, VEL), ("velocity from velocity", VEL, VEL), ("position from position", POS, POS),
]  # fmt: skip
BLOCKS += [
    (f"{room} from {'gyro' if p.sensor == GYRO else 'accelerometer'} {['constant', *NAMES][p.driver]}", row, p.offset)
    for p in PARAMETERS
    for room, row in (("attitude", ATT), ("velocity", VEL), ("position", POS))
    if p.sensor == GYRO or row != ATT
]


GYROS = {p.offset for p in PARAMETERS if p.sensor == GYRO}


@pytest.mark.parametrize(("row", "column"), [block[1:] for block in BLOCKS], ids=[block[0] for block in BLOCKS])
def test_a_block_is_the_difference_of_the_nonlinear_strapdown(at_ten_hertz, row, column):
    # Left out, relative to the block: the body's turn within a tick (0.1 rad/s x 2.5 ms) and within the window where C
    # and force are taken apart (0.1 rad/s x 0.1 s / 2), the change of thrust (1 %), and the double sum of C where it is
    # not uniform: 1 % of a block's largest entry holds them all; what is summed exactly stays far below.
    off, exact = at_ten_hertz
    part = (slice(row, row + 3), slice(column, column + 3))
    largest = np.abs(exact[part]).max()
    rounding = {ATT: 1e-12, VEL: 1e-11, POS: 1e-8}[row] / STEPS[column]
    assert largest > 10.0 * rounding
    # what a gyro does to position is of third order, and the product holds 1/4 of it where the flight has 1/6
    share = 0.51 if row == POS and column in GYROS else 1e-2
    assert np.abs(off[part]).max() < share * largest + rounding


def test_what_no_block_names_is_of_third_order(at_ten_hertz):
    # attitude depends on nothing but itself and the gyros
    _, exact = at_ten_hertz
    assert np.abs(exact[ATT : ATT + 3, VEL:9]).max() < 1e-9
    accels = [slice(p.offset, p.offset + 3) for p in PARAMETERS if p.sensor == ACCEL]
    assert all(np.abs(exact[ATT : ATT + 3, at]).max() < 1e-9 for at in accels)


def test_the_transition_is_right_to_second_order_in_the_window():
    # In a window half as long, of as many ticks, what is left out falls by four at least: Phi is then right to second
    # order. Each column is measured in its own step; the largest of a room's rows decides, away from rounding.
    long, short = (np.abs(deviation(20, dt)[0]) * STEPS for dt in (0.02, 0.01))
    for row in (ATT, VEL, POS):
        assert short[row : row + 3].max() < 0.26 * long[row : row + 3].max()


@pytest.mark.parametrize(
    ("state", "size"), [(ATT, 0.08), (POS, 2e5)], ids=["attitude of 80 mrad", "position of 200 km"]
)
def test_the_residual_of_linear_growth_shrinks_by_four_when_the_error_halves(state, size):
    phi = filled(*WINDOW)
    phi[:, :9] += np.eye(9)
    direction = np.zeros(N_STATE)
    direction[state : state + 3] = np.array([0.6, -0.64, 0.48])
    row = VEL if state == ATT else POS

    def residual(length):
        # symmetric and antisymmetric parts: the linear model's own error cancels in the symmetric one
        plus, minus = (grown(sign * length * direction, *WINDOW)[0][row : row + 3] for sign in (1.0, -1.0))
        linear = phi[row : row + 3] @ direction * length
        return np.linalg.norm(0.5 * ((plus - linear) + (minus + linear)))

    assert residual(size) > 0.0
    for length in (size, 0.5 * size, 0.25 * size):
        assert residual(length) / residual(0.5 * length) == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("kind", range(N_DRIVER))
def test_a_driver_multiplies_what_its_name_says(kind):
    own, other = np.array([2.0, 3.0, 5.0]), np.array([7.0, 11.0, 13.0])
    others = [np.full(3, 7.0), np.full(3, 11.0), np.full(3, 13.0)]
    expected = [np.ones(3), own, np.roll(own, -1), np.roll(own, -2), *others, own**2]
    np.testing.assert_array_equal(driver(kind, *own, *other), expected[kind])


def test_a_transition_of_first_order_is_the_identity_and_what_is_linear_in_the_window():
    n_tick, dt = WINDOW
    seconds = n_tick * dt
    _, sums, nav = grown(np.zeros(N_STATE), n_tick, dt)
    x, y, z = nav[R : R + 3]
    xx, xy, xz, yy, yz, zz = gravity_gradient(x, y, z)
    fx, fy, fz = sums[SUM_V : SUM_V + 3]
    linear = np.zeros((9, N_STATE))
    linear[VEL : VEL + 3, ATT : ATT + 3] = [[0.0, fz, -fy], [-fz, 0.0, fx], [fy, -fx, 0.0]]
    linear[VEL : VEL + 3, POS : POS + 3] = seconds * np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    linear[POS : POS + 3, VEL : VEL + 3] = seconds * np.eye(3)
    C = sums[SUM_C : SUM_C + 9].reshape(3, 3)
    means = sums[SUM_TH : SUM_TH + 3] / seconds, sums[SUM_F : SUM_F + 3] / seconds
    for p in PARAMETERS:
        own, other = means if p.sensor == GYRO else means[::-1]
        row = ATT if p.sensor == GYRO else VEL
        linear[row : row + 3, p.offset : p.offset + 3] = -C * driver(p.driver, *own, *other)
    given = multiplied(1, sums, nav[R : R + 3], seconds)
    np.testing.assert_allclose(given, linear, rtol=1e-13, atol=1e-18)
