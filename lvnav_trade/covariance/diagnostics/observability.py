"""Observability of the filter's states over a part of the nominal flight."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.components import Components, components
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
from lvnav_trade.simulation.preparation.prepare import Prepared

TOLERANCE = 1e-2


class ObservabilityInterval(NamedTuple):
    """Observability of the filter's states over one interval of the flight.

    The singular values are those of the stacked rows H Phi, with rows in units of their noise sigma and directions in
    units of their initial sigma. A value of 1 means that the interval alone halves the variance of that direction.

    start : s since lift-off.
    end : s since lift-off.
    rank : Number of singular values above `TOLERANCE`.
    singular : (n_uncertain,). Singular values of the states with an initial sigma, descending.
    weakest : (n,). Direction of the smallest singular value, in initial sigmas; its largest entry is 1.
    rows : Number of scalar measurements.
    directions : (n_uncertain, n). Directions of all singular values, likewise.
    """

    start: float
    end: float
    rank: int
    singular: Floats
    weakest: Floats
    rows: int
    directions: Floats


@jit
def fold(triangle, row):
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
            above = triangle[k, j]
            triangle[k, j] = c * above + s * row[j]
            row[j] = c * row[j] - s * above


class _Samples(NamedTuple):
    """IMU samples as measurements.

    dt : s. Tick.
    vehicle : Vehicle model of the filter.
    reference : True motion of the nominal flight.
    """

    dt: float
    vehicle: VehicleModel
    reference: Reference


class _Folding(NamedTuple):
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
def _fold_samples(folding, samples, first, n_tick):
    """Add the rows of the IMU samples of a window, and propagate the transition; return the number of rows.

    Parameters
    ----------
    folding : _Folding, updated in place
    samples : _Samples
    first, n_tick : first tick, number of ticks
    """
    vehicle = samples.vehicle
    columns = vehicle.columns
    phi, h, row = folding.phi, folding.h, folding.row
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
            fold(folding.triangle, row)
        nominal_tick(folding.sums, samples.reference, tick, samples.dt)
        for j in range(n):
            advance_vector(phi[j], folding.sums, samples.dt, vehicle.motion)
    return N_SAMPLE * n_tick


class _ObservabilityArrays(NamedTuple):
    """Arrays of schedule, tape and model from which observability is computed, with the names that they have there.

    Passing the whole records would take ten times as long to compile.

    first_tick : (n_window,). First tick of each window.
    n_tick : (n_window,). Number of ticks of each window.
    length : (n_window,). Index of the window's length in `seconds`.
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
    length: Ints
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
def _gather(folding, rows, samples, delayed, extra_offset, first_window, last_window):
    """Add all rows H Phi of an interval, in units of their noise sigma; return the number of rows.

    Parameters
    ----------
    folding : _Folding, updated in place
    rows : _ObservabilityArrays
    samples : _Samples of a filter that processes IMU samples, or None. Angular rate and specific force are then assumed
        constant over the interval, the hardest case for the other states.
    delayed : DifferenceProcessing, or None
    extra_offset : (n_extra,) state of each extra state
    first_window, last_window : windows of the interval
    """
    phi = folding.phi
    whitened_row = folding.row
    n = phi.shape[0]
    count = 0
    block_rows, block_columns, kinds, drivers = rows.blocks
    for w in range(first_window, last_window + 1):
        n_tick = rows.n_tick[w]
        epoch = rows.epoch[w]
        if n_tick > 0:
            if samples is not None:
                count += _fold_samples(folding, samples, rows.first_tick[w], n_tick)
            length = rows.length[w]
            seconds, decay = rows.seconds[length], rows.decay[length]
            x, y, z = rows.position[w, 0], rows.position[w, 1], rows.position[w, 2]
            transition.fill(folding.blocks, kinds, drivers, rows.sums[w], x, y, z, seconds)
            for j in range(n):
                apply_phi(phi[j], folding.blocks, block_rows, block_columns, decay, rows.clock, seconds)
        for row in range(rows.first[w], rows.first[w + 1]):
            channel = rows.channel[row]
            for j in range(n):
                total = 0.0
                for k in range(rows.n_entry[channel]):
                    entry, state = rows.entry[channel, k], rows.column[channel, k]
                    total += rows.h[row, entry] * phi[j, state]
                whitened_row[j] = rows.weight[row] * total
            fold(folding.triangle, whitened_row)
            count += 1
        if delayed is not None and epoch >= 0:
            _begin_epoch(phi, delayed, extra_offset, epoch)
    return count


def _rows(prepared: Prepared, true: Components, tape: UpdateTape) -> _ObservabilityArrays:
    """Return the arrays of a case and its forward pass from which observability is computed."""
    schedule, model, signals = prepared.schedule, prepared.model, prepared.signals
    n_update = int(tape.used[0])
    epoch, channel = tape.epoch[:n_update], tape.channel[:n_update]
    is_whitened = model.has_covariance & (channel < signals.n_receiver)
    variance = np.where(is_whitened, 1.0, _variances(prepared)[epoch, channel])
    return _ObservabilityArrays(
        first_tick=schedule.first_tick,
        n_tick=schedule.n_tick,
        length=schedule.length,
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
        blocks=(true.nav_rows, true.nav_columns, true.nav_kinds, true.nav_drivers),
        clock=model.clock,
    )


@jit
def _begin_epoch(phi, delayed, extra_offset, epoch):
    """Set the clones to the present states, and reset renewed states, in the transposed transition.

    Parameters
    ----------
    phi : (n, n) transposed transition, updated in place
    delayed : DifferenceProcessing
    extra_offset : (n_extra,) state of each extra state
    epoch : index
    """
    for j in range(phi.shape[0]):
        for e in range(extra_offset.shape[0]):
            if delayed.renewed[epoch, e] >= 0.0:
                phi[j, extra_offset[e]] = 0.0
        for c in range(delayed.cloned.shape[0]):
            phi[j, delayed.clone + c] = phi[j, delayed.cloned[c]]


def _triangular_factor(prepared: Prepared, rows: _ObservabilityArrays, first: int, last: int) -> tuple[int, Floats]:
    """Return the number of scalar measurements of some windows, and the triangular factor (n, n) of their rows.

    Parameters
    ----------
    prepared
        Prepared case.
    rows
        Arrays of the forward pass.
    first, last
        Windows, both included.
    """
    n = prepared.layout.n_state
    vehicle = prepared.options.vehicle
    delayed = prepared.options.delayed
    folding = _Folding(
        triangle=np.zeros((n, n)),
        phi=np.eye(n),
        blocks=np.zeros((rows.blocks[0].size, 9)),
        row=np.zeros(n),
        sums=np.zeros(N_SUM),
        h=np.zeros((N_SAMPLE, 1 if vehicle is None else vehicle.columns.shape[1])),
    )
    phi = folding.phi
    for clone, state in enumerate(prepared.layout.cloned, start=prepared.layout.clone):
        # a clone begins as a copy of its state; row j of phi is the column of Phi that belongs to state j
        phi[clone, clone] = 0.0
        phi[state, clone] = 1.0
    samples = None if vehicle is None else _Samples(prepared.unit.dt, vehicle, prepared.reference)
    count = _gather(folding, rows, samples, delayed, prepared.model.extra_offset, first, last)
    return count, folding.triangle


def _interval(prepared: Prepared, rows: _ObservabilityArrays, start: float, end: float) -> ObservabilityInterval:
    """Return the observability over the windows that end between start and end (s since lift-off)."""
    schedule = prepared.schedule
    states = np.array(prepared.layout.reported)
    ends = prepared.reference.t[schedule.first_tick + schedule.n_tick]
    windows = np.flatnonzero((ends > start + 1e-9) & (ends <= end + 1e-9))
    count, triangle = _triangular_factor(prepared, rows, int(windows[0]), int(windows[-1]))
    scale, root = initial_spread(prepared.start.P[np.ix_(states, states)])
    uncertain = scale > 0.0  # a state without initial sigma is known exactly, not unobservable
    root = root[np.ix_(uncertain, uncertain)]
    # with independent errors y, x = scale (root y): the rows of H Phi diag(scale) root are per unit of y
    scaled = (triangle[:, states] * scale)[:, uncertain] @ root
    singular, vectors = decompose(scaled, root)
    directions = np.zeros((singular.size, states.size))
    directions[:, uncertain] = vectors
    return ObservabilityInterval(
        start=start,
        end=end,
        rank=int(np.sum(singular > TOLERANCE)),
        singular=singular,
        weakest=directions[-1],
        rows=count,
        directions=directions,
    )


def _variances(prepared: Prepared) -> Floats:
    """Return the noise variance of the measurements in the filter model, (n_epoch, n_channel) SI squared.

    If the noise of a difference is a state of the filter, its variance is added as if it were white.
    """
    variance, delayed = prepared.signals.variance, prepared.options.delayed
    first = 0
    for block in prepared.layout.extras:
        if delayed is not None and block.name in NOISE_STATES.values():
            channels = np.flatnonzero(block.member >= 0)
            variance = variance.copy()
            variance[:, channels] = 2.0 * delayed.renewed[:, first + block.member[channels]]
        first += len(block.labels)
    return variance


def initial_spread(P: Floats) -> tuple[Floats, Floats]:
    """Return the initial sigmas (n,) and a square root (n, n) of the initial correlation matrix.

    For a vector y of independent standard normals, scale * (root @ y) is an initial error. Tilt and heading are
    correlated in the axes of frame i.
    """
    scale = np.sqrt(np.diag(P))
    safe = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(P / np.outer(safe, safe))
    root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    return scale, root


def decompose(scaled: Floats, root: Floats) -> tuple[Floats, Floats]:
    """Return the singular values (n,), descending, and their directions (n, n) in initial sigmas, largest entry 1."""
    _, singular, right = np.linalg.svd(scaled)
    directions = right @ root.T
    largest = np.argmax(np.abs(directions), axis=1)
    return singular, directions / np.take_along_axis(directions, largest[:, None], axis=1)


def observability(prepared: Prepared, edges: Floats, tape: UpdateTape | None = None) -> list[ObservabilityInterval]:
    """Return the observability of the filter's states over the intervals between edges, on the nominal flight.

    Parameters
    ----------
    prepared
        Prepared case.
    edges
        s since lift-off. Bounds of the intervals; edges outside the flight are moved to its ends.
    tape
        Tape of the forward pass; None: computed here.
    """
    rows = _rows(prepared, components(prepared), tape or forward_tape(prepared))
    t = prepared.reference.t
    marks = np.unique(np.clip(edges, t[0], t[-1]))
    return [_interval(prepared, rows, float(start), float(end)) for start, end in pairwise(marks)]


def in_words(direction: Floats, names: tuple[str, ...], threshold: float = 0.3) -> str:
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
