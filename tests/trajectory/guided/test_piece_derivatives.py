"""Derivatives of a piece of a guided ascent against the motion of a point in free fall and under thrust."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.trajectory.ascent.equations_of_motion import Propulsion
from lvnav_trade.trajectory.ascent.legs import COASTING
from lvnav_trade.trajectory.guided.draws import deviations
from lvnav_trade.trajectory.guided.explicit import N_LAW_STATE
from lvnav_trade.trajectory.guided.guided_dynamics import NavigationErrors, step
from lvnav_trade.trajectory.guided.piece_derivatives import (
    ERROR_STEPS,
    Piece,
    final_state,
    guidance_pass,
    pass_derivatives,
    state_derivatives,
    table_derivatives,
)
from lvnav_trade.trajectory.guided.pilots import GuidedPilot
from tests.trajectory.guided.cases import plan

SPAN = 2.0


def piece(engine: Propulsion = COASTING, steers: bool = False) -> Piece:
    known = plan()
    navigation = NavigationErrors(np.arange(0.0, known.cutoff + 20.0), np.zeros((int(known.cutoff) + 20, 9)))
    pilot = GuidedPilot(known, known.card, deviations(known.card, {}), navigation)
    begin = known.cutoff - 100.0
    inputs = pilot.inputs._replace(law=pilot.inputs.law._replace(start=begin))
    y = known.nominal.copy()
    return Piece(begin, begin + SPAN, y, np.zeros(N_LAW_STATE), 0.5, engine, inputs, steers)


def test_a_coast_moves_by_its_velocity_and_keeps_its_mass():
    coast = piece()
    derivative = state_derivatives(coast, coast.law_state)
    np.testing.assert_allclose(derivative[:3, 3:6], SPAN * np.eye(3), atol=1e-4)
    np.testing.assert_allclose(derivative[:6, :6].diagonal(), 1.0, atol=1e-5)
    assert derivative[6, 6] == pytest.approx(1.0)
    assert not derivative[:, 7:].any()  # guidance does not steer it


def test_a_piece_ends_where_steps_of_the_longest_length_end():
    coast = piece()
    y = coast.y
    for k in range(4):
        y = step(coast.begin + 0.5 * k, 0.5, y, coast.engine, coast.inputs)
    np.testing.assert_array_equal(final_state(coast, coast.y, coast.law_state), y)


def test_a_tilt_of_the_thrust_changes_the_velocity_by_thrust_acceleration_and_time():
    acceleration = 20.0
    burn = piece(Propulsion(acceleration * piece().y[6], 0.0, 0.0, np.inf))
    entry = int(burn.begin)
    error = burn.inputs.navigation.error
    by_tilt = table_derivatives(burn, burn.law_state, error, (entry, entry + 2), ERROR_STEPS[:3])
    total = np.linalg.norm(by_tilt.sum(axis=0)[:, 3:6], axis=1)
    assert total.max() == pytest.approx(acceleration * SPAN, rel=0.2)
    assert not error.any()  # the table is left as it was


def test_a_pass_of_guidance_reads_velocity_and_position_and_not_the_attitude():
    steered = piece(Propulsion(20.0 * piece().y[6], 20.0 * piece().y[6] / 3000.0, 0.0, np.inf), steers=True)
    entry = int(steered.begin)
    _, by_error = pass_derivatives(steered, entry)
    assert not by_error[:3].any()
    assert by_error[3:].any(axis=1).all()
    assert guidance_pass(steered, steered.y, steered.law_state).any()
