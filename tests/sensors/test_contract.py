"""What every measurement row promises, walked over the family: its Jacobian, its noise, its truth."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import lvnav_trade.sensors as family
from lvnav_trade.kernels.attitude import from_rotation, matrix, multiply
from lvnav_trade.kernels.random import normals, seed_words, source_word
from lvnav_trade.kernels.strapdown import Q, R, V
from lvnav_trade.quantities.line_of_sight import antenna, line_of_sight
from lvnav_trade.sensors import attitude_reference, ranges, receiver_solution
from lvnav_trade.sensors.jacobian_row import H_ATT, H_CLOCK, H_POS, H_RATE, H_VEL, N_ENTRY

# The satellite is near, so that rounding of the range does not hide the seventh digit of a derivative.
NAV = np.array([0.7, -0.1, 0.5, 0.5, 5200.0, -1800.0, 3100.0, 4.0e4, -3.0e4, 4.2e4])
NAV[Q : Q + 4] /= np.linalg.norm(NAV[Q : Q + 4])
BODY_RATE, LEVER = np.array([0.3, -0.2, 0.5]), np.array([1.5, -0.7, 4.0])
SATELLITE, SATELLITE_VELOCITY = np.array([6.0e4, -1.0e4, 5.5e4]), np.array([900.0, 3100.0, -2200.0])
CLOCK = np.array([120.0, -3.0])


def moved(x):
    """Navigation state and clock after feedback of an error state x: attitude, velocity, position, clock."""
    nav = NAV.copy()
    nav[Q : Q + 4] = multiply(*from_rotation(*x[:3]), *NAV[Q : Q + 4])
    nav[V : V + 3] += x[3:6]
    nav[R : R + 3] += x[6:9]
    return nav, CLOCK + x[9]


def antenna_at(nav, rate=0.0):
    out = np.zeros(21)
    antenna(out, nav, BODY_RATE + rate, LEVER, 1.0)
    return out


def predict_pseudorange(h, nav, clock, axis):
    at = antenna_at(nav)
    return ranges.range_row(h, at, *line_of_sight(SATELLITE, at), clock[0])


def predict_doppler(h, nav, clock, axis):
    at = antenna_at(nav)
    return ranges.rate_row(h, at, SATELLITE_VELOCITY, *line_of_sight(SATELLITE, at), clock[1])


def predict_position(h, nav, clock, axis):
    return receiver_solution.row(h, antenna_at(nav), axis)


def predict_velocity(h, nav, clock, axis):
    return receiver_solution.row(h, antenna_at(nav), 3 + axis)


def attitude_rows(observed, nav):
    """Jacobian rows (3, n_entry) and innovations (3,) of a measured attitude."""
    H, z = np.zeros((3, N_ENTRY)), np.zeros(3)
    attitude_reference.fill(H, z, 0, np.asarray(observed), nav)
    return H, z


def predict_attitude(h, nav, clock, axis):
    """The rotation from NAV's attitude, at which the row is a one in its axis' column, to the estimated one."""
    h[:] = attitude_rows(NAV[Q : Q + 4], nav)[0][axis]
    return attitude_rows(nav[Q : Q + 4], NAV)[1][axis]


def observe_attitude(true, sigma, noise):
    """One axis of what the reference measures of NAV's attitude, as a rotation from it; `true` is that of the truth."""
    measured = np.zeros(4)
    attitude_reference.measure(measured, NAV[Q : Q + 4], sigma * noise, 0.0, 0.0)
    return true + attitude_rows(measured, NAV)[1][0]


FAMILY = {
    "pseudorange": (predict_pseudorange, ranges.observe, True),
    "doppler": (predict_doppler, ranges.observe, True),
    "position": (predict_position, receiver_solution.observe, False),
    "velocity": (predict_velocity, receiver_solution.observe, False),
    "attitude": (predict_attitude, observe_attitude, False),
}
BY_AXIS = ("position", "velocity", "attitude")
ROWS = [(name, axis) for name in FAMILY for axis in (range(3) if name in BY_AXIS else [0])]
ENTRIES = {"attitude": (H_ATT, 0, 1e-2), "velocity": (H_VEL, 3, 10.0), "position": (H_POS, 6, 100.0)}


def difference(predict, axis, state, step):
    """Central difference of fourth order of the predicted measurement."""
    values = []
    for k in (-2, -1, 1, 2):
        x = np.zeros(10)
        x[state] = k * step
        values.append(predict(np.zeros(N_ENTRY), *moved(x), axis))
    return (values[0] - 8.0 * values[1] + 8.0 * values[2] - values[3]) / (12.0 * step)


def test_every_module_of_the_family_is_examined_here():
    files = Path(family.__file__).parent.glob("*.py")
    unregistered = {path.stem for path in files if "Registration(" not in path.read_text(encoding="utf-8")}
    without_rows = {
        "__init__",
        "family",
        "geomagnetism",
        "jacobian_row",
        "optics",
        "receiver_observables",
        "sensor",
    }
    assert unregistered - without_rows == {"ranges", "receiver_solution"}  # those that register: their own tests


@pytest.mark.parametrize(("name", "axis"), ROWS)
@pytest.mark.parametrize("part", ENTRIES)
def test_a_row_is_the_derivative_of_the_predicted_measurement(name, axis, part):
    predict = FAMILY[name][0]
    h = np.full(N_ENTRY, np.nan)
    predict(h, NAV, CLOCK, axis)
    entry, state, step = ENTRIES[part]
    expected = np.array([difference(predict, axis, state + i, step) for i in range(3)])
    # rounding: 4e-11 of the measurement (7e4 m, or m/s) over the step; truncation: (step over scale)^4 / 30
    rounding = {"attitude": 1e-8, "velocity": 1e-11, "position": 1e-12}[part]
    np.testing.assert_allclose(h[entry : entry + 3], expected, rtol=0, atol=1e-7 * np.abs(expected).max() + rounding)
    assert np.all(np.isfinite(h))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("name", ["doppler", "velocity"])
def test_a_rows_entry_of_the_body_rate_is_the_derivative_by_it(name, axis):
    """The antenna swings about the unit, so its velocity is linear in the body rate."""

    def predicted(rate, h):
        at = antenna_at(NAV, rate)
        if name == "velocity":
            return receiver_solution.row(h, at, 3 + axis)
        return ranges.rate_row(h, at, SATELLITE_VELOCITY, *line_of_sight(SATELLITE, at), CLOCK[1])

    h = np.full(N_ENTRY, np.nan)
    predicted(0.0, h)
    steps = [np.eye(3)[i] for i in range(3)]
    expected = [0.5 * (predicted(step, h.copy()) - predicted(-step, h.copy())) for step in steps]
    np.testing.assert_allclose(h[H_RATE : H_RATE + 3], expected, rtol=0, atol=1e-9)
    assert np.abs(expected).max() > 1.0


@pytest.mark.parametrize(("name", "axis"), ROWS)
def test_the_clock_enters_ranges_and_their_rates_only(name, axis):
    predict, _, clocked = FAMILY[name]
    h = np.full(N_ENTRY, np.nan)
    before = predict(h, NAV, CLOCK, axis)
    after = predict(np.zeros(N_ENTRY), NAV, CLOCK + 7.0, axis)
    assert h[H_CLOCK] == (1.0 if clocked else 0.0)
    assert after - before == pytest.approx(7.0 * h[H_CLOCK], abs=1e-10)


def test_a_row_really_has_a_lever_arm_and_a_turning_body():
    for name, axis in ROWS:
        h = np.zeros(N_ENTRY)
        FAMILY[name][0](h, NAV, CLOCK, axis)
        assert np.abs(h[H_ATT : H_ATT + 3]).max() > 1e-3


def true_measurement(name, axis):
    """The measurement at the truth by plain geometry, without noise."""
    C = np.array(matrix(*NAV[Q : Q + 4])).reshape(3, 3)
    r = NAV[R : R + 3] + C @ LEVER
    v = NAV[V : V + 3] + C @ np.cross(BODY_RATE, LEVER)
    line = SATELLITE - r
    distance = np.linalg.norm(line)
    rate = line @ (SATELLITE_VELOCITY - v) / distance
    by_axis = {"position": r, "velocity": v, "attitude": np.zeros(3)}
    return {"pseudorange": distance, "doppler": rate}[name] if name not in by_axis else by_axis[name][axis]


@pytest.mark.parametrize(("name", "axis"), ROWS)
def test_observe_minus_row_at_the_truth_has_zero_mean_and_the_declared_variance(name, axis):
    predict, observe, clocked = FAMILY[name]
    sigma, n, key = 0.4, 4000, seed_words(11)
    true, clock = true_measurement(name, axis), CLOCK[1 if name == "doppler" else 0]
    draws = [normals(*key, source_word(name), np.uint64(run), np.uint64(1), np.uint64(0))[axis] for run in range(n)]
    sample = np.array([observe(true, clock, sigma, z) if clocked else observe(true, sigma, z) for z in draws])
    residual = sample - predict(np.zeros(N_ENTRY), NAV, CLOCK, axis)
    # five sigma of the mean and of the standard deviation of n Gaussians
    assert abs(np.mean(residual)) < 5.0 * sigma / math.sqrt(n)
    assert abs(np.std(residual) / sigma - 1.0) < 5.0 / math.sqrt(2.0 * n)


def test_without_noise_the_measurement_at_the_truth_is_the_predicted_one():
    for name, axis in ROWS:
        predict, observe, clocked = FAMILY[name]
        true = true_measurement(name, axis)
        clock = CLOCK[1 if name == "doppler" else 0]
        z = observe(true, clock, 0.0, 3.0) if clocked else observe(true, 0.0, 3.0)
        assert z == pytest.approx(predict(np.zeros(N_ENTRY), NAV, CLOCK, axis), abs=1e-10)
