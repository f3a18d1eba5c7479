"""A body of which only the path is known points along its thrust, or along its velocity."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from lvnav_trade.errors import InputError
from lvnav_trade.frames import earth_velocity, matrices, unit
from lvnav_trade.world.ascent.vehicle import Roll
from lvnav_trade.world.flight.trajectory import Phase, Trajectory, motion
from lvnav_trade.world.user_file.roll_axis import along_path
from lvnav_trade.world.user_file.table import _path_of
from tests.world.flights import ascent
from tests.world.tables import card, example_settings

EDGES = [0.0, 150.4932, 153.4932, 158.4932, 183.4932, 549.3082, 569.0]


def flown(along, edges=EDGES, hold=60.0):
    path = _path_of(card(example_settings()))
    spline = along_path(path.position, edges, path.rows.theta0, along, Roll(), hold)
    phases = tuple(Phase("", a, b, path.position, spline) for a, b in pairwise(edges))
    return Trajectory(phases, {}, path.rows.theta0, ""), spline


def test_the_roll_axis_lies_along_the_specific_force_while_there_is_thrust():
    flight, _ = flown("thrust")
    t = np.concatenate([np.linspace(1.0, 150.0, 50), np.linspace(184.0, 549.0, 50)])
    nose = matrices(motion(flight, t).q_b_i)[:, :, 0]
    meant = matrices(motion(ascent(), t).q_b_i)[:, :, 0]
    assert np.max(np.abs(motion(flight, t).f_b[:, 1:])) < 0.01
    # the shipped flight thrusts along its axis; drag in the first stage turns the force by a fraction of a degree
    assert np.degrees(np.max(np.arccos(np.clip(np.sum(nose * meant, axis=1), -1, 1)))) < 0.5


def test_the_body_turns_through_coasts_without_haste():
    flight, _ = flown("thrust")
    w = np.linalg.norm(motion(flight, np.linspace(0.0, 569.0, 4000)).w_ib_b, axis=1)
    assert np.degrees(np.max(w)) < 3.0


def test_the_body_stands_still_on_the_pad():
    _, spline = flown("thrust")
    q = unit(spline(np.array([-60.0, -30.0, -10.0])))
    turned = [2.0 * np.arccos(min(1.0, abs(q[0] @ other))) for other in q[1:]]
    assert turned == pytest.approx([30.0 * 7.292115e-5, 50.0 * 7.292115e-5], rel=1e-4)


def test_along_the_velocity_the_body_flies_into_the_wind_and_stands_upright_at_rest():
    flight, _ = flown("velocity")
    m = motion(flight, np.linspace(10.0, 568.0, 100))
    assert np.min(np.sum(matrices(m.q_b_i)[:, :, 0] * unit(earth_velocity(m.r_i, m.v_i)), axis=1)) > 1.0 - 1e-6
    start = motion(flight, [0.0])
    assert matrices(start.q_b_i)[0, :, 0] @ unit(start.r_i)[0] > np.cos(np.radians(0.25))  # geodetic, not geocentric


def test_a_flight_without_thrust_has_nothing_to_point_along():
    with pytest.raises(InputError, match="no thrust to point along: give columns of attitude, or pointing: velocity"):
        flown("thrust", [549.3083, 569.0], hold=0.0)
