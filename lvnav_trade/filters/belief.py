"""What a filter card means in numbers: state layout, blocks of the transition, noise, rows. No truth enters here."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.filters.base import FilterCard, ImuBelief, InitialBelief, ReceiverBelief
from lvnav_trade.kernels import strapdown, transition
from lvnav_trade.kernels.clock import spectral_densities
from lvnav_trade.kernels.transition import ATT, GYRO, POS, VEL
from lvnav_trade.layout import PARAMETERS, ParameterBlock, StateLayout
from lvnav_trade.observables.base import H_ATT, H_CLOCK, H_POS, H_VEL

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

INERTIAL, LOOSE, TIGHT = 0, 1, 2
KINDS = {"inertial": INERTIAL, "loose": LOOSE, "tight": TIGHT}
PSEUDORANGE, RANGE_RATE, POSITION, VELOCITY = 0, 1, 2, 3
N_ROW_TYPE = 4


class Belief(NamedTuple):
    """A filter in numbers, for the kernels. Index arrays int64; per-window tables by window length.

    kind (INERTIAL, LOOSE, TIGHT); gravity code; block_rows, block_columns, block_kinds, block_drivers (n_block,);
    seconds (n_length,) distinct window lengths, decay and noise (n_length, n_state) per length; clock index;
    n_estimated, n_state; par_sensor, par_driver, par_offset (n_par,); lean (only biases are carried); fading (any
    decay); gate_squared; joseph; group (ticks to a strapdown step); variance (4,) by row type; n_entry (4,), entry
    and column (4, 10) by row type; lever (3,) m.
    """

    kind: int
    gravity: int
    block_rows: Ints
    block_columns: Ints
    block_kinds: Ints
    block_drivers: Ints
    seconds: Floats
    decay: Floats
    noise: Floats
    clock: int
    n_estimated: int
    n_state: int
    par_sensor: Ints
    par_driver: Ints
    par_offset: Ints
    lean: bool
    fading: bool
    gate_squared: float
    joseph: bool
    group: int
    variance: Floats
    n_entry: Ints
    entry: Ints
    column: Ints
    lever: Floats


def _parameter_numbers(imu: ImuBelief, name: str) -> tuple[float, float, float]:
    """Return sigma, walk and time constant (inf: none) of a kind of parameter."""
    if name == "gyro_bias":
        return imu.gyro_bias, imu.gyro_bias_walk, imu.gyro_bias_time or math.inf
    if name == "accel_bias":
        return imu.accel_bias, imu.accel_bias_walk, imu.accel_bias_time or math.inf
    return getattr(imu, name), 0.0, math.inf


def state_layout(card: FilterCard, imu: ImuBelief) -> StateLayout:
    """Lay out the states of a filter: navigation, estimated parameters, clock, considered parameters."""
    considered = [name for name in card.consider if name in PARAMETERS]
    names = [n for n in ("gyro_bias", "accel_bias", *card.extra_states) if n not in card.neglect]
    estimated = [name for name in names if name not in considered]
    offset, blocks = 9, []
    clock = -1
    for group in (estimated, considered):
        for name in group:
            sigma, walk, time_constant = _parameter_numbers(imu, name)
            kind = PARAMETERS[name]
            for part, driven_by in enumerate(kind.drivers):
                blocks.append(ParameterBlock(name, part, offset, kind.sensor, driven_by, sigma, walk, time_constant))
                offset += 3
        if group is estimated:
            if card.kind == "tight":
                clock, offset = offset, offset + 2
            n_estimated = offset
    return StateLayout(tuple(blocks), clock, n_estimated, offset)


def transition_blocks(parameters: tuple[ParameterBlock, ...], order: int) -> tuple[Ints, Ints, Ints, Ints]:
    """List the 3 x 3 blocks of Phi - I in the first nine rows: rows, columns, kinds, drivers.

    Order 1 keeps the terms linear in the window, order 2 all that `transition` knows.
    """
    found = [(VEL, ATT, transition.VEL_ATT, 0), (VEL, POS, transition.VEL_POS, 0), (POS, VEL, transition.POS_VEL, 0)]
    if order >= 2:
        found += [
            (POS, ATT, transition.POS_ATT, 0),
            (VEL, VEL, transition.VEL_VEL, 0),
            (POS, POS, transition.POS_POS, 0),
        ]
    for block in parameters:
        at, by = block.offset, block.driver
        if block.sensor == GYRO:
            found.append((ATT, at, transition.ATT_GYRO, by))
            if order >= 2:
                found += [(VEL, at, transition.VEL_GYRO, by), (POS, at, transition.POS_GYRO, by)]
        else:
            found.append((VEL, at, transition.VEL_ACCEL, by))
            if order >= 2:
                found.append((POS, at, transition.POS_ACCEL, by))
    rows, columns, kinds, drivers = (np.array(values, dtype=np.int64) for values in zip(*found, strict=True))
    return rows, columns, kinds, drivers


def window_tables(layout: StateLayout, densities: Floats, seconds: Floats) -> tuple[Floats, Floats]:
    """Return decay and noise variance of every state over windows of the given lengths, (n_length, n_state) each.

    densities (n_state,): noise PSD of each state; for a Gauss-Markov parameter the noise that holds its sigma is added.
    """
    decay = np.ones((seconds.size, layout.n_state))
    noise = seconds[:, None] * densities
    for block in layout.parameters:
        if math.isfinite(block.time_constant):
            states = slice(block.offset, block.offset + 3)
            decay[:, states] = np.exp(-seconds / block.time_constant)[:, None]
            # half of it enters before the decay d, half after: 2 (1 - d^2) / (1 + d^2) of the variance then holds it
            noise[:, states] += 2.0 * block.sigma**2 * np.tanh(seconds / block.time_constant)[:, None]
    return decay, noise


def _densities(card: FilterCard, layout: StateLayout, imu: ImuBelief, receiver: ReceiverBelief) -> Floats:
    found = np.zeros(layout.n_state)
    found[ATT : ATT + 3] = imu.gyro_random_walk**2 + card.attitude_noise**2
    found[VEL : VEL + 3] = imu.accel_random_walk**2 + card.velocity_noise**2
    for block in layout.parameters:
        found[block.offset : block.offset + 3] = block.walk**2
    if layout.clock >= 0:
        found[layout.clock : layout.clock + 2] = spectral_densities(receiver.clock_h0, receiver.clock_h_minus2)
    return found


def _row_tables(layout: StateLayout, has_lever: bool) -> tuple[Ints, Ints, Ints]:
    """Return per row type how many entries it has, which, and the states that they stand for."""
    position = [(H_POS + i, POS + i) for i in range(3)]
    velocity = [(H_VEL + i, VEL + i) for i in range(3)]
    attitude = [(H_ATT + i, ATT + i) for i in range(3)] if has_lever else []
    bias = [(H_CLOCK, layout.clock)] if layout.clock >= 0 else []
    drift = [(H_CLOCK, layout.clock + 1)] if layout.clock >= 0 else []
    types = [
        position + attitude + bias,
        position + attitude + velocity + drift,
        position + attitude,
        velocity + attitude,
    ]
    count = np.array([len(pairs) for pairs in types], dtype=np.int64)
    entry, column = np.zeros((N_ROW_TYPE, 10), dtype=np.int64), np.zeros((N_ROW_TYPE, 10), dtype=np.int64)
    for t, pairs in enumerate(types):
        for i, (e, c) in enumerate(pairs):
            entry[t, i], column[t, i] = e, c
    return count, entry, column


def believe(
    card: FilterCard,
    imu: ImuBelief,
    receiver: ReceiverBelief,
    lever: tuple[float, float, float],
    seconds: Floats,
    group: int = 1,
) -> tuple[StateLayout, Belief]:
    """Turn a filter card and its beliefs into numbers.

    seconds (n_length,) are the window lengths that will occur; group the ticks of the unit to a strapdown step.
    """
    layout = state_layout(card, imu)
    rows, columns, kinds, drivers = transition_blocks(layout.parameters, card.transition_order)
    decay, noise = window_tables(layout, _densities(card, layout, imu, receiver), seconds)
    count, entry, column = _row_tables(layout, any(lever))
    deviations = (
        receiver.pseudorange_sigma, receiver.range_rate_sigma, receiver.position_sigma, receiver.velocity_sigma,
    )  # fmt: skip
    belief = Belief(
        kind=KINDS[card.kind],
        gravity={"point": strapdown.POINT, "j2": strapdown.J2, "j4": strapdown.J4}[card.gravity],
        block_rows=rows,
        block_columns=columns,
        block_kinds=kinds,
        block_drivers=drivers,
        seconds=seconds,
        decay=decay,
        noise=noise,
        clock=layout.clock,
        n_estimated=layout.n_estimated,
        n_state=layout.n_state,
        par_sensor=np.array([b.sensor for b in layout.parameters], dtype=np.int64),
        par_driver=np.array([b.driver for b in layout.parameters], dtype=np.int64),
        par_offset=np.array([b.offset for b in layout.parameters], dtype=np.int64),
        lean=all(b.driver == transition.CONSTANT for b in layout.parameters),
        fading=any(math.isfinite(b.time_constant) for b in layout.parameters),
        gate_squared=math.inf if card.gate is None else card.gate**2,
        joseph=card.update == "joseph",
        group=group,
        variance=np.array(deviations) ** 2,
        n_entry=count,
        entry=entry,
        column=column,
        lever=np.array(lever, dtype=float),
    )
    return layout, belief


def initial_covariance(layout: StateLayout, initial: InitialBelief, C_n_i: Floats) -> Floats:
    """Return the filter's covariance (n_state, n_state) at the start; C_n_i (3, 3) of the starting point."""
    P = np.zeros((layout.n_state, layout.n_state))
    tilt = np.diag([initial.tilt**2, initial.tilt**2, initial.heading**2])
    P[ATT : ATT + 3, ATT : ATT + 3] = C_n_i @ tilt @ C_n_i.T
    P[VEL : VEL + 3, VEL : VEL + 3] = np.eye(3) * initial.velocity**2
    P[POS : POS + 3, POS : POS + 3] = np.eye(3) * initial.position**2
    for block in layout.parameters:
        for i in range(block.offset, block.offset + 3):
            P[i, i] = block.sigma**2
    if layout.clock >= 0:
        P[layout.clock, layout.clock] = initial.clock_bias**2
        P[layout.clock + 1, layout.clock + 1] = initial.clock_drift**2
    return P
