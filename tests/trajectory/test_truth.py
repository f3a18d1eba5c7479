"""Truth: an independent strapdown returns it, and it is continuous, plumb on the pad and free in coast."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from lvnav_trade.kernels.earth import OMEGA, gravity_along, gravity_j4
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, matrices
from lvnav_trade.trajectory.attitude_algebra import product
from lvnav_trade.trajectory.flights.spin import SpinStep, spin_angle
from lvnav_trade.trajectory.truth import Phase, Trajectory, motion, reference
from tests import building
from tests.potential import potential_j4
from tests.trajectory.flight_cases import ascent, recorded

FLIGHTS = pytest.mark.parametrize("flight", [ascent, recorded])


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def turned(q, turn):
    """Quaternion q followed by the rotation vector `turn`, in body axes."""
    angle = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    s = 0.5 - angle**2 / 48.0
    w, x, y, z = math.cos(0.5 * angle), s * turn[0], s * turn[1], s * turn[2]
    return (
        q[0] * w - q[1] * x - q[2] * y - q[3] * z,
        q[0] * x + q[1] * w + q[2] * z - q[3] * y,
        q[0] * y - q[1] * z + q[2] * w + q[3] * x,
        q[0] * z + q[1] * y - q[2] * x + q[3] * w,
    )


def strapdown(ref):
    """Integrate the increments in the inertial frame: coning and sculling by the tick before, trapezoidal position."""
    dtheta, dvel = ref.dtheta, ref.dvel
    before_th, before_dv = np.vstack([dtheta[:1], dtheta[:-1]]), np.vstack([dvel[:1], dvel[:-1]])
    turn = dtheta + np.cross(before_th, dtheta) / 12.0
    push = dvel + 0.5 * np.cross(dtheta, dvel) + (np.cross(before_th, dvel) + np.cross(before_dv, dtheta)) / 12.0
    q = [tuple(ref.q_b_i[0])]
    for row in turn.tolist():
        q.append(turned(q[-1], row))
    step_i = np.einsum("kij,kj->ki", matrices(np.array(q[:-1])), push).tolist()
    h = np.diff(ref.t).tolist()
    r, v = tuple(ref.r_i[0].tolist()), tuple(ref.v_i[0].tolist())
    for dt, dv in zip(h, step_i, strict=True):
        g = gravity_j4(*(x + 0.5 * dt * u for x, u in zip(r, v, strict=True)))
        w = tuple(u + a + dt * b for u, a, b in zip(v, dv, g, strict=True))
        r = tuple(x + 0.5 * dt * (u + s) for x, u, s in zip(r, v, w, strict=True))
        v = w
    return np.linalg.norm(r - ref.r_i[-1]), np.linalg.norm(v - ref.v_i[-1])


def test_a_perfect_strapdown_returns_the_whole_flight_to_1_cm():
    position, velocity = strapdown(reference(ascent(), 200.0))
    assert position < 0.01
    assert velocity < 0.001


def test_a_perfect_strapdown_returns_the_recorded_flight_to_1_cm():
    position, velocity = strapdown(reference(recorded(), 200.0))
    assert position < 0.01
    assert velocity < 0.001


def test_the_error_of_the_strapdown_falls_with_the_square_of_the_tick():
    # Trapezoidal position is of second order, and the slowest of its parts: 16 from 100 to 400 Hz.
    burn = next(phase for phase in ascent().phases if phase.name == "stage 2 burn")
    flight = Trajectory((burn,), {}, 0.0, "")
    errors = [strapdown(reference(flight, rate))[0] for rate in (100.0, 400.0)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.2)


@FLIGHTS
def test_on_the_pad_the_specific_force_is_plumb(flight):
    m = motion(flight(), np.linspace(flight().start, -0.01, 200))
    f_i = np.einsum("kij,kj->ki", matrices(m.q_b_i), m.f_b)
    spin = np.array([0.0, 0.0, OMEGA])
    expected = np.cross(spin, np.cross(spin, m.r_i)) - gravity_along(m.r_i)
    assert np.max(np.abs(f_i - expected)) < 1e-6


@FLIGHTS
def test_on_the_pad_the_body_turns_with_the_earth_and_stays_on_its_spot(flight):
    t = np.linspace(flight().start, 0.0, 50)[:-1]
    m = motion(flight(), t)
    assert np.max(np.abs(np.linalg.norm(m.w_ib_b, axis=1) - OMEGA)) < 1e-8
    r_e = ecef_from_eci(m.r_i, earth_angle(flight().theta0, t))
    assert np.max(np.abs(r_e - r_e[0])) < 1e-7


@FLIGHTS
def test_position_velocity_attitude_and_rate_are_continuous_across_phases(flight):
    for before, after in pairwise(flight().phases):
        assert before.end == after.start
        assert np.max(np.abs(before.position(before.end) - after.position(after.start))) < 1e-6
        assert np.max(np.abs(before.position(before.end, 1) - after.position(after.start, 1))) < 1e-6
        for order in (0, 1):
            jump = before.attitude(before.end, order) - after.attitude(after.start, order)
            assert np.max(np.abs(jump)) < 1e-12


@FLIGHTS
def test_specific_force_and_body_rate_do_not_jump_within_a_phase(flight):
    # Steps of 10 ms: the force changes by at most 30 m/s^3, the body turns faster by at most 10 deg/s^2.
    for phase in flight().phases:
        m = motion(flight(), np.arange(phase.start, phase.end - 1e-3, 0.01))
        assert np.max(np.abs(np.diff(m.f_b, axis=0))) < 0.3
        assert np.max(np.abs(np.diff(m.w_ib_b, axis=0))) < math.radians(0.1)


@FLIGHTS
def test_quaternions_are_unit(flight):
    q_b_i = motion(flight(), np.linspace(flight().start, flight().end, 5000)).q_b_i
    assert np.max(np.abs(np.linalg.norm(q_b_i, axis=1) - 1.0)) < 1e-14


@FLIGHTS
def test_energy_is_kept_in_the_final_coast(flight):
    coast = flight().phases[-1]
    m = motion(flight(), np.linspace(coast.start, coast.end, 200))
    energy = 0.5 * np.sum(m.v_i**2, axis=1) - [potential_j4(*r) for r in m.r_i]
    assert np.ptp(energy) < 1e-9 * abs(energy[0])
    assert np.max(np.abs(m.f_b)) < 1e-6


@FLIGHTS
def test_body_rate_is_the_derivative_of_attitude(flight):
    t, h = np.linspace(1.0, flight().end - 1.0, 400), 1e-3
    q0, q1 = motion(flight(), t - h).q_b_i, motion(flight(), t + h).q_b_i
    C0, C1 = matrices(q0), matrices(q1)
    turn = np.einsum("kji,kjl->kil", C0, C1)
    rate = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1) / (2.0 * h)
    assert np.max(np.abs(rate - motion(flight(), t).w_ib_b)) < 2e-6


def test_at_a_jump_the_value_just_after_it_is_given():
    flight = ascent()
    cutoff = flight.events["stage1_cutoff"]
    m = motion(flight, [cutoff - 1e-6, cutoff])
    assert m.f_b[0, 0] > 50.0
    assert abs(m.f_b[1, 0]) < 0.1


def test_increments_of_long_ticks_are_sums_of_short_ones_across_jumps_of_thrust():
    # Cut-off falls inside a tick; the integrals are additive only where the tick is split there (0.3 m/s otherwise).
    # Rounding of positions of 6e6 m leaves 4e-7 m/s^2.
    slow, fast = reference(ascent(), 50.0), reference(ascent(), 200.0)
    n = len(slow.dvel)
    for long, short in ((slow.dvel, fast.dvel), (slow.dtheta, fast.dtheta)):
        assert np.max(np.abs(long - short[: 4 * n].reshape(n, 4, 3).sum(axis=1))) < 2e-8


def test_ticks_go_from_the_start_to_the_end_and_carry_the_motion():
    flight = ascent()
    ref = reference(flight, 10.0)
    assert ref.t[0] == flight.start
    assert flight.end - ref.t[-1] < 0.1
    assert np.allclose(np.diff(ref.t), 0.1, rtol=0.0, atol=1e-12)
    assert np.array_equal(ref.r_i, motion(flight, ref.t).r_i)


def test_a_time_outside_the_flight_is_refused():
    with pytest.raises(ValueError, match="the trajectory has -60"):
        motion(ascent(), [1e4])


def spinning(frequency="1.7 Hz", attitude=None):
    """A flight under a force that stands still in frame i, of a body that spins up and then turns evenly."""
    force = np.array([12.0, -30.0, 8.0])
    still = attitude or (lambda t: np.tile([1.0, 0.0, 0.0, 0.0], (t.size, 1)))
    flight = building.flight([(20.0, lambda t: force)], still)
    step = SpinStep.model_validate({"at": "2 s", "frequency": frequency, "over": "3 s"})
    spin = spin_angle((step,), {}, 0.0, 20.0)
    phases = tuple(phase._replace(roll_angle=spin) for phase in flight.phases)
    return Trajectory(phases, flight.events, flight.theta0, flight.epoch), force, spin


@pytest.mark.parametrize(("frequency", "rate"), [("1.7 Hz", 400.0), ("1.7 Hz", 50.0), ("-6 Hz", 100.0)])
def test_increments_of_a_spinning_body_are_the_closed_form(frequency, rate):
    # Even spin w: the angle is w dt, and a force that stands still, seen by the body, integrates to sines and cosines.
    flight, force, spin = spinning(frequency)
    ref = reference(flight, rate)
    first = int(np.searchsorted(ref.t, 6.0))
    w = float(spin(10.0, 1))
    assert np.max(np.abs(ref.dtheta[first:] - [w / rate, 0.0, 0.0])) < 1e-13
    angle = spin(ref.t)
    s, c = np.diff(np.sin(angle))[first:] / w, -np.diff(np.cos(angle))[first:] / w
    expected = np.column_stack(
        [np.full(s.size, force[0] / rate), force[1] * s + force[2] * c, force[2] * s - force[1] * c]
    )
    # Rounding of positions of 6e6 m leaves 4e-7 m/s^2.
    assert np.max(np.abs(ref.dvel[first:] - expected)) < 4e-7 / rate


def test_the_rate_of_a_spinning_body_is_the_derivative_of_its_attitude():
    flight, _, _ = spinning(attitude=building.turning)
    t, h = np.linspace(1.0, 19.0, 300), 1e-4
    slope = (motion(flight, t + h).q_b_i - motion(flight, t - h).q_b_i) / (2.0 * h)
    here = motion(flight, t)
    rate = 2.0 * product(here.q_b_i * [1.0, -1.0, -1.0, -1.0], slope)[:, 1:]
    assert np.max(np.abs(rate - here.w_ib_b)) < 5e-6


def test_a_spin_turns_the_body_about_its_own_axis():
    flight, _, spin = spinning(attitude=building.turning)
    bare = Trajectory(tuple(Phase(*phase[:5]) for phase in flight.phases), {}, 0.0, "")
    t = np.linspace(0.0, 20.0, 50)
    C, C_bare = matrices(motion(flight, t).q_b_i), matrices(motion(bare, t).q_b_i)
    assert np.max(np.abs(C[:, :, 0] - C_bare[:, :, 0])) < 1e-12
    assert np.max(np.abs(np.einsum("ki,ki->k", C[:, :, 1], C_bare[:, :, 2]) - np.sin(spin(t)))) < 1e-11
