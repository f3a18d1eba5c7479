"""Filter model: transition blocks, noise and Jacobian structure from a filter card, without truth."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.assumed import ImuModel, ReceiverModel
from lvnav_trade.filter.card import FilterCard
from lvnav_trade.filter.states import TYPES, FilterMeasurements, channel_types, clock_gains, extra_tables, row_tables
from lvnav_trade.filter.strapdown_algorithm import build_strapdown
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.clock import spectral_densities
from lvnav_trade.kernels.covariance import N_NAV_ERROR
from lvnav_trade.kernels.strapdown import Strapdown
from lvnav_trade.kernels.transition import ATT, GYRO, POS, VEL
from lvnav_trade.quantities.per_axis import PerAxis, squares
from lvnav_trade.quantities.records import Bools, Floats, Ints
from lvnav_trade.quantities.state_layout import ErrorTerm, StateLayout


class FilterModel(NamedTuple):
    """A filter as arrays for the kernels: states, transition, noise and Jacobian structure.

    Index arrays are int64. A window is a number of IMU ticks that the covariance is propagated over at once; n_length
    different lengths occur.

    has_epochs : Whether epochs are processed: the filter has measurements, or the receiver computes a solution itself.
    tight : Whether the receiver's channels are ranges of satellites (tight coupling).
    has_solver : Whether the receiver computes its solution itself, from ranges.
    is_processed : (n_channel,). Whether the filter processes the channel.
    n_receiver : Number of receiver channels, which are the first; 0 if the filter uses none.
    n_observable : Number of observables of each satellite.
    rate_sign : Sign of the body-rate error in the state that models it: 1 for a rate state, -1 for a gyro bias.
    strapdown : Algorithm of the strapdown.
    block_rows : (n_block,). First row of each 3 x 3 block of the transition matrix.
    block_columns : (n_block,). First column of each block.
    block_kinds : (n_block,). Kind of each block, as in `kernels.transition`.
    block_drivers : (n_block,). Quantity that the parameter of the block multiplies.
    seconds : (n_length,) s. Window lengths.
    decay : (n_length, n_state). Decay factor of each state over a window.
    noise : (n_length, n_state) SI squared. Process-noise variance added over a window; for random walks that differ by
        axis, that of the least.
    excess_density : (2, 3) SI squared per second. PSD of each gyro and accelerometer axis, body axes, in excess of the
        least of the three; None if all axes are alike.
    clock : State of the clock bias, followed by the drift; -1 without a clock.
    n_estimated : Number of states that updates correct; the states from here on are considered.
    n_assessed : Number of states in the NEES.
    n_state : Number of states.
    reported_states : (n_reported,). States of which errors are reported.
    par_sensor : (n_par,). Sensor of each block of IMU parameters: GYRO or ACCEL.
    par_driver : (n_par,). Quantity that the parameter multiplies.
    par_offset : (n_par,). First state of the block.
    biases_only : Whether the IMU parameters are biases only.
    has_decay : Whether any state decays.
    inflation : (n_length,). Factor on standard deviations over a window (fading memory); 1 without.
    h_infinity_weight : (n_length, 9) 1 / SI squared. What an H-infinity filter takes off the inverse covariance of
        attitude, velocity and position over a window; 0 without.
    injected_variance : (n_injection, n_state) SI squared. Variance added at a change of operating region.
    gate_squared : Largest square of a normalised innovation that is accepted; infinite without a gate.
    joseph : Whether the covariance update has Joseph's form.
    channel_type : (n_channel,). Measurement type of the channel, which selects its Jacobian.
    n_entry : (n_channel,). Number of Jacobian entries that are not zero.
    entry : (n_channel, n_entry). Places of these entries in the Jacobian row.
    column : (n_channel, n_entry). States that these entries belong to.
    lever_arms : (n_antenna, 3) m. Antenna phase centres relative to the IMU, body axes.
    extra_offset : (n_extra,). State of each extra state.
    extra_member : (n_extra_family, n_channel). Extra state that enters the channel, -1 none.
    decimation : n, if the filter processes the receiver's measurements of every n-th epoch only.
    has_reported_covariance : Whether solutions come with a reported covariance, by which the filter decorrelates them.
    clock_gain : (n_observable, n_state). Gain by which a reference satellite determines the clock state of an
        observable.
    """

    has_epochs: bool
    tight: bool
    has_solver: bool
    is_processed: Bools
    n_receiver: int
    n_observable: int
    rate_sign: float
    strapdown: Strapdown
    block_rows: Ints
    block_columns: Ints
    block_kinds: Ints
    block_drivers: Ints
    seconds: Floats
    decay: Floats
    noise: Floats
    excess_density: Floats | None
    clock: int
    n_estimated: int
    n_assessed: int
    n_state: int
    reported_states: Ints
    par_sensor: Ints
    par_driver: Ints
    par_offset: Ints
    biases_only: bool
    has_decay: bool
    inflation: Floats
    h_infinity_weight: Floats
    injected_variance: Floats
    gate_squared: float
    joseph: bool
    channel_type: Ints
    n_entry: Ints
    entry: Ints
    column: Ints
    lever_arms: Floats
    extra_offset: Ints
    extra_member: Ints
    decimation: int
    has_reported_covariance: bool
    clock_gain: Floats


def transition_blocks(parameters: tuple[ErrorTerm, ...], order: int) -> tuple[Ints, Ints, Ints, Ints]:
    """Return the 3 x 3 blocks of the transition matrix in the order in which they are applied.

    Parameters
    ----------
    parameters
        Estimated or considered IMU parameters, three states each.
    order
        1: I + F dt, terms linear in the window length. 2: all blocks of `kernels.transition`.

    Returns
    -------
    rows, columns, kinds, drivers
        (n_block,) each. First row, first column, kind as in `kernels.transition`, quantity that the parameter of the
        block multiplies.

    Notes
    -----
    Blocks are applied one after the other. In order 1, position is propagated with the velocity before the window; the
    block VEL_VEL then removes the second-order term that the gravity gradient makes of it. In order 2, position takes
    half of the velocity before the window and half after it.
    """
    gyro = [block for block in parameters if block.sensor == GYRO]
    accel = [block for block in parameters if block.sensor != GYRO]
    if order == 1:
        blocks = [
            (POS, VEL, transition.POS_VEL, 0),
            (VEL, VEL, transition.VEL_VEL, 0),
        ]
    else:
        blocks = [(POS, VEL, transition.POS_VEL_HALF, 0)]
        blocks += [(VEL, block.offset, transition.VEL_GYRO, block.driver) for block in gyro]
    blocks.append((VEL, ATT, transition.VEL_ATT, 0))
    blocks.append((VEL, POS, transition.VEL_POS, 0))
    blocks += [(VEL, block.offset, transition.VEL_ACCEL, block.driver) for block in accel]
    blocks += [(ATT, block.offset, transition.ATT_GYRO, block.driver) for block in gyro]
    if order == 2:
        blocks.append((POS, VEL, transition.POS_VEL_HALF, 0))
    rows, columns, kinds, drivers = np.array(blocks, dtype=np.int64).T.copy()
    return rows, columns, kinds, drivers


def axis_squares(value: PerAxis) -> float | Floats:
    """Return the square of a value that is common to the axes, or the squares (3,) of a value by axis."""
    if isinstance(value, tuple):
        return np.array(squares(value))
    return value**2


def state_blocks(layout: StateLayout) -> list[tuple[slice, PerAxis, float]]:
    """Return states, one-sigma (SI) and time constant (s) of every block of IMU parameters and of extra states."""
    blocks: list[tuple[slice, PerAxis, float]] = []
    for parameter in layout.parameters:
        states = slice(parameter.offset, parameter.offset + 3)
        blocks.append((states, parameter.sigma, parameter.time_constant))
    for extra in layout.extras:
        states = slice(extra.offset, extra.offset + len(extra.labels))
        blocks.append((states, extra.sigma, extra.time_constant))
    return blocks


def window_tables(layout: StateLayout, densities: Floats, seconds: Floats) -> tuple[Floats, Floats]:
    """Return decay factor and process-noise variance of every state over windows of the given lengths.

    Parameters
    ----------
    layout
        States of the filter.
    densities
        (n_state,) SI squared per second. PSD of the noise of each state.
    seconds
        (n_length,) s. Window lengths.

    Returns
    -------
    decay, noise
        (n_length, n_state) each. A Gauss-Markov state has d = exp(-t / T) and, in addition to its PSD, the variance
        that keeps its sigma constant.
    """
    decay = np.ones((seconds.size, layout.n_state))
    noise = seconds[:, None] * densities
    for states, sigma, time_constant in state_blocks(layout):
        if math.isfinite(time_constant):
            state_decay = np.exp(-seconds / time_constant)
            decay[:, states] = state_decay[:, None]
            # half of the noise q enters before the decay d, half after: s^2 = d^2 (s^2 + q / 2) + q / 2 gives
            # q = 2 s^2 (1 - d^2) / (1 + d^2), which is 2 s^2 tanh(t / T)
            state_noise = 2.0 * axis_squares(sigma) * np.tanh(seconds / time_constant)[:, None]
            noise[:, states] += state_noise
    return decay, noise


def _densities(card: FilterCard, layout: StateLayout, imu: ImuModel, receiver: ReceiverModel, drift: float) -> Floats:
    """Return the PSD of the process noise of each state, (n_state,), SI squared per second; drift m/s one-sigma."""
    densities = np.zeros(layout.n_state)
    # with a model of the vehicle the noise of IMU samples is measurement noise and must not be counted twice
    has_imu_noise = layout.motion < 0
    least_gyro_density = min(squares(imu.gyro_random_walk))
    least_accel_density = min(squares(imu.accel_random_walk))
    gyro_density = has_imu_noise * least_gyro_density
    accel_density = has_imu_noise * least_accel_density
    densities[ATT : ATT + 3] = gyro_density + card.attitude_noise**2
    densities[VEL : VEL + 3] = accel_density + card.velocity_noise**2
    densities[POS : POS + 3] = card.position_noise**2
    for block in layout.parameters:
        states = slice(block.offset, block.offset + 3)
        densities[states] = axis_squares(block.walk)
    for extra in layout.extras:
        states = slice(extra.offset, extra.offset + len(extra.labels))
        densities[states] = axis_squares(extra.walk)
    if layout.clock >= 0:
        bias_density, drift_density = spectral_densities(receiver.clock_h0, receiver.clock_h_minus2)
        if layout.has_reduced_clock:
            # after one update interval T the bias variance equals that of the two-state clock with drift s:
            # q_bias T + q_drift T^3 / 3 + s^2 T^2
            interval = 1.0 / card.update_rate
            integrated_drift = drift_density * interval**2 / 3.0
            initial_drift = drift**2 * interval
            bias_density = bias_density + integrated_drift + initial_drift
            drift_density = 0.0
        densities[layout.clock] = bias_density
        densities[layout.clock + 1] = drift_density
    return densities


def _excess_densities(layout: StateLayout, imu: ImuModel) -> Floats | None:
    """Return the PSD of each axis in excess of the least of the three, (2, 3); None if all axes are alike.

    The excess is not negative, so adding it keeps a covariance positive definite.
    """
    walks = (imu.gyro_random_walk, imu.accel_random_walk)
    differs_by_axis = any(isinstance(walk, tuple) for walk in walks)
    if layout.motion >= 0 or not differs_by_axis:
        return None
    densities = np.array([squares(walk) for walk in walks])
    return densities - densities.min(axis=1, keepdims=True)


def _count_corrected(card: FilterCard, layout: StateLayout) -> int:
    """Return the number of states that updates correct: those of the earlier epoch of differences may be among them."""
    if not layout.n_earlier_epoch:
        return layout.n_estimated
    n_corrected = layout.earlier_epoch + layout.n_earlier_epoch
    if card.delayed_state == "consider":
        n_corrected -= len(layout.cloned_states)
    return n_corrected


def build_filter_model(
    card: FilterCard,
    layout: StateLayout,
    sources: FilterMeasurements,
    seconds: Floats,
    strapdown: Strapdown | None = None,
    injected_variance: Floats | None = None,
    is_stored: Bools | None = None,
) -> FilterModel:
    """Return a filter card and its sensor models as arrays for the kernels.

    Long because it fills a record of 40 fields, each with its own expression.

    Parameters
    ----------
    card
        Filter card.
    layout
        States of the filter, of `state_layout`.
    sources
        Sensor models, channels and measurements of the filter.
    seconds
        (n_length,) s. Window lengths that occur.
    strapdown
        Algorithm of the strapdown; None: that of the card, in the inertial frame.
    injected_variance
        (n_injection, n_state) SI squared. Variances added at changes of operating region; None: none.
    is_stored
        (n_channel,). Whether a channel has stored gains; the others are not processed. None: no stored gains.

    Returns
    -------
    FilterModel
        The filter as arrays.
    """
    channels = sources.channels
    measurements = sources.measurements
    rows, columns, block_kinds, drivers = transition_blocks(layout.parameters, card.transition_order)
    if "imu" in measurements:  # everything but the gravity gradient is propagated sample by sample
        gradient = block_kinds == transition.VEL_POS
        rows = rows[gradient]
        columns = columns[gradient]
        block_kinds = block_kinds[gradient]
        drivers = drivers[gradient]
    densities = _densities(card, layout, sources.imu, sources.receiver, sources.clock_drift)
    decay, noise = window_tables(layout, densities, seconds)
    channel_type = channel_types(channels)
    count, entry, column = row_tables(layout, channel_type, sources.has_lever, sources.has_covariance)
    extra_offset, extra_member = extra_tables(layout, channels.n_channel)
    h_infinity_weights = np.zeros(N_NAV_ERROR) if card.h_infinity is None else card.h_infinity.weights
    processed_types = [number for name, number in TYPES.items() if name in measurements]
    is_processed = np.isin(channel_type, processed_types)
    if is_stored is not None:
        is_processed = is_processed & is_stored
    return FilterModel(
        has_epochs=sources.has_solver or any(name in TYPES for name in measurements),
        tight=channels.tight,
        has_solver=sources.has_solver,
        is_processed=is_processed,
        n_receiver=channels.n_receiver if channels.receiver else 0,
        n_observable=len(channels.observables),
        rate_sign=1.0 if layout.motion >= 0 else -1.0,
        strapdown=strapdown or build_strapdown(card.strapdown, card.gravity),
        block_rows=rows,
        block_columns=columns,
        block_kinds=block_kinds,
        block_drivers=drivers,
        seconds=seconds,
        decay=decay,
        noise=noise,
        excess_density=_excess_densities(layout, sources.imu),
        clock=layout.clock,
        n_estimated=_count_corrected(card, layout),
        n_assessed=layout.n_estimated,
        n_state=layout.n_state,
        reported_states=np.array(layout.reported_states, dtype=np.int64),
        par_sensor=np.array([b.sensor for b in layout.parameters], dtype=np.int64),
        par_driver=np.array([b.driver for b in layout.parameters], dtype=np.int64),
        par_offset=np.array([b.offset for b in layout.parameters], dtype=np.int64),
        biases_only=all(b.driver == transition.CONSTANT for b in layout.parameters),
        has_decay=bool(np.any(decay != 1.0)),
        inflation=np.exp(seconds / (card.fading_memory or math.inf)),
        h_infinity_weight=np.outer(seconds, h_infinity_weights),
        injected_variance=np.zeros((1, layout.n_state)) if injected_variance is None else injected_variance,
        gate_squared=math.inf if card.gate is None else card.gate**2,
        joseph=card.update == "joseph",
        channel_type=channel_type,
        n_entry=count,
        entry=entry,
        column=column,
        lever_arms=np.array(sources.lever_arms, dtype=float),
        extra_offset=extra_offset,
        extra_member=extra_member,
        decimation=sources.decimation,
        has_reported_covariance=sources.has_covariance,
        clock_gain=clock_gains(layout, channels),
    )
