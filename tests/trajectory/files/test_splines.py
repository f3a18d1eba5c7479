"""Splines through rows, and the attitude along the path."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.frames import earth_velocity, matrices, unit
from lvnav_trade.trajectory.ascent.vehicle_cards import Roll
from lvnav_trade.trajectory.files.row_fit import row_fit
from lvnav_trade.trajectory.files.splines import fit, path_attitude
from lvnav_trade.trajectory.flight import Phase, Trajectory, motion
from tests.trajectory.flight_cases import ascent
from tests.trajectory.tables import card, example_settings

T = np.arange(0.0, 100.05, 0.1)
BREAKS = (33.333, 50.0)


def speed(t):
    """A speed whose derivative jumps at BREAKS, both between rows and on one."""
    end = 10.0 * BREAKS[0] + 0.05 * BREAKS[0] ** 2
    late = end - 9.0 * (BREAKS[1] - BREAKS[0])
    values = [10.0 * t + 0.05 * t**2, end - 9.0 * (t - BREAKS[0]), late + 30.0 * (t - BREAKS[1])]
    return np.select([t < BREAKS[0], t < BREAKS[1]], values[:2], values[2])


def curves(t):
    return np.column_stack([speed(t), 7000.0 + np.sin(t / 3.0)])


def test_rows_without_noise_are_met_and_jumps_of_force_between_rows_are_found():
    found = fit(T, curves(T), BREAKS, 4, 0.0)
    t = np.linspace(0.0, 100.0, 4001)[1:-1]
    assert found.misfit < 1e-9
    assert np.max(np.abs(found.spline(t) - curves(t))) < 1e-3
    force = found.spline(np.array([33.332, 33.334, 49.999, 50.001]), 1)[:, 0]
    assert force == pytest.approx([10.0 + 0.1 * 33.332, -9.0, -9.0, 30.0], abs=0.01)


def test_an_undeclared_jump_makes_the_spline_swing():
    # what the declared break is worth: ten times the error without it
    t = np.linspace(33.0, 34.0, 501)
    with_break, without = (np.max(np.abs(fit(T, curves(T), b, 4, 0.0).spline(t) - curves(t))) for b in (BREAKS, ()))
    assert without > 10.0 * with_break


def test_noisy_rows_are_left_by_their_noise_and_the_noise_does_not_become_force():
    rng = np.random.default_rng(7)
    noisy = curves(T) + rng.normal(0.0, 0.05, (T.size, 2))
    found = fit(T, noisy, BREAKS, 4, 0.05)
    assert found.misfit == pytest.approx(0.05, rel=0.01)
    t = np.linspace(1.0, 99.0, 2000)
    t = t[np.min(np.abs(t[:, None] - np.array(BREAKS)), axis=1) > 0.5]
    sharp = fit(T, noisy, BREAKS, 4, 0.0)
    true = fit(T, curves(T), BREAKS, 4, 0.0).spline(t, 1)
    smooth, rough = (np.sqrt(np.mean((f.spline(t, 1) - true) ** 2)) for f in (found, sharp))
    assert smooth < 0.1 * rough


def test_a_step_of_the_rows_is_found_and_the_spline_goes_on_without_it():
    true = np.column_stack(
        [5.0 * T**2 + 20.0 * np.maximum(T - 50.0, 0.0) ** 2, np.sin(T / 3.0)]
    )  # force jumps there too
    found = fit(T, true + np.outer(T >= 50.0, [3.0, 0.0]), [50.0], 5, 0.0, [50.0])
    assert found.steps[0] == pytest.approx([3.0, 0.0], abs=1e-3)
    assert np.max(np.abs(found.spline(T) - true)) < 2e-3


def test_breaks_closer_than_the_rows_do_no_harm():
    found = fit(T, curves(T), sorted((*BREAKS, 33.334, 60.01, 60.02, 60.03)), 4, 0.0)
    assert np.all(np.isfinite(found.spline(np.linspace(0.0, 100.0, 999), 2)))
    assert found.misfit < 1e-6


EDGES = [0.0, 150.4932, 153.4932, 158.4932, 183.4932, 549.3082, 569.0]


def build_trajectory(along, edges=EDGES, hold=60.0):
    path = row_fit(card(example_settings()))
    spline = path_attitude(path.position, edges, path.rows.theta0, along, Roll(), hold)
    phases = tuple(Phase("", a, b, path.position, spline) for a, b in pairwise(edges))
    return Trajectory(phases, {}, path.rows.theta0, ""), spline


def test_the_roll_axis_lies_along_the_specific_force_while_there_is_thrust():
    flight, _ = build_trajectory("thrust")
    t = np.concatenate([np.linspace(1.0, 150.0, 50), np.linspace(184.0, 549.0, 50)])
    nose = matrices(motion(flight, t).q_b_i)[:, :, 0]
    meant = matrices(motion(ascent(), t).q_b_i)[:, :, 0]
    assert np.max(np.abs(motion(flight, t).f_b[:, 1:])) < 0.01
    # the shipped flight thrusts along its axis; drag in the first stage turns the force by a fraction of a degree
    assert np.degrees(np.max(np.arccos(np.clip(np.sum(nose * meant, axis=1), -1, 1)))) < 0.5


def test_the_body_turns_through_coasts_without_haste():
    flight, _ = build_trajectory("thrust")
    w = np.linalg.norm(motion(flight, np.linspace(0.0, 569.0, 4000)).w_ib_b, axis=1)
    assert np.degrees(np.max(w)) < 3.0


def test_the_body_stands_still_on_the_pad():
    _, spline = build_trajectory("thrust")
    q = unit(spline(np.array([-60.0, -30.0, -10.0])))
    turned = [2.0 * np.arccos(min(1.0, abs(q[0] @ other))) for other in q[1:]]
    assert turned == pytest.approx([30.0 * 7.292115e-5, 50.0 * 7.292115e-5], rel=1e-4)


def test_along_the_velocity_the_body_flies_into_the_wind_and_stands_upright_at_rest():
    flight, _ = build_trajectory("velocity")
    m = motion(flight, np.linspace(10.0, 568.0, 100))
    assert np.min(np.sum(matrices(m.q_b_i)[:, :, 0] * unit(earth_velocity(m.r_i, m.v_i)), axis=1)) > 1.0 - 1e-6
    start = motion(flight, [0.0])
    assert matrices(start.q_b_i)[0, :, 0] @ unit(start.r_i)[0] > np.cos(np.radians(0.25))  # geodetic, not geocentric


def test_a_flight_without_thrust_has_nothing_to_point_along():
    with pytest.raises(InputError, match="no thrust to point along: give columns of attitude, or pointing: velocity"):
        build_trajectory("thrust", [549.3083, 569.0], hold=0.0)
