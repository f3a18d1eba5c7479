"""Observability of the filter's states over a part of the nominal flight."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.components import Components, build_components
from lvnav_trade.covariance.history import forward_tape
from lvnav_trade.covariance.workspace import UpdateTape
from lvnav_trade.filter.policies.imu_samples import VehicleModel
from lvnav_trade.filter.states import NOISE_STATES
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import apply_phi
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.strapdown import N_SUM
from lvnav_trade.kernels.vehicle import N_SAMPLE, advance_vector, fill_samples
from lvnav_trade.quantities.records import Floats, Ints, Reference
from lvnav_trade.simulation.epoch.joint_ticks import nominal_tick
from lvnav_trade.simulation.preparation.prepare import PreparedCase

TOLERANCE = 1e-2


class ObservabilityInterval(NamedTuple):
    """Observability of the filter's states over one interval of the flight.

    The singular values are those of the stacked rows H Phi, with rows in units of their noise sigma and directions in
    units of their initial sigma. A value of 1 means that the interval alone halves the variance of that direction.

    start : s since lift-off.
    end : s since lift-off.
    rank : Number of singular values above `TOLERANCE`.
    singular_values : (n_uncertain,). Singular values of the states with an initial sigma, descending.
    weakest_direction : (n,). Direction of the smallest singular value, in initial sigmas; its largest entry is 1.
    measurement_count : Number of scalar measurements.
    directions : (n_uncertain, n). Directions of all singular values, likewise.
    """

    start: float
    end: float
    rank: int
    singular_values: Floats
    weakest_direction: Floats
    measurement_count: int
    directions: Floats


@jit
def add_row(triangle, row):
    """Add a row to the triangular factor of the rows so far, by Givens rotations.

    LAPACK is not used, because the last bits of a long factorisation depend on the number of threads.

    Parameters
    ----------
    triangle : (n, n) triangular factor, updated in place
    row : (n,) overwritten
    """
    n = row.shape[0]
    for k in range(n):
        if row[k] == 0.0:
            continue
        diagonal = triangle[k, k]
        size = np.sqrt(diagonal**2 + row[k] ** 2)
        c = diagonal / size
        s = row[k] / size
        for j in range(k, n):
            upper_entry = triangle[k, j]
            triangle[k, j] = c * upper_entry + s * row[j]
            row[j] = c * row[j] - s * upper_entry


class _Samples(NamedTuple):
    """IMU samples as measurements.

    dt : s. Tick.
    vehicle : Vehicle model of the filter.
    reference : True motion of the nominal flight.
    """

    dt: float
    vehicle: VehicleModel
    reference: Reference


class _RowFactorisation(NamedTuple):
    """Triangular factor of the rows so far, and scratch for the next row.

    triangle : (n_state, n_state). Triangular factor of the rows so far.
    phi : (n_state, n_state). Transition matrix since the start of the interval, transposed.
    blocks : (n_block, 9). Blocks of the transition over a window.
    row : (n_state,). A Jacobian row times the transition, in sigmas of its noise.
    sums : (18,). Strapdown integrals over a tick.
    h : (6, n_entry). Jacobian rows of the samples of a tick.
    """

    triangle: Floats
    phi: Floats
    blocks: Floats
    row: Floats
    sums: Floats
    h: Floats


@jit
def _add_sample_rows(factorisation, samples, first, n_tick):
    """Add the rows of the IMU samples of a window, and propagate the transition; return the number of rows.

    Parameters
    ----------
    factorisation : _RowFactorisation, updated in place
    samples : _Samples
    first, n_tick : first tick, number of ticks
    """
    vehicle = samples.vehicle
    columns = vehicle.columns
    phi, h, row = factorisation.phi, factorisation.h, factorisation.row
    n = phi.shape[0]
    for tick in range(first, first + n_tick):
        fill_samples(h, vehicle.blocks, vehicle.rate[tick], vehicle.force[tick])
        for r in range(N_SAMPLE):
            weight = 1.0 / np.sqrt(vehicle.variance[r])
            for j in range(n):
                total = 0.0
                for k in range(columns.shape[1]):
                    total += h[r, k] * phi[j, columns[r, k]]
                row[j] = weight * total
            add_row(factorisation.triangle, row)
        nominal_tick(factorisation.sums, samples.reference, tick, samples.dt)
        for j in range(n):
            advance_vector(phi[j], factorisation.sums, samples.dt, vehicle.motion)
    return N_SAMPLE * n_tick


class _ObservabilityArrays(NamedTuple):
    """Arrays of schedule, tape and model from which observability is computed, with the names that they have there.

    Passing the whole records would take ten times as long to compile.

    first_tick : (n_window,). First tick of each window.
    n_tick : (n_window,). Number of ticks of each window.
    length_index : (n_window,). Index of the window's length in `seconds`.
    epoch : (n_window,). Epoch at the end of the window, -1 none.
    first : (n_window + 1,). Number of updates before those at the end of each window.
    channel : (n_update,). Channel of each update.
    sums : (n_window, 18). Strapdown integrals over each window.
    position : (n_window, 3) m. Position in frame i at which the gravity gradient is evaluated.
    h : (n_update, n_entry). Jacobian row of each update.
    weight : (n_update,). One over the standard deviation of its noise.
    n_entry : (n_channel,). Number of Jacobian entries that are not zero.
    entry : (n_channel, n_entry). Places of these entries in the Jacobian row.
    column : (n_channel, n_entry). States that these entries belong to.
    seconds : (n_length,) s. Window lengths.
    decay : (n_length, n_state). Decay factor of each state over a window.
    blocks : Rows, columns, kinds and drivers (n_block,) of the blocks of the true transition.
    clock : State of the clock bias, -1 none.
    """

    first_tick: Ints
    n_tick: Ints
    length_index: Ints
    epoch: Ints
    first: Ints
    channel: Ints
    sums: Floats
    position: Floats
    h: Floats
    weight: Floats
    n_entry: Ints
    entry: Ints
    column: Ints
    seconds: Floats
    decay: Floats
    blocks: tuple[Ints, Ints, Ints, Ints]
    clock: int


@jit
def _gather(factorisation, rows, samples, differences, extra_offset, first_window, last_window):
    """Add all rows H Phi of an interval, in units of their noise sigma; return the number of rows.

    Parameters
    ----------
    factorisation : _RowFactorisation, updated in place
    rows : _ObservabilityArrays
    samples : _Samples of a filter that processes IMU samples, or None. Angular rate and specific force are then assumed
        constant over the interval, the hardest case for the other states.
    differences : DifferenceProcessing, or None
    extra_offset : (n_extra,) state of each extra state
    first_window, last_window : windows of the interval
    """
    phi = factorisation.phi
    whitened_row = factorisation.row
    n = phi.shape[0]
    count = 0
    block_rows, block_columns, kinds, drivers = rows.blocks
    for w in range(first_window, last_window + 1):
        n_tick = rows.n_tick[w]
        epoch = rows.epoch[w]
        if n_tick > 0:
            if samples is not None:
                count += _add_sample_rows(factorisation, samples, rows.first_tick[w], n_tick)
            length_index = rows.length_index[w]
            seconds, decay = rows.seconds[length_index], rows.decay[length_index]
            x, y, z = rows.position[w, 0], rows.position[w, 1], rows.position[w, 2]
            transition.fill(factorisation.blocks, kinds, drivers, rows.sums[w], x, y, z, seconds)
            for j in range(n):
                apply_phi(phi[j], factorisation.blocks, block_rows, block_columns, decay, rows.clock, seconds)
        for row in range(rows.first[w], rows.first[w + 1]):
            channel = rows.channel[row]
            for j in range(n):
                total = 0.0
                for k in range(rows.n_entry[channel]):
                    entry, state = rows.entry[channel, k], rows.column[channel, k]
                    total += rows.h[row, entry] * phi[j, state]
                whitened_row[j] = rows.weight[row] * total
            add_row(factorisation.triangle, whitened_row)
            count += 1
        if differences is not None and epoch >= 0:
            _begin_epoch(phi, differences, extra_offset, epoch)
    return count


def _rows(prepared_case: PreparedCase, components: Components, tape: UpdateTape) -> _ObservabilityArrays:
    """Return the arrays of a case and its forward pass from which observability is computed."""
    schedule, model, signals = prepared_case.schedule, prepared_case.model, prepared_case.signals
    n_update = int(tape.n_recorded[0])
    epoch, channel = tape.epoch[:n_update], tape.channel[:n_update]
    is_whitened = model.has_reported_covariance & (channel < signals.n_receiver)
    variance = np.where(is_whitened, 1.0, _variances(prepared_case)[epoch, channel])
    return _ObservabilityArrays(
        first_tick=schedule.first_tick,
        n_tick=schedule.n_tick,
        length_index=schedule.length_index,
        epoch=schedule.epoch,
        first=tape.first,
        channel=tape.channel,
        sums=tape.sums,
        position=tape.position,
        h=tape.h,
        weight=1.0 / np.sqrt(variance),
        n_entry=model.n_entry,
        entry=model.entry,
        column=model.column,
        seconds=model.seconds,
        decay=model.decay,
        blocks=(components.nav_rows, components.nav_columns, components.nav_kinds, components.nav_drivers),
        clock=model.clock,
    )


@jit
def _begin_epoch(phi, differences, extra_offset, epoch):
    """Set the clones to the present states, and reset renewed states, in the transposed transition.

    Parameters
    ----------
    phi : (n, n) transposed transition, updated in place
    differences : DifferenceProcessing
    extra_offset : (n_extra,) state of each extra state
    epoch : index
    """
    for j in range(phi.shape[0]):
        for e in range(extra_offset.shape[0]):
            if differences.reset_variance[epoch, e] >= 0.0:
                phi[j, extra_offset[e]] = 0.0
        for c in range(differences.cloned_states.shape[0]):
            phi[j, differences.clone + c] = phi[j, differences.cloned_states[c]]


def _triangular_factor(
    prepared_case: PreparedCase, rows: _ObservabilityArrays, first: int, last: int
) -> tuple[int, Floats]:
    """Return the number of scalar measurements of some windows, and the triangular factor (n, n) of their rows.

    Parameters
    ----------
    prepared_case
        Prepared case.
    rows
        Arrays of the forward pass.
    first, last
        Windows, both included.
    """
    n = prepared_case.layout.n_state
    vehicle = prepared_case.options.vehicle
    differences = prepared_case.options.differences
    factorisation = _RowFactorisation(
        triangle=np.zeros((n, n)),
        phi=np.eye(n),
        blocks=np.zeros((rows.blocks[0].size, 9)),
        row=np.zeros(n),
        sums=np.zeros(N_SUM),
        h=np.zeros((N_SAMPLE, 1 if vehicle is None else vehicle.columns.shape[1])),
    )
    phi = factorisation.phi
    for clone, state in enumerate(prepared_case.layout.cloned_states, start=prepared_case.layout.clone):
        # a clone begins as a copy of its state; row j of phi is the column of Phi that belongs to state j
        phi[clone, clone] = 0.0
        phi[state, clone] = 1.0
    samples = None if vehicle is None else _Samples(prepared_case.unit.dt, vehicle, prepared_case.reference)
    count = _gather(factorisation, rows, samples, differences, prepared_case.model.extra_offset, first, last)
    return count, factorisation.triangle


def _interval(
    prepared_case: PreparedCase, rows: _ObservabilityArrays, start: float, end: float
) -> ObservabilityInterval:
    """Return the observability over the windows that end between start and end (s since lift-off)."""
    schedule = prepared_case.schedule
    states = np.array(prepared_case.layout.reported_states)
    ends = prepared_case.reference.t[schedule.first_tick + schedule.n_tick]
    windows = np.flatnonzero((ends > start + 1e-9) & (ends <= end + 1e-9))
    count, triangle = _triangular_factor(prepared_case, rows, int(windows[0]), int(windows[-1]))
    scale, root = initial_spread(prepared_case.initial_state.P[np.ix_(states, states)])
    is_uncertain = scale > 0.0  # a state without initial sigma is known exactly, not unobservable
    root = root[np.ix_(is_uncertain, is_uncertain)]
    # with independent errors y, x = scale (root y): the rows of H Phi diag(scale) root are per unit of y
    scaled_rows = (triangle[:, states] * scale)[:, is_uncertain] @ root
    singular_values, vectors = decompose(scaled_rows, root)
    directions = np.zeros((singular_values.size, states.size))
    directions[:, is_uncertain] = vectors
    return ObservabilityInterval(
        start=start,
        end=end,
        rank=int(np.sum(singular_values > TOLERANCE)),
        singular_values=singular_values,
        weakest_direction=directions[-1],
        measurement_count=count,
        directions=directions,
    )


def _variances(prepared_case: PreparedCase) -> Floats:
    """Return the noise variance of the measurements in the filter model, (n_epoch, n_channel) SI squared.

    If the noise of a difference is a state of the filter, its variance is added as if it were white.
    """
    variance, differences = prepared_case.signals.variance, prepared_case.options.differences
    first = 0
    for block in prepared_case.layout.extras:
        if differences is not None and block.name in NOISE_STATES.values():
            channels = np.flatnonzero(block.member >= 0)
            variance = variance.copy()
            variance[:, channels] = 2.0 * differences.reset_variance[:, first + block.member[channels]]
        first += len(block.labels)
    return variance


def initial_spread(P: Floats) -> tuple[Floats, Floats]:
    """Return the initial sigmas (n,) and a square root (n, n) of the initial correlation matrix.

    For a vector y of independent standard normals, scale * (root @ y) is an initial error. Tilt and heading are
    correlated in the axes of frame i.
    """
    scale = np.sqrt(np.diag(P))
    divisor = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(P / np.outer(divisor, divisor))
    root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    return scale, root


def decompose(scaled_rows: Floats, root: Floats) -> tuple[Floats, Floats]:
    """Return the singular values (n,), descending, and their directions (n, n) in initial sigmas, largest entry 1."""
    _, singular_values, right_vectors = np.linalg.svd(scaled_rows)
    directions = right_vectors @ root.T
    largest = np.argmax(np.abs(directions), axis=1)
    return singular_values, directions / np.take_along_axis(directions, largest[:, None], axis=1)


def observability(
    prepared_case: PreparedCase, edges: Floats, tape: UpdateTape | None = None
) -> list[ObservabilityInterval]:
    """Return the observability of the filter's states over the intervals between edges, on the nominal flight.

    Parameters
    ----------
    prepared_case
        Prepared case.
    edges
        s since lift-off. Bounds of the intervals; edges outside the flight are moved to its ends.
    tape
        Tape of the forward pass; None: computed here.
    """
    rows = _rows(prepared_case, build_components(prepared_case), tape or forward_tape(prepared_case))
    t = prepared_case.reference.t
    marks = np.unique(np.clip(edges, t[0], t[-1]))
    return [_interval(prepared_case, rows, float(start), float(end)) for start, end in pairwise(marks)]


def direction_text(direction: Floats, names: tuple[str, ...], threshold: float = 0.3) -> str:
    """Return a direction of the state space in words: its largest entries with the names of the states.

    Parameters
    ----------
    direction
        (n,). Direction, in initial sigmas.
    names
        Names of the states.
    threshold
        Smallest magnitude of an entry that is included.
    """
    order = np.argsort(-np.abs(direction))
    entries = [f"{direction[i]:+.2f} {names[i]}" for i in order if abs(direction[i]) >= threshold]
    return ", ".join(entries)
