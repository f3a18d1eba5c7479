"""Derivatives of a piece of the reference flight by its initial state, guidance state and inputs, as differences."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.jit import array_jit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.equations_of_motion import Propulsion, height_above
from lvnav_trade.trajectory.guided.draws import WIND_TOP
from lvnav_trade.trajectory.guided.explicit import LAMBDA, N_LAW_STATE, REFERENCE, STARTED, TURN
from lvnav_trade.trajectory.guided.guided_dynamics import AscentInputs, guide, step

MASS = 6
"""Index of the mass in a state, after position and velocity."""
# Steps of the central differences. Their second order is a millionth of the first, round-off less.
MOTION_STEPS = np.array([10.0] * 3 + [0.1] * 3 + [1e-5] + [1e-4] * 3)  # m, m/s, a share of the mass, a direction
ERROR_STEPS = np.array([1e-4] * 3 + [0.1] * 3 + [10.0] * 3)  # rad, m/s, m
# Of the state of guidance, see `explicit`; 0: constant
_LAW_STEPS = np.array([0.1] * 3 + [10.0] * 9 + [1e-4] * 3 + [1e-6] * 3 + [1e-2] * 3 + [0.1] * 3 + [0.0] * 2)

# Part of the state of guidance that determines the command between two passes
_STEERING = np.array([*range(LAMBDA, LAMBDA + 3), *range(TURN, TURN + 3), REFERENCE])


class Piece(NamedTuple):
    """A piece of the reference flight.

    begin : s since lift-off.
    end : s since lift-off.
    y : (n_motion,). Initial state: 7 numbers, or 10 of a body that follows its command with a lag.
    law_state : (N_LAW_STATE,). State of guidance before its pass at the start.
    longest : s. Longest step of integration.
    engine : Propulsion.
    inputs : Navigation errors, wind and other inputs.
    is_guided : Whether explicit guidance steers it, with a pass at its start.
    """

    begin: float
    end: float
    y: Floats
    law_state: Floats
    longest: float
    engine: Propulsion
    inputs: AscentInputs
    is_guided: bool


@array_jit
def guidance_pass(piece: Piece, y: Floats, law_state: Floats) -> Floats:
    """Return the state of guidance (N_LAW_STATE,) after its pass at the start of a piece.

    y : (n_motion,). True state at the start, see `Piece`.
    law_state : (N_LAW_STATE,). State of guidance before the pass.
    """
    law = piece.inputs.law
    law.state[:] = law_state
    if piece.is_guided:
        guide(piece.begin, y, piece.engine, piece.inputs)
    return law.state.copy()


@array_jit
def final_state(piece: Piece, y: Floats, law_state: Floats) -> Floats:
    """Return the state (n_motion,) at the end of a piece.

    y : (n_motion,). True state at the start, see `Piece`.
    law_state : (N_LAW_STATE,). State of guidance after its pass at the start.
    """
    piece.inputs.law.state[:] = law_state
    span = piece.end - piece.begin
    n_step = max(1, math.ceil(span / piece.longest - 1e-9))
    length = span / n_step
    for k in range(n_step):
        t = piece.begin + k * span / n_step
        y = step(t, length, y, piece.engine, piece.inputs)
    return y


@array_jit
def _motion_step(y: Floats, k: int) -> float:
    """Return the step of number k of a state."""
    if k == MASS:
        return MOTION_STEPS[k] * y[k]
    return MOTION_STEPS[k]


@array_jit
def pass_derivatives(piece: Piece, entry: int) -> tuple[Floats, Floats]:
    """Return the derivatives of the state of guidance after the pass at the start of a piece.

    Parameters
    ----------
    piece : Piece
    entry : int
        Index of the navigation errors that apply at the start.

    Returns
    -------
    (N_LAW_STATE, n_motion + N_LAW_STATE)
        By state, and by the state of guidance before the pass.
    (9, N_LAW_STATE)
        By the navigation errors.
    """
    n_motion = piece.y.size
    by_state = np.zeros((N_LAW_STATE, n_motion + N_LAW_STATE))
    by_error = np.zeros((ERROR_STEPS.size, N_LAW_STATE))
    y, law_state, error = piece.y.copy(), piece.law_state.copy(), piece.inputs.navigation.error
    for k in range(n_motion):
        nominal = y[k]
        size = _motion_step(y, k)
        y[k] = nominal + size
        high = guidance_pass(piece, y, law_state)
        y[k] = nominal - size
        low = guidance_pass(piece, y, law_state)
        by_state[:, k] = (high - low) / (2.0 * size)
        y[k] = nominal
    for k in range(N_LAW_STATE if law_state[STARTED] > 0.0 else 0):
        nominal = law_state[k]
        size = _LAW_STEPS[k]
        if size > 0.0:
            law_state[k] = nominal + size
            high = guidance_pass(piece, y, law_state)
            law_state[k] = nominal - size
            low = guidance_pass(piece, y, law_state)
            by_state[:, n_motion + k] = (high - low) / (2.0 * size)
            law_state[k] = nominal
    for column in range(3, ERROR_STEPS.size):  # guidance reads velocity and position
        nominal = error[entry, column]
        size = ERROR_STEPS[column]
        error[entry, column] = nominal + size
        high = guidance_pass(piece, y, law_state)
        error[entry, column] = nominal - size
        low = guidance_pass(piece, y, law_state)
        by_error[column] = (high - low) / (2.0 * size)
        error[entry, column] = nominal
    return by_state, by_error


@array_jit
def state_derivatives(piece: Piece, law_state: Floats) -> Floats:
    """Return the derivative (n_motion, n_motion + N_LAW_STATE) of the final state of a piece.

    It is by the initial state, and by the state of guidance after its pass, `law_state`.
    """
    n_motion = piece.y.size
    derivative = np.zeros((n_motion, n_motion + N_LAW_STATE))
    y, law_state = piece.y.copy(), law_state.copy()
    for k in range(n_motion):
        nominal = y[k]
        size = _motion_step(y, k)
        y[k] = nominal + size
        high = final_state(piece, y, law_state)
        y[k] = nominal - size
        low = final_state(piece, y, law_state)
        derivative[:, k] = (high - low) / (2.0 * size)
        y[k] = nominal
    for k in _STEERING if piece.is_guided else _STEERING[:0]:
        nominal = law_state[k]
        size = _LAW_STEPS[k]
        law_state[k] = nominal + size
        high = final_state(piece, y, law_state)
        law_state[k] = nominal - size
        low = final_state(piece, y, law_state)
        derivative[:, n_motion + k] = (high - low) / (2.0 * size)
        law_state[k] = nominal
    return derivative


@array_jit
def table_derivatives(piece: Piece, law_state: Floats, table: Floats, rows: tuple[int, int], steps: Floats) -> Floats:
    """Return the derivative (n_row, n_column, n_motion) of the final state of a piece by a table among its inputs.

    Parameters
    ----------
    piece : Piece
    law_state : (N_LAW_STATE,)
        State of guidance after its pass.
    table : (n, n_column or more)
        Table of the inputs: navigation errors or wind.
    rows : (int, int)
        First and last row to change.
    steps : (n_column,)
        Steps of the first columns.
    """
    first, last = rows
    derivative = np.zeros((last - first + 1, steps.size, piece.y.size))
    for row in range(first, last + 1):
        for column in range(steps.size):
            nominal = table[row, column]
            size = steps[column]
            table[row, column] = nominal + size
            high = final_state(piece, piece.y, law_state)
            table[row, column] = nominal - size
            low = final_state(piece, piece.y, law_state)
            derivative[row - first, column] = (high - low) / (2.0 * size)
            table[row, column] = nominal
    return derivative


def has_attitude_effect(piece: Piece) -> bool:
    """Return whether an attitude error changes the motion: under thrust, and with a lag in coasts as well."""
    engine = piece.engine
    return engine.thrust > 0.0 or engine.unthrottled_motors.thrust > 0.0 or piece.inputs.lag > 0.0


def wind_rows(piece: Piece, law_state: Floats) -> tuple[int, int] | None:
    """Return the first and the last entry of the wind that a piece depends on; None for none."""
    wind = piece.inputs.wind
    end_y = final_state(piece, piece.y, law_state)
    begin_height = height_above(*piece.y[:3])
    end_height = height_above(*end_y[:3])
    low = min(begin_height, end_height)
    high = max(begin_height, end_height)
    if low >= WIND_TOP or len(wind.speed) <= 1:
        return None
    last = len(wind.speed) - 1
    first_row = min(max(0, math.floor(low / wind.step)), last)
    last_row = min(max(0, math.ceil(high / wind.step)), last)
    return first_row, last_row
