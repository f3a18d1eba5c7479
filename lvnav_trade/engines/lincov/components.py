"""Truth-side error components of a case, as arrays for the covariance kernels. The filter's models are separate."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.lincov.slots import Slots, aligned, as_lanes, places_of, slot_tables
from lvnav_trade.engines.lincov.sources import measurement_tables, n_joint, noise_sources
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.filters.model import transition_blocks
from lvnav_trade.kernels.clock import spectral_densities
from lvnav_trade.kernels.transition import ACCEL, ATT, CONSTANT, GYRO, POS, VEL
from lvnav_trade.records import Floats

Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

# A parameter that no increment multiplies but enters as a difference: what quantisation holds back.
REMAINDER = -1
GRAVITY = -2


class Components(NamedTuple):
    """True error components of a case. A source owns slots of its lane; a component is one slot of one lane.

    group, lane (n_source,) place of each source; n_slot (n_group,); followed (n_group, n_slot): the covariance with the
    states is followed; moves: enters attitude, velocity or position while they are propagated. samples: enters the
    samples of the IMU, as measurements. factor, noise (n_length, n_group, n_slot, 1, n_lane) decay and driving
    variance over a window, echo the part of the noise that enters the states with the opposite sign (quantisation);
    start (n_source, n_slot) variance.

    Blocks of three components: sensor, driver (REMAINDER, GRAVITY: see there), matched (first state of the filter for
    the same thing, -1 none), source, profile (that is its mean, -1 none), slot (n_block, 3), moving (n_block,): acts on
    attitude, velocity and position while they are propagated, sampled (n_block,): enters the samples of the IMU.
    by_samples: these are measurements. Errors that measurements share:
    shared_source, shared_slot, shared_matched (n_shared,), shared_family (n_family,) family of the filter's extra
    states for the same thing, -1 none. Of both together the ones that have a state: state_source, state_slot, state_at.

    nav_rows ... nav_drivers: blocks of the true transition. white (n_length, n_group, N, n_lane) noise of each source;
    initial (n_source, N, N); noise_source (n_channel,) source of the noise of each channel; decay (n_length, N) of the
    states; n_entry (n_channel,), entry, column of measurements with respect to the N states, by ring place of the clone
    (n_ring, n_channel, ...); solution: first state of the receiver's error (-1 none) with sources solution_source
    (n_in,) of its white errors; clone: first state of the clones (-1 none); buffered: innovations are formed with
    clones. sample_noise (n_source, 6) true variance of a sample's noise, by source.
    """

    group: Ints
    lane: Ints
    n_slot: Ints
    followed: Flags
    moves: Flags
    samples: Flags
    factor: Floats
    noise: Floats
    echo: Floats
    start: Floats
    sensor: Ints
    driver: Ints
    matched: Ints
    source: Ints
    profile: Ints
    slot: Ints
    moving: Flags
    sampled: Flags
    by_samples: bool
    shared_source: Ints
    shared_slot: Ints
    shared_matched: Ints
    shared_family: Ints
    state_source: Ints
    state_slot: Ints
    state_at: Ints
    nav_rows: Ints
    nav_columns: Ints
    nav_kinds: Ints
    nav_drivers: Ints
    white: Floats
    initial: Floats
    noise_source: Ints
    decay: Floats
    n_entry: Ints
    entry: Ints
    column: Ints
    solution: int
    solution_source: Ints
    clone: int
    buffered: bool
    sample_noise: Floats


class _Block(NamedTuple):
    """Three components: sensor, driver, first matched state, source, variance, walk PSD, time constant, profile."""

    sensor: int
    driver: int
    matched: int
    source: int
    variance: float
    walk: float
    time_constant: float
    profile: int


def _blocks(prepared: Prepared, names: list[str]) -> list[_Block]:
    imu = prepared.scenario.imu
    states = {(p.sensor, p.driver): p.offset for p in prepared.layout.parameters}
    found = [
        _Block(b.sensor, b.driver, states.get((b.sensor, b.driver), -1), names.index(b.source), b.sigma**2, b.walk**2,
               b.time_constant, -1) for b in prepared.sources
    ]  # fmt: skip
    for sensor, card, label in ((GYRO, imu.gyro, "gyro"), (ACCEL, imu.accel, "accelerometer")):
        if card.quantisation > 0.0:
            source = names.index(f"{label} quantisation")
            found.append(_Block(sensor, REMAINDER, -1, source, 0.0, card.quantisation**2 / 12.0, 0.0, -1))
    for profile, sensor in enumerate(prepared.unit.profile_sensor.tolist()):
        matched = states.get((sensor, CONSTANT), -1)
        found.append(_Block(sensor, CONSTANT, matched, 0, 0.0, 0.0, math.inf, profile))
    return found


def _block_tables(block: _Block, seconds: Floats) -> tuple[Floats, Floats]:
    """Return decay and driving variance (n_length,) of the components of a block."""
    if block.driver == REMAINDER:
        # a new remainder at the end of every window, uniform over a step; a window of no ticks leaves it as it was
        return np.where(seconds > 0.0, 0.0, 1.0), np.where(seconds > 0.0, block.walk, 0.0)
    factor = np.exp(-seconds / block.time_constant)
    return factor, block.walk * seconds - block.variance * np.expm1(-2.0 * seconds / block.time_constant)


def _shared_tables(sigma: float, time_constant: float, seconds: Floats) -> tuple[Floats, Floats]:
    """Return decay and driving variance (n_length,) of an error that measurements share."""
    # an error without memory is a new one at every epoch; a window of no ticks leaves it as it was
    still = 1.0 if math.isinf(time_constant) else 0.0
    factor = np.exp(-seconds / time_constant) if time_constant > 0.0 else np.where(seconds > 0.0, still, 1.0)
    return factor, sigma**2 * (1.0 - factor**2)


def _partial_differs(prepared: Prepared, family: int, own: int) -> bool:
    """Whether the true partials of a shared error are not those that the filter's own state has."""
    shared = prepared.signals.shared
    if own < 0:
        return True
    return not np.array_equal(shared.partial[family], np.where(shared.member[family] >= 0,
                                                              prepared.signals.partial[own], 0.0))  # fmt: skip


def _moves(block: _Block, modelled: bool) -> bool:
    """Whether a block acts on attitude, velocity and position while they are propagated, not by a state or a sample."""
    return block.matched < 0 and (block.driver == GRAVITY or not modelled)


def _sampled(block: _Block, modelled: bool) -> bool:
    """Whether a block enters the samples of the IMU, as measurements, beyond what a state of the filter has."""
    return modelled and block.matched < 0 and block.driver >= 0


def _take_blocks(prepared: Prepared, blocks: list[_Block], slots: Slots, states: list[tuple[int, int, int]]) -> Ints:
    """Give every component of the blocks a slot, (n_block, 3); -1 for profiles, which every run has alike."""
    decay, modelled = prepared.model.decay, prepared.layout.motion >= 0
    found = np.full((len(blocks), 3), -1, dtype=np.int64)
    for j, block in enumerate(blocks):
        if block.profile >= 0:
            continue
        factor, noise = _block_tables(block, slots.seconds)
        alike = block.matched >= 0 and np.array_equal(factor, decay[:, block.matched])
        moves = _moves(block, modelled)
        sampled = _sampled(block, modelled)
        for axis in range(3):
            found[j, axis] = slots.take(
                block.source, factor, noise, block.variance, followed=not alike, moves=moves, samples=sampled,
                echoes=block.driver == REMAINDER,
            )  # fmt: skip
            if block.matched >= 0:
                states.append((block.source, int(found[j, axis]), block.matched + axis))
    return found


def _take_shared(
    prepared: Prepared, names: list[str], slots: Slots, states: list[tuple[int, int, int]]
) -> dict[str, Any]:
    """Give every component of the errors that measurements share a slot; see Components."""
    model, seconds = prepared.model, slots.seconds
    by_name = {block.name: f for f, block in enumerate(prepared.layout.extras)}
    families = list(prepared.families) if model.aided else []
    source, slot, matched = list[int](), list[int](), list[int]()
    own = [by_name.get(family.state, -1) for family in families]
    for number, family in enumerate(families):
        factor, noise = _shared_tables(family.sigma, family.time_constant, seconds)
        differs = prepared.chain is not None or _partial_differs(prepared, number, own[number])
        for _ in family.labels:
            extra = prepared.signals.shared.extra[len(source)]
            at = int(model.extra_offset[extra]) if extra >= 0 else -1
            follow = differs or not np.array_equal(factor, model.decay[:, at])
            source.append(names.index(family.source))
            matched.append(at)
            slot.append(slots.take(source[-1], factor, noise, family.sigma**2, followed=follow))
            if at >= 0:
                states.append((source[-1], slot[-1], at))
    return {
        "shared_source": np.array(source, dtype=np.int64),
        "shared_slot": np.array(slot, dtype=np.int64),
        "shared_matched": np.array(matched, dtype=np.int64),
        "shared_family": np.array(own, dtype=np.int64),
    }


def _white_noise(prepared: Prepared, names: list[str]) -> Floats:
    imu, receiver, layout = prepared.scenario.imu, prepared.scenario.receiver, prepared.layout
    noise = np.zeros((len(names), prepared.lengths.size, n_joint(prepared)))
    seconds = prepared.lengths[:, None]
    if layout.motion < 0:  # else the noise of the samples enters by their update
        noise[names.index("gyro random walk"), :, ATT : ATT + 3] = imu.gyro.random_walk**2 * seconds
        noise[names.index("accelerometer random walk"), :, VEL : VEL + 3] = imu.accel.random_walk**2 * seconds
    if layout.clock >= 0:
        densities = np.array(spectral_densities(receiver.clock.h0, receiver.clock.h_minus2))
        noise[names.index("receiver clock"), :, layout.clock : layout.clock + 2] = seconds * densities
    return noise


def _sample_noise(prepared: Prepared, names: list[str]) -> Floats:
    imu, noise = prepared.scenario.imu, np.zeros((len(names), 6))
    noise[names.index("gyro random walk"), :3] = imu.gyro.random_walk**2 * imu.rate
    noise[names.index("accelerometer random walk"), 3:] = imu.accel.random_walk**2 * imu.rate
    return noise


def _initial(prepared: Prepared, names: list[str]) -> Floats:
    n, layout, clock = n_joint(prepared), prepared.layout, prepared.scenario.receiver.clock
    initial = np.zeros((len(names), n, n))
    for index, at in enumerate((ATT, VEL, POS)):
        root = prepared.start.roots[index]
        initial[index, at : at + 3, at : at + 3] = root @ root.T
    if layout.clock >= 0:
        variances = np.array([clock.initial_bias, clock.initial_drift]) ** 2
        states = slice(layout.clock, layout.clock + 2)
        initial[names.index("receiver clock start"), states, states] = np.diag(variances)
    return initial


def components(prepared: Prepared, names: list[str]) -> Components:
    """Turn the truth's cards into numbers; the filter's card is asked only which states it has."""
    blocks, seconds, model, n = _blocks(prepared, names), prepared.lengths, prepared.model, n_joint(prepared)
    slots, states = Slots(len(names), seconds), list[tuple[int, int, int]]()
    slot = _take_blocks(prepared, blocks, slots, states)
    shared = _take_shared(prepared, names, slots, states)
    group, lane, n_slot = places_of(slots.count)
    rows, columns, kinds, drivers = transition_blocks(prepared.layout.parameters, 2)
    by_samples = prepared.layout.motion >= 0
    if by_samples:  # all but the gradient of gravity is propagated sample by sample
        rows, columns, kinds, drivers = (
            model.block_rows,
            model.block_columns,
            model.block_kinds,
            model.block_drivers,
        )
    white = as_lanes(_white_noise(prepared, names), group, lane)
    number = np.array(states, dtype=np.int64).reshape(-1, 3)

    def of_blocks(field: str) -> Ints:
        return np.array([getattr(block, field) for block in blocks], dtype=np.int64)

    return Components(
        group=group,
        lane=lane,
        n_slot=n_slot,
        **slot_tables(slots, group, lane, n_slot),
        sensor=of_blocks("sensor"),
        driver=of_blocks("driver"),
        matched=of_blocks("matched"),
        source=of_blocks("source"),
        profile=of_blocks("profile"),
        slot=slot,
        moving=np.array([_moves(b, by_samples) for b in blocks], dtype=np.bool_),
        sampled=np.array([_sampled(b, by_samples) for b in blocks], dtype=np.bool_),
        by_samples=by_samples,
        **shared,
        state_source=np.ascontiguousarray(number[:, 0]),
        state_slot=np.ascontiguousarray(number[:, 1]),
        state_at=np.ascontiguousarray(number[:, 2]),
        nav_rows=rows,
        nav_columns=columns,
        nav_kinds=kinds,
        nav_drivers=drivers,
        white=aligned(np.swapaxes(white, 0, 1)),
        initial=_initial(prepared, names),
        noise_source=noise_sources(prepared, names),
        decay=np.pad(model.decay, ((0, 0), (0, n - prepared.layout.n_state)), constant_values=1.0),
        **measurement_tables(prepared, names),
        sample_noise=_sample_noise(prepared, names),
    )


def initial_state(prepared: Prepared, true: Components) -> tuple[Floats, Floats, Floats]:
    """Return sources (n_group, N, N, n_lane), cross (n_group, n_slot, N, n_lane) and variance (n_group, n_slot, 1,
    n_lane) at the start: an estimate of a component is zero, so the filter's error in it is the component itself.
    """
    n = n_joint(prepared)
    sources = true.initial.copy()
    cross = np.zeros((*true.start.shape, n))
    for source, slot, at in zip(true.state_source, true.state_slot, true.state_at, strict=True):
        variance = true.start[source, slot]
        sources[source, at, at] += variance
        cross[source, slot, at] += variance
    places = (true.group, true.lane)
    return (
        as_lanes(sources, *places),
        as_lanes(cross, *places),
        as_lanes(true.start[:, :, None], *places),
    )
