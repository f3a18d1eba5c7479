"""Truth-side error components of a case, as arrays for the covariance kernels. The filter's models are separate."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.difference_errors import SuccessiveErrors, build_successive_errors
from lvnav_trade.covariance.imu_array_errors import REMAINDER, WHITE, Differences, differences, state_weights
from lvnav_trade.covariance.slots import Component, arrange_by_length, arrange_lanes, slot_tables
from lvnav_trade.covariance.sources import measurement_tables, n_joint, noise_sources, source_names
from lvnav_trade.filter.model import transition_blocks
from lvnav_trade.imu.array import source_key, triad_imus
from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.kernels.clock import spectral_densities
from lvnav_trade.kernels.transition import ACCEL, ATT, GYRO, POS, VEL
from lvnav_trade.quantities.per_axis import rms, squares
from lvnav_trade.quantities.records import Bools, Floats, Ints
from lvnav_trade.quantities.state_layout import ErrorTerm, states_modelling
from lvnav_trade.simulation.preparation.prepare import PreparedCase

GRAVITY = -2
# Time constant (s) of noise that is independent from window to window.
WHITE_TIME = 1e-12


class Components(NamedTuple):
    """True error components of a case, as arrays for the covariance kernels.

    An error source is one lane of a group; each of its scalar components has a slot of that lane. The joint vector has
    N states: the n errors of the filter, errors of the receiver, and clones. A window is a number of IMU ticks that the
    covariance is propagated over at once; n_length different lengths occur. A block is three components, by axis of a
    sensor.

    group : (n_source,). Group of lanes that the source belongs to.
    lane : (n_source,). Lane of the source within its group.
    n_slot : (n_group,). Slots in use, the most of any source of the group.
    has_cross : (n_group, n_slot). Whether the cross covariance of the slot with the joint states is propagated.
    drives_motion : (n_group, n_slot). Whether the slot drives attitude, velocity or position during propagation.
    enters_samples : (n_group, n_slot). Whether the slot enters IMU samples that the filter processes as measurements.
    component_decay : (n_length, n_group, n_slot, 1, n_lane). Decay factor over a window.
    noise : (n_length, n_group, n_slot, 1, n_lane). Variance added by driving noise over a window.
    echo : (n_length, n_group, n_slot, 1, n_lane). Part of `noise` that also enters the states with opposite sign: the
        quantisation remainder.
    source : (n_component,). Source of each component.
    slot : (n_component,). Slot of each component in the lane of its source.
    states : (n_pair,). Filter states that model a component, component after component.
    state_from : (n_component + 1,). Start of each component's part of `states`.
    initial_variance : (n_component,). Initial variance.
    sensor : (n_block,). Sensor that the block belongs to: GYRO or ACCEL.
    driver : (n_block,). Quantity that the block multiplies, as in `kernels.transition`; also REMAINDER, WHITE, GRAVITY.
    filter_state : (n_block,). First filter state that models the block, -1 none.
    profile : (n_block,). Profile that is the mean of the block, -1 none.
    triad : (n_block,). Triad of the IMU array that the block belongs to.
    state_weight : (n_stage, n_block, 3, n_state). Weight of each component in each filter state for an IMU array; empty
        for one IMU.
    first : (n_block,). First component of the block, the next two follow it; -1 for a profile.
    block_drives_motion : (n_block,). As `drives_motion`, by block.
    block_enters_samples : (n_block,). As `enters_samples`, by block.
    has_sample_updates : Whether the filter processes IMU samples as measurements.
    first_correlated : First component that is a correlated measurement error; all later components are too.
    modelling_block : (n_family,). Block of the filter's extra states that models the family of correlated errors, -1
        none.
    nav_rows : (n_nav,). First row of each 3 x 3 block of the true transition matrix.
    nav_columns : (n_nav,). First column of each of these blocks.
    nav_kinds : (n_nav,). Kind of each of these blocks, as in `kernels.transition`.
    nav_drivers : (n_nav,). Quantity that the parameter of the block multiplies.
    white_variance : (n_length, n_group, N, n_lane). Variance of the white noise of each source, by state, over a
        window.
    initial_covariance : (n_source, N, N). Initial covariance of attitude, velocity, position and clock errors, by
        source.
    noise_source : (n_channel,). Source of the white measurement noise of each channel, -1 none.
    state_decay : (n_length, N). Decay factor of the joint states over a window.
    n_entry : (n_channel,). Number of Jacobian entries that are not zero.
    entry : (n_place, n_channel, n_entry). Places of these entries in the Jacobian row, by place of the stored state.
    column : (n_place, n_channel, n_entry). Joint states that these entries belong to.
    solution : First joint state of the errors of the receiver's solution or of measured differences, -1 none.
    solution_source : (n_in,). Source of each white noise that drives these errors.
    clone : First joint state of the clones for delay compensation, -1 none.
    sample_noise : (n_source, 6). True variance of the noise of an IMU sample: rate, then specific force, SI squared.
    imu_differences : Errors of measured differences of two IMUs.
    successive_errors : Errors of measured differences of two epochs; None where no such difference is measured.
    """

    group: Ints
    lane: Ints
    n_slot: Ints
    has_cross: Bools
    drives_motion: Bools
    enters_samples: Bools
    component_decay: Floats
    noise: Floats
    echo: Floats
    source: Ints
    slot: Ints
    states: Ints
    state_from: Ints
    initial_variance: Floats
    sensor: Ints
    driver: Ints
    filter_state: Ints
    profile: Ints
    triad: Ints
    state_weight: Floats
    first: Ints
    block_drives_motion: Bools
    block_enters_samples: Bools
    has_sample_updates: bool
    first_correlated: int
    modelling_block: Ints
    nav_rows: Ints
    nav_columns: Ints
    nav_kinds: Ints
    nav_drivers: Ints
    white_variance: Floats
    initial_covariance: Floats
    noise_source: Ints
    state_decay: Floats
    n_entry: Ints
    entry: Ints
    column: Ints
    solution: int
    solution_source: Ints
    clone: int
    sample_noise: Floats
    imu_differences: Differences
    successive_errors: SuccessiveErrors | None


def _terms(prepared_case: PreparedCase) -> list[ErrorTerm]:
    """Return the random errors of the IMUs; `offset` of each is the first filter state that models it, -1 none."""
    states = _modelling_states(prepared_case)
    terms = [term._replace(offset=states.get((term.sensor, term.driver), -1)) for term in prepared_case.sources]
    for triad, (number, imu) in enumerate(triad_imus(prepared_case.scenario.imu)):
        for sensor, card, label in ((GYRO, imu.gyro, "gyro"), (ACCEL, imu.accel, "accelerometer")):
            if card.quantisation > 0.0:
                remainder = ErrorTerm(
                    name=source_key(f"{label} quantisation", number),
                    term_index=0,
                    sensor=sensor,
                    driver=REMAINDER,
                    sigma=0.0,
                    walk=card.quantisation / math.sqrt(12.0),  # sigma of a uniform error over a step
                    triad=triad,
                )
                terms.append(remainder)
            # noise of unequal axes is a component in body axes, which rotate; equal axes need no component, since their
            # noise is isotropic (`_white_noise`)
            by_axis = prepared_case.options.imu_array is not None or isinstance(card.random_walk, tuple)
            if by_axis and prepared_case.layout.motion < 0 and rms(card.random_walk) > 0.0:
                noise = ErrorTerm(
                    name=source_key(f"{label} random walk", number),
                    term_index=0,
                    sensor=sensor,
                    driver=WHITE,
                    sigma=card.random_walk,
                    time_constant=WHITE_TIME,
                    triad=triad,
                )
                terms.append(noise)
    return terms


def _modelling_states(prepared_case: PreparedCase) -> dict[tuple[int, int], int]:
    """Return the first filter state that models an IMU error, by sensor and driver.

    Empty for an IMU array, in which a state models a sum of components.
    """
    if prepared_case.options.imu_array is not None:
        return {}
    return {(block.sensor, block.driver): block.offset for block in prepared_case.layout.parameters}


def _profiles(prepared_case: PreparedCase) -> list[tuple[int, int, int, int]]:
    """Return sensor, driver, first filter state that models it (-1 none) and triad of each deterministic profile."""
    states = _modelling_states(prepared_case)
    unit = prepared_case.unit
    profiles = []
    for code, driver in zip(unit.profile_sensor.tolist(), unit.profile_driver.tolist(), strict=True):
        triad, sensor = divmod(code, 2)
        state = states.get((sensor, driver), -1)
        profiles.append((sensor, driver, state, triad))
    return profiles


def _term_components(
    prepared_case: PreparedCase, term: ErrorTerm, source: int, drives_motion: bool, enters_samples: bool
) -> list[Component]:
    """Return the three components of an error term, one per axis."""
    seconds = prepared_case.lengths
    variances, walks = squares(term.sigma), squares(term.walk)
    if term.driver == REMAINDER:
        # the remainder is new at the end of every window, uniform over a step; it stays in a window without ticks
        factor = np.where(seconds > 0.0, 0.0, 1.0)
        noise = [np.where(seconds > 0.0, walk, 0.0) for walk in walks]
    else:
        factor = np.exp(-seconds / term.time_constant)
        # Gauss-Markov: s^2 (1 - exp(-2 t / T)) keeps the variance s^2; a random walk adds its PSD times t
        loss = np.expm1(-2.0 * seconds / term.time_constant)
        noise = [walk * seconds - variance * loss for variance, walk in zip(variances, walks, strict=True)]
    is_modelled = term.offset >= 0
    has_same_decay = is_modelled and np.array_equal(factor, prepared_case.model.decay[:, term.offset])
    return [
        Component(
            source=source,
            factor=factor,
            noise=noise[axis],
            start=variances[axis],
            states=(term.offset + axis,) if is_modelled else (),
            has_cross=not has_same_decay,
            drives_motion=drives_motion,
            enters_samples=enters_samples,
            has_echo=term.driver == REMAINDER,
        )
        for axis in range(3)
    ]


def _correlated_tables(sigma: float, time_constant: float, seconds: Floats) -> tuple[Floats, Floats]:
    """Return decay factor and driving variance (n_length,) of a correlated measurement error."""
    # an error without memory is new at every epoch; it stays in a window without ticks
    if time_constant > 0.0:
        factor = np.exp(-seconds / time_constant)
    else:
        factor = np.where(seconds > 0.0, 0.0, 1.0)
    return factor, sigma**2 * (1.0 - factor**2)


def _correlated_components(prepared_case: PreparedCase, names: list[str]) -> tuple[list[Component], list[int]]:
    """Return the components of correlated measurement errors, and by family the block of extra states (-1 none)."""
    model, correlated_errors = prepared_case.model, prepared_case.signals.correlated_errors
    correlated_components: list[Component] = []
    blocks: list[int] = []
    for number, family in enumerate(prepared_case.families if model.has_epochs else ()):
        modelling = states_modelling(prepared_case.layout.extras, family.state, family.labels[0])
        block = modelling[0][0] if modelling else -1
        blocks.append(block)
        factor, noise = _correlated_tables(family.sigma, family.time_constant, prepared_case.lengths)
        has_same_partials = _has_filter_partials(prepared_case, number, block)
        for _ in family.labels:
            extra_states = correlated_errors.state_of[correlated_errors.error_of == len(correlated_components)]
            states = tuple(model.extra_offset[extra_states].tolist())
            has_same_decay = all(np.array_equal(factor, model.decay[:, state]) for state in states)
            component = Component(
                source=names.index(family.source),
                factor=factor,
                noise=noise,
                start=family.sigma**2,
                states=states,
                has_cross=not (has_same_partials and has_same_decay),
            )
            correlated_components.append(component)
    return correlated_components, blocks


def _has_filter_partials(prepared_case: PreparedCase, family: int, block: int) -> bool:
    """Return whether the true partial derivatives of correlated errors are those of a block of filter states."""
    if prepared_case.chain is not None or block < 0:
        return False
    correlated_errors = prepared_case.signals.correlated_errors
    model_partial = np.where(correlated_errors.member[family] >= 0, prepared_case.signals.partial[block], 0.0)
    return np.array_equal(correlated_errors.partial[family], model_partial)


def _white_noise(prepared_case: PreparedCase, names: list[str]) -> Floats:
    """Return the variance of white process noise by source, window length and joint state, SI squared."""
    imu, receiver, layout = prepared_case.scenario.imu, prepared_case.scenario.receiver, prepared_case.layout
    noise = np.zeros((len(names), prepared_case.lengths.size, n_joint(prepared_case)))
    seconds = prepared_case.lengths[:, None]
    # noise of an IMU array or of unequal axes enters by components, noise of IMU samples by their update
    if layout.motion < 0 and isinstance(imu, ImuCard):
        for label, first, card in (("gyro", ATT, imu.gyro), ("accelerometer", VEL, imu.accel)):
            if not isinstance(card.random_walk, tuple):
                source = names.index(f"{label} random walk")
                noise[source, :, first : first + 3] = card.random_walk**2 * seconds
    if layout.clock >= 0:
        densities = np.array(spectral_densities(receiver.clock.h0, receiver.clock.h_minus2))
        noise[names.index("receiver clock"), :, layout.clock : layout.clock + 2] = seconds * densities
    return noise


def _sample_noise(prepared_case: PreparedCase, names: list[str]) -> Floats:
    """Return the true noise variance of an IMU sample by source, (n_source, 6) SI squared."""
    imu, units = prepared_case.scenario.imu, prepared_case.options.imu_array
    noise = np.zeros((len(names), 6))
    for triad, (number, card) in enumerate(triad_imus(imu)):
        density = np.array([squares(card.gyro.random_walk), squares(card.accel.random_walk)])
        variance = density * imu.rate
        if units is not None:  # (2, 3, 3): weights of each sensing axis in the combined triad
            squared_weights = units.axis_weights[0, triad] ** 2
            variance = np.einsum("sic,sc->si", squared_weights, variance) * units.error_factors[0, :, 1] ** 2
        gyro_source = names.index(source_key("gyro random walk", number))
        accelerometer_source = names.index(source_key("accelerometer random walk", number))
        noise[gyro_source, :3] += variance[0]
        noise[accelerometer_source, 3:] += variance[1]
    return noise


def _initial_covariance(prepared_case: PreparedCase, names: list[str]) -> Floats:
    """Return the initial covariance of the joint states by source, (n_source, N, N) SI squared."""
    n = n_joint(prepared_case)
    layout = prepared_case.layout
    clock = prepared_case.scenario.receiver.clock
    covariance = np.zeros((len(names), n, n))
    for source, first in enumerate((ATT, VEL, POS)):  # the first three sources are the initial errors
        root = prepared_case.initial_state.roots[source]
        axes = slice(first, first + 3)
        covariance[source, axes, axes] = root @ root.T
    if layout.clock >= 0:
        variances = np.array([clock.initial_bias, clock.initial_drift]) ** 2
        states = slice(layout.clock, layout.clock + 2)
        covariance[names.index("receiver clock start"), states, states] = np.diag(variances)
    return covariance


def build_components(prepared_case: PreparedCase) -> Components:
    """Return the true error components of a case as arrays.

    The models are those of the truth. Of the filter only the state layout, the decay factors and the partial
    derivatives are used, to find by how much a component differs from the state that models it.
    """
    names = source_names(prepared_case)
    terms = _terms(prepared_case)
    profiles = _profiles(prepared_case)
    has_sample_updates = prepared_case.layout.motion >= 0
    blocks = [(term.sensor, term.driver, term.offset, term.triad) for term in terms] + profiles
    # contiguous columns, because kernels are compiled for contiguous arrays
    sensor, driver, filter_state, triad = np.array(blocks, dtype=np.int64).reshape(-1, 4).T.copy()
    profile = np.array([*[-1] * len(terms), *range(len(profiles))], dtype=np.int64)
    # a component with a matching state acts by the state's own transition, see `propagate._enter_states`
    block_drives_motion = (filter_state < 0) & ((driver == GRAVITY) | (not has_sample_updates))
    block_enters_samples = (filter_state < 0) & (driver >= 0) & has_sample_updates
    imu_components: list[Component] = []
    for term, drives_motion, enters_samples in zip(
        terms, block_drives_motion[: len(terms)].tolist(), block_enters_samples[: len(terms)].tolist(), strict=True
    ):
        imu_components += _term_components(prepared_case, term, names.index(term.name), drives_motion, enters_samples)
    n_imu = len(imu_components)  # correlated measurement errors follow
    first = np.where(profile < 0, 3 * np.arange(profile.size), -1)
    correlated_components, state_blocks = _correlated_components(prepared_case, names)
    tables = slot_tables(imu_components + correlated_components, len(names), prepared_case.lengths.size)
    state_weight = np.zeros((0, 0, 3, 0))
    if prepared_case.options.imu_array is not None:
        state_weight = state_weights(prepared_case.layout, prepared_case.options.imu_array, sensor, driver, triad)
    rows, columns, kinds, drivers = _true_transition(prepared_case)
    return Components(
        **tables,
        sensor=sensor,
        driver=driver,
        filter_state=filter_state,
        profile=profile,
        triad=triad,
        state_weight=state_weight,
        first=first,
        block_drives_motion=block_drives_motion,
        block_enters_samples=block_enters_samples,
        has_sample_updates=has_sample_updates,
        first_correlated=n_imu,
        modelling_block=np.array(state_blocks, dtype=np.int64),
        nav_rows=rows,
        nav_columns=columns,
        nav_kinds=kinds,
        nav_drivers=drivers,
        white_variance=arrange_by_length(_white_noise(prepared_case, names), tables["group"], tables["lane"]),
        initial_covariance=_initial_covariance(prepared_case, names),
        noise_source=noise_sources(prepared_case, names),
        state_decay=_joint_decay(prepared_case),
        **measurement_tables(prepared_case, names),
        sample_noise=_sample_noise(prepared_case, names),
        imu_differences=differences(prepared_case, sensor, driver, triad, profile, first, n_imu),
        successive_errors=build_successive_errors(prepared_case, names, state_blocks),
    )


def _true_transition(prepared_case: PreparedCase) -> tuple[Ints, Ints, Ints, Ints]:
    """Return rows, columns, kinds and drivers (n_block,) of the blocks of the true transition."""
    model = prepared_case.model
    if prepared_case.layout.motion >= 0:  # everything but the gravity gradient is propagated sample by sample
        return model.block_rows, model.block_columns, model.block_kinds, model.block_drivers
    return transition_blocks(prepared_case.layout.parameters, 2)


def _joint_decay(prepared_case: PreparedCase) -> Floats:
    """Return the decay factors (n_length, N) of the joint states; receiver errors and clones do not decay."""
    n_further = n_joint(prepared_case) - prepared_case.layout.n_state
    return np.pad(prepared_case.model.decay, ((0, 0), (0, n_further)), constant_values=1.0)


def initial_state(prepared_case: PreparedCase, components: Components) -> tuple[Floats, Floats, Floats]:
    """Return `sources`, `cross` and `variance` of the joint covariance at the start, see `JointCovariance`.

    The initial estimate of a component is zero, so the error of the state that models it is the component itself.
    """
    n_source = len(components.initial_covariance)
    n_slot = components.has_cross.shape[1]
    group, lane = components.group, components.lane
    sources = components.initial_covariance.copy()
    cross = np.zeros((n_source, n_slot, n_joint(prepared_case)))
    component_variances = np.zeros((n_source, n_slot, 1))
    component_variances[components.source, components.slot, 0] = components.initial_variance
    for c, (source, slot, variance) in enumerate(
        zip(components.source, components.slot, components.initial_variance, strict=True)
    ):
        first_pair, last_pair = components.state_from[c], components.state_from[c + 1]
        states = components.states[first_pair:last_pair]
        sources[source, states[:, None], states] += variance
        cross[source, slot, states] += variance
    return (
        arrange_lanes(sources, group, lane),
        arrange_lanes(cross, group, lane),
        arrange_lanes(component_variances, group, lane),
    )
