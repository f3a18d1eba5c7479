"""Truth-side error components of a case, as arrays for the covariance kernels. The filter's models are separate."""

import math
from itertools import chain
from typing import NamedTuple

import numpy as np

from lvnav_trade.engines.lincov.slots import Component, as_lanes, by_length, slot_tables
from lvnav_trade.engines.lincov.sources import measurement_tables, n_joint, noise_sources, source_names
from lvnav_trade.engines.lincov.successive import Successive, successive_of
from lvnav_trade.engines.lincov.units import REMAINDER, WHITE, Differences, differences, stands_for
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.filters.model import transition_blocks
from lvnav_trade.kernels.clock import spectral_densities
from lvnav_trade.kernels.transition import ACCEL, ATT, GYRO, POS, VEL
from lvnav_trade.layout import standing_for
from lvnav_trade.per_axis import rms, squares
from lvnav_trade.records import Bools, Floats, Ints
from lvnav_trade.world.sensors.imu import ImuCard
from lvnav_trade.world.sensors.units import keyed, mounted

GRAVITY = -2
# Time constant (s) of noise that is new in every window.
WHITE_TIME = 1e-12


class Components(NamedTuple):
    """True error components of a case. A source owns slots of its lane; a component is one slot of one lane.

    group, lane (n_source,) place of each source; n_slot (n_group,); followed (n_group, n_slot): the covariance with the
    states is followed; moves: enters attitude, velocity or position while they are propagated; samples: enters the
    samples of the IMU, as measurements. factor, noise (n_length, n_group, n_slot, 1, n_lane) decay and driving
    variance over a window, echo the part of the noise that enters the states with the opposite sign (quantisation).
    source, slot (n_component,) of each component, start variance; those of states (n_pair,) from state_from[c] to
    state_from[c + 1] (n_component + 1,) are the filter's for component c.

    Blocks of three components: sensor, driver (REMAINDER, GRAVITY: see there), matched (first state of the filter for
    the same thing, -1 none), profile (that is its mean, -1 none), triad of a set, stands (n_stage, n_block, 3, n_state)
    how much of a component is in each state of the filter where units are fused, first (n_block,) of its components,
    whose slots are neighbours (-1 a profile), moving, sampled (n_block,): see moves, samples. by_samples: samples are
    measurements. Errors that measurements share are the components from first_shared on; shared_family (n_family,)
    family of the filter's extra states for the same thing, -1 none.

    nav_rows ... nav_drivers: blocks of the true transition. white (n_length, n_group, N, n_lane) noise of each source;
    initial (n_source, N, N); noise_source (n_channel,) source of the noise of each channel; decay (n_length, N) of the
    states; n_entry (n_channel,), entry, column of measurements with respect to the N states, by place of the clone
    (n_place, n_channel, ...); solution: first state of the receiver's error (-1 none) with sources solution_source
    (n_in,) of its white errors; clone: first state of the clones (-1 none). sample_noise (n_source, 6) true variance of
    a sample's noise, by source; differences of units; successive: errors of measurements that are differences of two
    epochs (None: there are none).
    """

    group: Ints
    lane: Ints
    n_slot: Ints
    followed: Bools
    moves: Bools
    samples: Bools
    factor: Floats
    noise: Floats
    echo: Floats
    source: Ints
    slot: Ints
    states: Ints
    state_from: Ints
    start: Floats
    sensor: Ints
    driver: Ints
    matched: Ints
    profile: Ints
    triad: Ints
    stands: Floats
    first: Ints
    moving: Bools
    sampled: Bools
    by_samples: bool
    first_shared: int
    shared_family: Ints
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
    sample_noise: Floats
    differences: Differences
    successive: Successive | None


class _Block(NamedTuple):
    """Three components: sensor, driver, first matched state, source, variance and walk PSD by axis, time constant,
    profile.
    """

    sensor: int
    driver: int
    matched: int
    source: int
    variance: tuple[float, float, float] = (0.0, 0.0, 0.0)
    walk: tuple[float, float, float] = (0.0, 0.0, 0.0)
    time_constant: float = math.inf
    profile: int = -1
    triad: int = 0


def _blocks(prepared: Prepared, names: list[str]) -> list[_Block]:
    several = prepared.options.units is not None  # then a state stands for a sum, and for no component alone
    states = {} if several else {(p.sensor, p.driver): p.offset for p in prepared.layout.parameters}
    found = [
        _Block(b.sensor, b.driver, states.get((b.sensor, b.driver), -1), names.index(b.source), squares(b.sigma),
               squares(b.walk), b.time_constant, triad=b.triad) for b in prepared.sources
    ]  # fmt: skip
    for triad, (number, unit) in enumerate(mounted(prepared.scenario.imu)):
        for sensor, card, label in ((GYRO, unit.gyro, "gyro"), (ACCEL, unit.accel, "accelerometer")):
            if card.quantisation > 0.0:
                source = names.index(keyed(f"{label} quantisation", number))
                walk = (card.quantisation**2 / 12.0,) * 3
                found.append(_Block(sensor, REMAINDER, -1, source, walk=walk, triad=triad))
            if several and prepared.layout.motion < 0 and rms(card.random_walk) > 0.0:
                source, variance = names.index(keyed(f"{label} random walk", number)), squares(card.random_walk)
                found.append(_Block(sensor, WHITE, -1, source, variance, time_constant=WHITE_TIME, triad=triad))
    for profile, code in enumerate(prepared.unit.profile_sensor.tolist()):
        triad, sensor = divmod(code, 2)
        driver = int(prepared.unit.profile_driver[profile])
        found.append(_Block(sensor, driver, states.get((sensor, driver), -1), 0, profile=profile, triad=triad))
    return found


def _of_block(prepared: Prepared, block: _Block, moves: bool, samples: bool) -> list[Component]:
    """Return the components of a block; a profile, which every run has alike, has none."""
    seconds = prepared.lengths
    if block.profile >= 0:
        return []
    if block.driver == REMAINDER:
        # a new remainder at the end of every window, uniform over a step; a window of no ticks leaves it as it was
        factor = np.where(seconds > 0.0, 0.0, 1.0)
        noise = [np.where(seconds > 0.0, walk, 0.0) for walk in block.walk]
    else:
        factor = np.exp(-seconds / block.time_constant)
        left = np.expm1(-2.0 * seconds / block.time_constant)
        noise = [walk * seconds - one * left for one, walk in zip(block.variance, block.walk, strict=True)]
    alike = block.matched >= 0 and np.array_equal(factor, prepared.model.decay[:, block.matched])
    states = [(block.matched + i,) for i in range(3)] if block.matched >= 0 else [(), (), ()]
    return [
        Component(block.source, factor, driven, variance, own, not alike, moves, samples, block.driver == REMAINDER)
        for driven, variance, own in zip(noise, block.variance, states, strict=True)
    ]


def _shared_tables(sigma: float, time_constant: float, seconds: Floats) -> tuple[Floats, Floats]:
    """Return decay and driving variance (n_length,) of an error that measurements share."""
    # an error without memory is a new one at every epoch; a window of no ticks leaves it as it was
    still = 1.0 if math.isinf(time_constant) else 0.0
    factor = np.exp(-seconds / time_constant) if time_constant > 0.0 else np.where(seconds > 0.0, still, 1.0)
    return factor, sigma**2 * (1.0 - factor**2)


def _of_families(prepared: Prepared, names: list[str]) -> tuple[list[Component], list[int]]:
    """Return the components of the errors that measurements share, and by family that of the filter's extra states."""
    model, signals, found, own = prepared.model, prepared.signals, list[Component](), list[int]()
    shared = signals.shared
    for number, family in enumerate(prepared.families if model.aided else ()):
        stand = standing_for(prepared.layout.extras, family.state, family.labels[0])
        state = stand[0][0] if stand else -1
        factor, noise = _shared_tables(family.sigma, family.time_constant, prepared.lengths)
        entering = shared.member[number] >= 0
        # whether the true partials are not those that the filter's own state has
        differs = prepared.chain is not None or state < 0 or not np.array_equal(
            shared.partial[number], np.where(entering, signals.partial[state], 0.0)
        )  # fmt: skip
        for _ in family.labels:
            states = tuple(model.extra_offset[shared.state_of[shared.error_of == len(found)]].tolist())
            follow = differs or any(not np.array_equal(factor, model.decay[:, at]) for at in states)
            found.append(Component(names.index(family.source), factor, noise, family.sigma**2, states, follow))
        own.append(state)
    return found, own


def _white_noise(prepared: Prepared, names: list[str]) -> Floats:
    imu, receiver, layout = prepared.scenario.imu, prepared.scenario.receiver, prepared.layout
    noise = np.zeros((len(names), prepared.lengths.size, n_joint(prepared)))
    seconds = prepared.lengths[:, None]
    # the noise of several units enters by blocks, that of samples by their update
    if layout.motion < 0 and isinstance(imu, ImuCard):
        for label, at, card in (("gyro", ATT, imu.gyro), ("accelerometer", VEL, imu.accel)):
            noise[names.index(f"{label} random walk"), :, at : at + 3] = np.array(squares(card.random_walk)) * seconds
    if layout.clock >= 0:
        densities = np.array(spectral_densities(receiver.clock.h0, receiver.clock.h_minus2))
        noise[names.index("receiver clock"), :, layout.clock : layout.clock + 2] = seconds * densities
    return noise


def _sample_noise(prepared: Prepared, names: list[str]) -> Floats:
    imu, noise, units = prepared.scenario.imu, np.zeros((len(names), 6)), prepared.options.units
    for triad, (number, unit) in enumerate(mounted(imu)):
        sizes = np.array([squares(unit.gyro.random_walk), squares(unit.accel.random_walk)]) * imu.rate
        if units is not None:  # (2, 3, 3) how each axis enters the fused triad
            sizes = np.einsum("sic,sc->si", units.solved[0, triad] ** 2, sizes) * units.noisy[0, :, 1] ** 2
        noise[names.index(keyed("gyro random walk", number)), :3] += sizes[0]
        noise[names.index(keyed("accelerometer random walk", number)), 3:] += sizes[1]
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


def components(prepared: Prepared) -> Components:
    """Turn the truth's cards into numbers; the filter's card is asked only which states it has."""
    names, model, n = source_names(prepared), prepared.model, n_joint(prepared)
    blocks, by_samples, units = _blocks(prepared, names), prepared.layout.motion >= 0, prepared.options.units
    sensor, driver, matched, profile, triad = np.array(
        [[block.sensor, block.driver, block.matched, block.profile, block.triad] for block in blocks], dtype=np.int64
    ).reshape(-1, 5).T.copy()  # fmt: skip
    moving = (matched < 0) & ((driver == GRAVITY) | (not by_samples))
    sampled = (matched < 0) & (driver >= 0) & by_samples
    of_blocks = [_of_block(prepared, *one) for one in zip(blocks, moving, sampled, strict=True)]
    shared, own = _of_families(prepared, names)
    count = np.array([len(found) for found in of_blocks], dtype=np.int64)
    first = np.where(profile < 0, np.cumsum(count) - count, -1)
    tables = slot_tables([*chain.from_iterable(of_blocks), *shared], len(names), prepared.lengths.size)
    rows, columns, kinds, drivers = transition_blocks(prepared.layout.parameters, 2)
    if by_samples:  # all but the gradient of gravity is propagated sample by sample
        rows, columns, kinds, drivers = model.block_rows, model.block_columns, model.block_kinds, model.block_drivers
    return Components(
        **tables,
        sensor=sensor,
        driver=driver,
        matched=matched,
        profile=profile,
        triad=triad,
        stands=np.zeros((0, 0, 3, 0)) if units is None else stands_for(prepared.layout, units, sensor, driver, triad),
        first=first,
        moving=moving,
        sampled=sampled,
        by_samples=by_samples,
        first_shared=int(count.sum()),
        shared_family=np.array(own, dtype=np.int64),
        nav_rows=rows,
        nav_columns=columns,
        nav_kinds=kinds,
        nav_drivers=drivers,
        white=by_length(_white_noise(prepared, names), tables["group"], tables["lane"]),
        initial=_initial(prepared, names),
        noise_source=noise_sources(prepared, names),
        decay=np.pad(model.decay, ((0, 0), (0, n - prepared.layout.n_state)), constant_values=1.0),
        **measurement_tables(prepared, names),
        sample_noise=_sample_noise(prepared, names),
        differences=differences(prepared, sensor, driver, triad, profile, first, int(count.sum())),
        successive=successive_of(prepared, names, own),
    )


def initial_state(prepared: Prepared, true: Components) -> tuple[Floats, Floats, Floats]:
    """Return sources (n_group, N, N, n_lane), cross (n_group, n_slot, N, n_lane) and variance (n_group, n_slot, 1,
    n_lane) at the start: an estimate of a component is zero, so the filter's error in it is the component itself.
    """
    sources, start = true.initial.copy(), np.zeros((len(true.initial), true.followed.shape[1], 1))
    cross = np.zeros((*start.shape[:2], n_joint(prepared)))
    start[true.source, true.slot, 0] = true.start
    for c, (source, slot, variance) in enumerate(zip(true.source, true.slot, true.start, strict=True)):
        states = true.states[true.state_from[c] : true.state_from[c + 1]]
        sources[source, states[:, None], states] += variance
        cross[source, slot, states] += variance
    sources, cross, start = (as_lanes(values, true.group, true.lane) for values in (sources, cross, start))
    return sources, cross, start
