"""What is true of a case's error sources, in numbers for the linear covariance, apart from what the filter believes."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.engines.altimeter import NOISE
from lvnav_trade.engines.chained import CARRIED, CHAINED, N_KEPT_STATE, N_NAV, kept_column
from lvnav_trade.engines.prepare import Prepared
from lvnav_trade.engines.vehicle import ATTITUDE_NOISE
from lvnav_trade.filters.belief import INERTIAL, TIGHT, transition_blocks
from lvnav_trade.kernels.clock import spectral_densities
from lvnav_trade.kernels.transition import ACCEL, ATT, CONSTANT, GYRO, POS, VEL
from lvnav_trade.records import Floats

Ints = NDArray[np.int64]

# A parameter that no increment multiplies but enters as a difference: what quantisation holds back.
REMAINDER = -1


class TrueModel(NamedTuple):
    """What is true of the error sources, apart from what the filter believes.

    Blocks of three parameters: sensor, driver (REMAINDER, GRAVITY: see there), matched (offset of the filter's state
    for the same thing, -1 none), source (index of each block's source), profile (that is its mean, -1 none), all
    (n_block,); fade, wander (n_length, n_block): decay and driving variance over each window length; start (n_block,)
    variance. Errors that measurements share, by component: shared_source, shared_matched (n_component,), shared_fade,
    shared_wander (n_length, n_component), shared_start (n_component,) as above; shared_family (n_family,) family of the
    filter's extra states that stands for the same thing, -1 none. nav_rows ... nav_drivers: blocks of the true
    transition of e. noise (n_source, n_length, n): white noise of each source; initial (n_source, n, n); row_source
    (5,) source of each row type; decay (n_length, n) of e as the filter believes; n_entry (n_channel,), entry, column
    of rows with respect to the n states of the joint vector: e, and where there are such the error of a solution from
    `chain` on (-1 none) with sources chain_source (n_in,) of its white errors, and the kept error from `kept` on;
    corrected: the same where rows are of the kept state, so that what one row corrects is taken off the next, -1 else.
    """

    sensor: Ints
    driver: Ints
    matched: Ints
    source: Ints
    profile: Ints
    fade: Floats
    wander: Floats
    start: Floats
    shared_source: Ints
    shared_matched: Ints
    shared_fade: Floats
    shared_wander: Floats
    shared_start: Floats
    shared_family: Ints
    nav_rows: Ints
    nav_columns: Ints
    nav_kinds: Ints
    nav_drivers: Ints
    noise: Floats
    initial: Floats
    row_source: Ints
    decay: Floats
    n_entry: Ints
    entry: Ints
    column: Ints
    chain: int
    chain_source: Ints
    kept: int
    corrected: int


def source_names(prepared: Prepared) -> list[str]:
    """Return every physical source of error of a case, in the order of the budget."""
    scenario, tight = prepared.scenario, prepared.belief.kind == TIGHT
    names = [
        "initial attitude",
        "initial velocity",
        "initial position",
        "gyro random walk",
        "accelerometer random walk",
    ]
    names += list(dict.fromkeys(block.source for block in prepared.sources))
    if scenario.imu.gyro.quantisation > 0.0:
        names.append("gyro quantisation")
    if scenario.imu.accel.quantisation > 0.0:
        names.append("accelerometer quantisation")
    if prepared.belief.kind != INERTIAL:
        names += list(dict.fromkeys(family.source for family in prepared.families))
    if tight:
        names += ["receiver clock start", "receiver clock", "pseudorange noise", "range-rate noise"]
    elif prepared.options.solver is not None:
        names += ["receiver clock", "pseudorange noise", "range-rate noise"]
    elif prepared.belief.kind != INERTIAL:
        names += ["position solution noise", "velocity solution noise"]
    if prepared.options.altimeter is not None:
        names.append(NOISE)
    if prepared.vehicle is not None:
        names.append(ATTITUDE_NOISE)
    return names


def n_joint(prepared: Prepared) -> int:
    """Return how many states the joint vector has: the filter's, those of a solution's error, and what is kept."""
    chain = 0 if prepared.chain is None else prepared.chain.move.shape[1]
    return prepared.layout.n_state + chain + (0 if prepared.options.late is None else N_KEPT_STATE)


# By the codes of `solution`.
_WHITE = (
    "pseudorange noise",
    "range-rate noise",
    "receiver clock",
    "position solution noise",
    "velocity solution noise",
)


def _behind(prepared: Prepared, names: list[str]) -> dict[str, Any]:
    """Return where the states behind e stand, and the rows with respect to the whole joint vector; see TrueModel."""
    belief, chain, late, n = prepared.belief, prepared.chain, prepared.options.late, prepared.layout.n_state
    at_chain = -1 if chain is None else n
    at_kept = -1 if late is None else n + (0 if chain is None else chain.move.shape[1])
    buffered = late is not None and not late.extrapolated
    rows = []
    for channel, count in enumerate(belief.n_entry.tolist()):
        pairs = [
            (int(e), kept_column(int(c), at_kept, buffered))
            for e, c in zip(belief.entry[channel, :count], belief.column[channel, :count], strict=True)
        ]
        if chain is not None:
            pairs += [(CHAINED + i, at_chain + int(chain.pick[i])) for i in range(6)]
            if late is not None and not buffered:
                pairs += [(CARRIED + i, at_kept + VEL + i) for i in range(3)]
                pairs += [(CARRIED + 3 + i, at_kept + N_NAV + i) for i in range(3)]
        rows.append(pairs)
    width = max((len(pairs) for pairs in rows), default=0)
    entry, column = np.zeros((len(rows), width), dtype=np.int64), np.zeros((len(rows), width), dtype=np.int64)
    for channel, pairs in enumerate(rows):
        for i, (e, c) in enumerate(pairs):
            entry[channel, i], column[channel, i] = e, c
    kinds = np.zeros(0, dtype=np.int64) if chain is None else chain.kind
    return {
        "n_entry": np.array([len(pairs) for pairs in rows], dtype=np.int64),
        "entry": entry,
        "column": column,
        "chain": at_chain,
        "chain_source": np.array([names.index(_WHITE[kind]) for kind in kinds], dtype=np.int64),
        "kept": at_kept,
        "corrected": at_kept if buffered else -1,
    }


def _block_table(prepared: Prepared, names: list[str]) -> list[tuple[int, int, int, int, float, float, float, int]]:
    """List every true block: sensor, driver, matched state, source, start variance, walk PSD, time constant,
    profile.
    """
    imu = prepared.scenario.imu
    states = {(p.sensor, p.driver): p.offset for p in prepared.layout.parameters}
    table = [
        (b.sensor, b.driver, states.get((b.sensor, b.driver), -1), names.index(b.source), b.sigma**2, b.walk**2,
        b.time_constant, -1) for b in prepared.sources
    ]  # fmt: skip
    for sensor, card, label in ((GYRO, imu.gyro, "gyro"), (ACCEL, imu.accel, "accelerometer")):
        if card.quantisation > 0.0:
            table.append(
                (sensor, REMAINDER, -1, names.index(f"{label} quantisation"), 0.0, card.quantisation**2 / 12.0, 0.0, -1)
            )
    for profile, sensor in enumerate(prepared.unit.profile_sensor.tolist()):
        table.append((sensor, CONSTANT, states.get((sensor, CONSTANT), -1), 0, 0.0, 0.0, math.inf, profile))
    return table


def _shared(prepared: Prepared, names: list[str]) -> dict[str, Floats | Ints]:
    """Return what is true of the errors that measurements share, by component; see TrueModel."""
    seconds, families, belief = prepared.lengths, prepared.families, prepared.belief
    inertial = belief.kind == INERTIAL
    parts = [] if inertial else [(names.index(f.source), f.sigma, f.time_constant) for f in families for _ in f.labels]
    fade, wander = np.ones((seconds.size, len(parts))), np.zeros((seconds.size, len(parts)))
    for m, (_, sigma, time_constant) in enumerate(parts):
        # an error without memory is a new one at every epoch; a window of no ticks leaves it as it was
        still = 1.0 if math.isinf(time_constant) else 0.0
        fade[:, m] = np.exp(-seconds / time_constant) if time_constant > 0.0 else np.where(seconds > 0.0, still, 1.0)
        wander[:, m] = sigma**2 * (1.0 - fade[:, m] ** 2)
    extra = prepared.signals.shared.extra[: len(parts)]
    by_name = {block.name: f for f, block in enumerate(prepared.layout.extras)}
    return {
        "shared_source": np.array([part[0] for part in parts], dtype=np.int64),
        "shared_matched": np.array([belief.extra_offset[e] if e >= 0 else -1 for e in extra], dtype=np.int64),
        "shared_fade": fade,
        "shared_wander": wander,
        "shared_start": np.array([part[1] ** 2 for part in parts], dtype=float),
        "shared_family": np.array([by_name.get(f.state, -1) for f in families], dtype=np.int64),
    }


def _fade_and_wander(table: list[Any], seconds: Floats) -> tuple[Floats, Floats]:
    fade, wander = np.ones((seconds.size, len(table))), np.zeros((seconds.size, len(table)))
    for j, (_, driver, _, _, variance, walk, time_constant, _) in enumerate(table):
        if driver == REMAINDER:
            # a new remainder at the end of every window, uniform over a step; a window of no ticks leaves it as it was
            fade[:, j], wander[:, j] = np.where(seconds > 0.0, 0.0, 1.0), np.where(seconds > 0.0, walk, 0.0)
        else:
            fade[:, j] = np.exp(-seconds / time_constant)
            wander[:, j] = walk * seconds - variance * np.expm1(-2.0 * seconds / time_constant)
    return fade, wander


def _white_noise(prepared: Prepared, names: list[str]) -> Floats:
    imu, receiver, layout = prepared.scenario.imu, prepared.scenario.receiver, prepared.layout
    noise = np.zeros((len(names), prepared.lengths.size, n_joint(prepared)))
    seconds = prepared.lengths[:, None]
    noise[names.index("gyro random walk"), :, ATT : ATT + 3] = imu.gyro.random_walk**2 * seconds
    noise[names.index("accelerometer random walk"), :, VEL : VEL + 3] = imu.accel.random_walk**2 * seconds
    if layout.clock >= 0:
        densities = np.array(spectral_densities(receiver.clock.h0, receiver.clock.h_minus2))
        noise[names.index("receiver clock"), :, layout.clock : layout.clock + 2] = seconds * densities
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


def true_model(prepared: Prepared, names: list[str]) -> TrueModel:
    """Turn the truth's cards into numbers; the filter's card is asked only which states it carries."""
    table = _block_table(prepared, names)
    columns = list(zip(*table, strict=True)) if table else [()] * 8
    fade, wander = _fade_and_wander(table, prepared.lengths)
    rows, cols, kinds, drivers = transition_blocks(prepared.layout.parameters, 2)
    row_names = ("pseudorange noise", "range-rate noise", "position solution noise", "velocity solution noise", NOISE)
    return TrueModel(
        sensor=np.array(columns[0], dtype=np.int64),
        driver=np.array(columns[1], dtype=np.int64),
        matched=np.array(columns[2], dtype=np.int64),
        source=np.array(columns[3], dtype=np.int64),
        profile=np.array(columns[7], dtype=np.int64),
        fade=fade,
        wander=wander,
        start=np.array(columns[4], dtype=float),
        nav_rows=rows,
        nav_columns=cols,
        nav_kinds=kinds,
        nav_drivers=drivers,
        noise=_white_noise(prepared, names),
        initial=_initial(prepared, names),
        row_source=np.array([names.index(name) if name in names else -1 for name in row_names], dtype=np.int64),
        decay=np.pad(
            prepared.belief.decay, ((0, 0), (0, n_joint(prepared) - prepared.layout.n_state)), constant_values=1.0
        ),
        **_behind(prepared, names),
        **_shared(prepared, names),  # type: ignore[arg-type]  # every entry goes to the field of its name
    )


def initial_cross(prepared: Prepared, true: TrueModel) -> tuple[Floats, Floats]:
    """Return Cov(e, c) (n_block, 3, n) and Var(c) (n_block, 3) at the start: the estimate is zero, so the filter's
    error in a parameter is the true parameter itself, and Cov = +Var.
    """
    n_block = true.sensor.size
    cross = np.zeros((n_block, 3, n_joint(prepared)))
    variance = np.repeat(true.start[:, None], 3, axis=1) if n_block else np.zeros((0, 3))
    for j in range(n_block):
        if true.matched[j] >= 0:
            for axis in range(3):
                cross[j, axis, true.matched[j] + axis] = variance[j, axis]
    return cross, variance


def start_sources(true: TrueModel, cross: Floats) -> Floats:
    """Return every source's covariance of e at the start, (n_source, n, n): its own spread, and what it puts in
    parameters.
    """
    sources = true.initial.copy()
    for j in range(true.sensor.size):
        if true.matched[j] >= 0:
            for axis in range(3):
                at = true.matched[j] + axis
                sources[true.source[j], at, at] += cross[j, axis, at]
    for m in range(true.shared_source.size):
        at = true.shared_matched[m]
        if at >= 0:
            sources[true.shared_source[m], at, at] += true.shared_start[m]
    return sources


def initial_shared(prepared: Prepared, true: TrueModel) -> Floats:
    """Return Cov(e, c) (n_component, n) at the start of the errors that measurements share; see `initial_cross`."""
    cross = np.zeros((true.shared_source.size, n_joint(prepared)))
    for m in range(true.shared_source.size):
        if true.shared_matched[m] >= 0:
            cross[m, true.shared_matched[m]] = true.shared_start[m]
    return cross
