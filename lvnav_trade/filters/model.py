"""What a filter card means in numbers: state layout, blocks of the transition, noise, rows. No truth enters here."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.envelope import EnvelopeCard
from lvnav_trade.filters.base import BIASES, FilterCard, ImuModel, InitialModel, ReceiverModel
from lvnav_trade.filters.delayed import cloned_states
from lvnav_trade.filters.rows import NOISE_STATES, TYPES, clock_gains, extra_tables, row_tables, row_types
from lvnav_trade.filters.strapdown import strapdown_of
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.clock import spectral_densities
from lvnav_trade.kernels.strapdown import Strapdown
from lvnav_trade.kernels.transition import ATT, GYRO, POS, VEL
from lvnav_trade.layout import BY_SATELLITE, EXTRAS, PARAMETERS, RELATIVE, ExtraBlock, ParameterBlock, StateLayout
from lvnav_trade.observables.partials import Channels, members, sensor_states
from lvnav_trade.per_axis import PerAxis, axes, squares
from lvnav_trade.records import Bools, Floats, Ints

# One-sigma (m) of the receiver's clock at an epoch before the filter starts: such a difference tells nothing.
UNKNOWN = 1e6
# Time constant (s) of what is new in every window.
NO_MEMORY = 1e-12
BIAS_OF = {"gyro_bias": "gyro_relative_bias", "accel_bias": "accel_relative_bias"}


class FilterModel(NamedTuple):
    """A filter in numbers, for the kernels. Index arrays int64; per-window tables by window length.

    aided: it has measurements, or the receiver solves beside it; tight: ranges are among them; solves: the receiver
    solves for itself; measured (n_channel,): the channel is processed; n_receiver of them are the receiver's (0: none
    is processed), n_kind of each satellite; rate_sign: see `observables.base.antenna`; strapdown: its algorithm;
    block_rows, block_columns, block_kinds, block_drivers (n_block,); seconds (n_length,) distinct window lengths, decay
    and noise (n_length, n_state) per length; clock index; n_estimated states that updates correct, n_assessed of NEES,
    n_state, reported (n_reported,) states; par_sensor, par_driver, par_offset (n_par,); biases_only (no scale factor or
    misalignment); fading (any decay); inflation (n_length,) factor of deviations by fading memory; injected
    (n_injection, n_state) variance of a change of operating region; gate_squared; joseph; row_type, n_entry
    (n_channel,), entry and column (n_channel, n) by channel; lever_arms (n_antenna, 3) m; extra_offset (n_extra,) state
    of each extra one, extra_member (n_extra_family, n_channel) extra state in a channel, -1 none; every: of how many
    epochs the filter takes the last; has_covariance: solutions come with a covariance of their own and are
    decorrelated; clock_gain (n_kind, n_state) that makes the clock's part of an observable what a reference satellite
    measures.
    """

    aided: bool
    tight: bool
    solves: bool
    measured: Bools
    n_receiver: int
    n_kind: int
    rate_sign: float
    strapdown: Strapdown
    block_rows: Ints
    block_columns: Ints
    block_kinds: Ints
    block_drivers: Ints
    seconds: Floats
    decay: Floats
    noise: Floats
    clock: int
    n_estimated: int
    n_assessed: int
    n_state: int
    reported: Ints
    par_sensor: Ints
    par_driver: Ints
    par_offset: Ints
    biases_only: bool
    fading: bool
    inflation: Floats
    injected: Floats
    gate_squared: float
    joseph: bool
    row_type: Ints
    n_entry: Ints
    entry: Ints
    column: Ints
    lever_arms: Floats
    extra_offset: Ints
    extra_member: Ints
    every: int
    has_covariance: bool
    clock_gain: Floats


def _parameter_blocks(names: list[str], imu: ImuModel, offset: int) -> list[ParameterBlock]:
    blocks: list[ParameterBlock] = []
    for name in names:
        walk, time_constant = getattr(imu, f"{name}_walk", 0.0), getattr(imu, f"{name}_time", None) or math.inf
        kind = PARAMETERS[name]
        for part, driver in enumerate(kind.drivers):
            at = offset + 3 * len(blocks)
            blocks.append(ParameterBlock(name, part, at, kind.sensor, driver, imu.sigma(name), walk, time_constant))
    return blocks


def _extra_blocks(
    names: list[str],
    imu: ImuModel,
    receiver: ReceiverModel,
    channels: Channels,
    offset: int,
    as_noise: tuple[str, ...] = (),
) -> list[ExtraBlock]:
    blocks = []
    for name in names:
        labels, member = members(name, channels)
        if labels:
            card, field = imu if name in RELATIVE.values() else receiver, BY_SATELLITE.get(name, name)
            ends = ("", "_walk", "_correlation")
            sigma, *more = (getattr(card, field + end, 0.0) for end in ends)
            time = NO_MEMORY if name in as_noise else getattr(card, f"{field}_time", None) or math.inf
            blocks.append(ExtraBlock(name, labels, offset, member, sigma, time, EXTRAS[name], *more))
            offset += len(labels)
        for state, own, _ in sensor_states(name, channels):
            time = NO_MEMORY if name in as_noise else state.time_constant
            blocks.append(ExtraBlock(name, (state.label,), offset, own, state.sigma, time, state.unit))
            offset += 1
    return blocks


def state_layout(
    card: FilterCard, imu: ImuModel, receiver: ReceiverModel, channels: Channels, measurements: tuple[str, ...] = (),
    has_lever: bool = False, n_clone: int = 0,
) -> StateLayout:  # fmt: skip
    """Lay out the states of a filter: navigation, estimated parameters, clock, estimated extra states, what belongs to
    the earlier epoch of differences, and then what is considered. Noise that rows share is a state without memory:
    estimated within an epoch, then forgotten.

    has_lever: an antenna is away from the inertial unit; n_clone: how many states are cloned, where that is known.
    """
    differences = tuple(name for name in card.differences if name in measurements)
    noises = [NOISE_STATES[name] for name in differences if card.previous_noise == "estimated"]
    wanted = [n for n in (*BIASES, *card.extra_states, *card.as_noise) if n not in card.neglect]
    wanted += [state for name, state in RELATIVE.items() if name in measurements and state not in wanted]
    wanted += ["ambiguity"] if "carrier_phase" in measurements else []
    wanted += [n for n in card.consider if n not in wanted]
    parameters: list[ParameterBlock] = []
    extras: list[ExtraBlock] = []
    offset, clock, motion, n_estimated, delayed, n_delayed = 9, -1, -1, 9, 9, 0
    for considered in (False, True):
        group = [n for n in wanted if (n in card.consider) == considered]
        blocks = _parameter_blocks([n for n in group if n in PARAMETERS], imu, offset)
        offset += 3 * len(blocks)
        reduced = channels.tight and card.clock == "one_state"
        if not considered and channels.tight and not reduced:
            clock, offset = offset, offset + 2
        shared = _extra_blocks(
            [n for n in group if n not in PARAMETERS], imu, receiver, channels, offset, card.as_noise
        )
        offset += sum(len(block.labels) for block in shared)
        parameters, extras = parameters + blocks, extras + shared
        if not considered:
            if "imu" in measurements:
                motion, offset = offset, offset + 6
            clock = offset if reduced else clock
            n_estimated = offset = offset + reduced
            offset += reduced  # the drift, which stays zero and known
            delayed = offset
            extras += (own := _extra_blocks(noises, imu, receiver, channels, offset))
            n_delayed = sum(len(block.labels) for block in own) + n_clone
            offset += n_delayed
    found = StateLayout(
        tuple(parameters), clock, n_estimated, offset, tuple(extras), motion, samples=card.report_imu_samples
    )
    cloned = cloned_states(found, channels, differences, has_lever)
    if len(cloned) != n_clone:
        return state_layout(card, imu, receiver, channels, measurements, has_lever, len(cloned))
    clone = delayed + n_delayed - n_clone if n_clone else -1
    return found._replace(delayed=delayed, n_delayed=n_delayed, clone=clone, cloned=cloned)


def transition_blocks(parameters: tuple[ParameterBlock, ...], order: int) -> tuple[Ints, Ints, Ints, Ints]:
    """List the 3 x 3 blocks of Phi in the order in which they act: rows, columns, kinds, drivers.

    Order 1 is I + F dt, the terms linear in the window: position moves on by the velocity before the window, and what
    its gradient of gravity would make of that is taken off again. Order 2 is all that `transition` knows.
    """
    gyro = [block for block in parameters if block.sensor == GYRO]
    accel = [block for block in parameters if block.sensor != GYRO]
    if order == 1:
        found = [(POS, VEL, transition.POS_VEL, 0), (VEL, VEL, transition.VEL_VEL, 0)]
    else:
        found = [(POS, VEL, transition.POS_VEL_HALF, 0)]
        found += [(VEL, block.offset, transition.VEL_GYRO, block.driver) for block in gyro]
    found += [(VEL, ATT, transition.VEL_ATT, 0), (VEL, POS, transition.VEL_POS, 0)]
    found += [(VEL, block.offset, transition.VEL_ACCEL, block.driver) for block in accel]
    found += [(ATT, block.offset, transition.ATT_GYRO, block.driver) for block in gyro]
    if order == 2:
        found.append((POS, VEL, transition.POS_VEL_HALF, 0))
    rows, columns, kinds, drivers = (np.array(values, dtype=np.int64) for values in zip(*found, strict=True))
    return rows, columns, kinds, drivers


def _square(value: PerAxis) -> float | Floats:
    return np.array(squares(value)) if isinstance(value, tuple) else value**2


def _blocks(layout: StateLayout) -> list[tuple[slice, PerAxis, float]]:
    """Return the states, the sigma and the time constant of every block of parameters or extra states."""
    found: list[tuple[slice, PerAxis, float]] = [
        (slice(b.offset, b.offset + 3), b.sigma, b.time_constant) for b in layout.parameters
    ]
    return found + [(slice(e.offset, e.offset + len(e.labels)), e.sigma, e.time_constant) for e in layout.extras]


def window_tables(layout: StateLayout, densities: Floats, seconds: Floats) -> tuple[Floats, Floats]:
    """Return decay and noise variance of every state over windows of the given lengths, (n_length, n_state) each.

    densities (n_state,): noise PSD of each state; for a Gauss-Markov parameter the noise that holds its sigma is added.
    """
    decay = np.ones((seconds.size, layout.n_state))
    noise = seconds[:, None] * densities
    for states, sigma, time_constant in _blocks(layout):
        if math.isfinite(time_constant):
            decay[:, states] = np.exp(-seconds / time_constant)[:, None]
            # half of it enters before the decay d, half after: 2 (1 - d^2) / (1 + d^2) of the variance then holds it
            noise[:, states] += 2.0 * _square(sigma) * np.tanh(seconds / time_constant)[:, None]
    return decay, noise


def _densities(card: FilterCard, layout: StateLayout, imu: ImuModel, receiver: ReceiverModel, drift: float) -> Floats:
    found = np.zeros(layout.n_state)
    # with a model of the vehicle the noise of samples enters by their rows, and nowhere else
    by_window = layout.motion < 0
    found[ATT : ATT + 3] = by_window * np.array(squares(imu.gyro_random_walk)) + card.attitude_noise**2
    found[VEL : VEL + 3] = by_window * np.array(squares(imu.accel_random_walk)) + card.velocity_noise**2
    found[POS : POS + 3] = card.position_noise**2
    for block in layout.parameters:
        found[block.offset : block.offset + 3] = _square(block.walk)
    for extra in layout.extras:
        found[extra.offset : extra.offset + len(extra.labels)] = extra.walk**2
    if layout.clock >= 0:
        bias, walk = spectral_densities(receiver.clock_h0, receiver.clock_h_minus2)
        if layout.has_reduced_clock:  # of an update interval the same variance as that of bias and drift
            interval = 1.0 / card.update_rate
            bias, walk = bias + walk * interval**2 / 3.0 + drift**2 * interval, 0.0
        found[layout.clock : layout.clock + 2] = bias, walk
    return found


def build_filter_model(
    card: FilterCard,
    imu: ImuModel,
    receiver: ReceiverModel,
    lever_arms: Floats,
    seconds: Floats,
    channels: Channels,
    strapdown: Strapdown | None = None,
    every: int = 1,
    has_covariance: bool = False,
    solves: bool = False,
    measurements: tuple[str, ...] = (),
    drift: float = 0.0,
) -> tuple[StateLayout, FilterModel]:
    """Turn a filter card and its filter models into numbers.

    lever_arms (n_antenna, 3) m of the antennas; seconds (n_length,) are the window lengths that will occur; strapdown:
    its algorithm (none: that of the card, in the inertial frame); every: of how many epochs one is taken;
    has_covariance: solutions come with a covariance of their own and are decorrelated; drift: one-sigma (m/s) of the
    clock's, that a clock of one state takes for white. Long because a record of 32 numbers is filled here, each by an
    expression of its own.
    """
    layout = state_layout(card, imu, receiver, channels, measurements, bool(np.any(lever_arms)))
    rows, columns, block_kinds, drivers = transition_blocks(layout.parameters, card.transition_order)
    if "imu" in measurements:  # all but the gradient of gravity is propagated sample by sample
        gradient = block_kinds == transition.VEL_POS
        rows, columns, block_kinds, drivers = (
            rows[gradient],
            columns[gradient],
            block_kinds[gradient],
            drivers[gradient],
        )
    decay, noise = window_tables(layout, _densities(card, layout, imu, receiver, drift), seconds)
    row_type = row_types(channels)
    count, entry, column = row_tables(layout, row_type, bool(np.any(lever_arms)), has_covariance)
    extra_offset, extra_member = extra_tables(layout, channels.n_channel)
    corrected = layout.delayed + layout.n_delayed if layout.n_delayed else layout.n_estimated
    considers = bool(layout.cloned) and card.delayed_state == "consider"
    model = FilterModel(
        aided=solves or any(name in TYPES for name in measurements),
        tight=channels.tight,
        solves=solves,
        measured=np.isin(row_type, [kind for name, kind in TYPES.items() if name in measurements]),
        n_receiver=channels.n_receiver if channels.receiver else 0,
        n_kind=len(channels.observables),
        rate_sign=1.0 if layout.motion >= 0 else -1.0,
        strapdown=strapdown or strapdown_of(card.strapdown, card.gravity),
        block_rows=rows,
        block_columns=columns,
        block_kinds=block_kinds,
        block_drivers=drivers,
        seconds=seconds,
        decay=decay,
        noise=noise,
        clock=layout.clock,
        n_estimated=corrected - (len(layout.cloned) if considers else 0),
        n_assessed=layout.n_estimated,
        n_state=layout.n_state,
        reported=np.array(layout.reported, dtype=np.int64),
        par_sensor=np.array([b.sensor for b in layout.parameters], dtype=np.int64),
        par_driver=np.array([b.driver for b in layout.parameters], dtype=np.int64),
        par_offset=np.array([b.offset for b in layout.parameters], dtype=np.int64),
        biases_only=all(b.driver == transition.CONSTANT for b in layout.parameters),
        fading=bool(np.any(decay != 1.0)),
        inflation=np.exp(seconds / (card.fading_memory or math.inf)),
        injected=np.zeros((1, layout.n_state)),
        gate_squared=math.inf if card.gate is None else card.gate**2,
        joseph=card.update == "joseph",
        row_type=row_type,
        n_entry=count,
        entry=entry,
        column=column,
        lever_arms=np.array(lever_arms, dtype=float),
        extra_offset=extra_offset,
        extra_member=extra_member,
        every=every,
        has_covariance=has_covariance,
        clock_gain=clock_gains(layout, channels),
    )
    return layout, model


def initial_covariance(
    layout: StateLayout, initial: InitialModel, C_n_i: Floats, envelope: EnvelopeCard | None = None
) -> Floats:
    """Return the filter's covariance (n_state, n_state) at the start; C_n_i (3, 3) of the starting point; envelope of a
    filter that models the vehicle.
    """
    variance, clock, motion = np.zeros(layout.n_state), layout.clock, layout.motion
    variance[VEL : VEL + 3], variance[POS : POS + 3] = initial.velocity**2, initial.position**2
    for states, sigma, _ in _blocks(layout):
        variance[states] = _square(sigma)
    biases = {BIAS_OF[b.name]: b for b in layout.parameters if b.name in BIAS_OF}
    if clock >= 0:
        drift = 0.0 if layout.has_reduced_clock else initial.clock_drift
        variance[clock : clock + 2] = initial.clock_bias**2, drift**2
    if motion >= 0 and envelope is not None:
        variance[motion : motion + 3] = envelope.start_rate**2
        variance[motion + 3 : motion + 6] = envelope.start_acceleration**2
    P = np.diag(variance)
    for clone, state in enumerate(layout.cloned, start=layout.clone):
        P[clone, clone] = UNKNOWN**2 if state == clock else variance[state]
    tilt = np.diag([initial.tilt**2, initial.tilt**2, initial.heading**2])
    P[ATT : ATT + 3, ATT : ATT + 3] = C_n_i @ tilt @ C_n_i.T
    for extra in layout.extras:
        if extra.correlation and extra.name in biases:
            bias = biases[extra.name]
            for i in range(3):
                shared = extra.correlation * extra.sigma * axes(bias.sigma)[i]
                P[extra.offset + i, bias.offset + i] = P[bias.offset + i, extra.offset + i] = shared
    return P
