"""Error sources of a case, and the Jacobians of its measurements with respect to the joint vector."""

from typing import Any

import numpy as np

from lvnav_trade.covariance.difference_errors import difference_channels, noise_of
from lvnav_trade.filter.states import CARRIER_PHASE, POSITION, PSEUDORANGE, RANGE_RATE, VELOCITY
from lvnav_trade.imu.array import keyed, mounted
from lvnav_trade.kernels.transition import VEL
from lvnav_trade.quantities.error_sources import PHASE_NOISE, label_of
from lvnav_trade.quantities.records import Ints
from lvnav_trade.sensors.receiver_observables import PHASES
from lvnav_trade.simulation.epoch.joint import N_CLONE, N_NAV
from lvnav_trade.simulation.preparation.prepare import Prepared


def source_names(prepared: Prepared) -> list[str]:
    """Return the names of all error sources of a case, in the order of the budget."""
    scenario, model = prepared.scenario, prepared.model
    names, owners = ["initial attitude", "initial velocity", "initial position"], dict(mounted(scenario.imu)).items()
    names += [keyed(f"{label} random walk", number) for number, _ in owners for label in ("gyro", "accelerometer")]
    names += list(dict.fromkeys(term.name for term in prepared.sources))
    names += [
        keyed(f"{label} quantisation", number)
        for number, unit in owners
        for label, card in (("gyro", unit.gyro), ("accelerometer", unit.accel))
        if card.quantisation > 0.0
    ]
    names += list(dict.fromkeys(family.source for family in prepared.families if model.aided))
    if model.tight:
        names += ["receiver clock start", "receiver clock", "pseudorange noise", "range-rate noise"]
        names += ["carrier-phase noise"] if any(name in PHASES for name in prepared.channels.further) else []
    elif prepared.options.solver is not None:
        names += ["receiver clock", "pseudorange noise", "range-rate noise"]
        names += [] if prepared.options.solver.smoothing is None else [PHASE_NOISE]
    elif model.n_receiver:
        names += ["position solution noise", "velocity solution noise"]
    return names + [device.noise for device in prepared.devices]


def source_labels(prepared: Prepared) -> tuple[str, ...]:
    """Return the error sources of a case as named in the report; in an IMU array the first IMU has a number too."""
    first = "unit 1 " if prepared.options.units is not None else ""
    return tuple(
        (first if name.startswith(("gyro ", "accelerometer ")) else "") + label_of(name)
        for name in source_names(prepared)
    )


def n_joint(prepared: Prepared) -> int:
    """Return the number of joint states: estimation error, receiver-error states, clones."""
    late = prepared.options.late
    return prepared.layout.n_state + n_receiver_error(prepared) + (0 if late is None else N_CLONE * late.buffered.size)


def n_receiver_error(prepared: Prepared) -> int:
    """Return the number of receiver-error states: of its solution, or of ranges at this and the previous epoch."""
    return 2 * len(difference_channels(prepared)) if prepared.chain is None else prepared.chain.move.shape[1]


# By the codes of `solution`.
_WHITE = (
    "pseudorange noise",
    "range-rate noise",
    "receiver clock",
    "position solution noise",
    "velocity solution noise",
    PHASE_NOISE,
)


def measurement_tables(prepared: Prepared, names: list[str]) -> dict[str, Any]:
    """Return Jacobian structure and offsets of the joint vector, by name of the field of `Components`."""
    model, chain, late, n = prepared.model, prepared.chain, prepared.options.late, prepared.layout.n_state
    n_error, differences = n_receiver_error(prepared), difference_channels(prepared)
    solution = n if n_error else -1
    clone = -1 if late is None else n + n_error
    n_place, n_receiver = 1 if late is None else late.buffered.size, prepared.channels.n_receiver
    table = [
        [
            _pairs(prepared, channel, solution, clone + N_CLONE * place, channel < n_receiver)
            for channel in range(len(model.n_entry))
        ]
        for place in range(n_place)
    ]
    shape = (n_place, len(model.n_entry), max((len(pairs) for rows in table for pairs in rows), default=0))
    entry, column = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.int64)
    for place, rows in enumerate(table):
        for channel, pairs in enumerate(rows):
            for i, (e, c) in enumerate(pairs):
                entry[place, channel, i], column[place, channel, i] = e, c
    white = (
        [_WHITE[kind] for kind in chain.kind]
        if chain is not None
        else [noise_of(prepared.channels.observables[channel % model.n_kind]) for channel in differences]
    )
    return {
        "n_entry": np.array([len(pairs) for pairs in table[0]], dtype=np.int64),
        "entry": entry,
        "column": column,
        "solution": solution,
        "solution_source": np.array([names.index(name) for name in white], dtype=np.int64),
        "clone": clone,
    }


def _pairs(prepared: Prepared, channel: int, solution: int, clone: int, of_receiver: bool) -> list[tuple[int, int]]:
    """Return the pairs (Jacobian entry, joint state) of a channel; a buffered measurement depends on its clone."""
    model, chain, late = prepared.model, prepared.chain, prepared.options.late
    n, line = model.n_entry[channel], -1 if late is None else late.line[channel]
    extrapolated = late is not None and late.extrapolated and of_receiver
    buffered = line >= 0 and not extrapolated
    filter_pairs = zip(model.entry[channel, :n].tolist(), model.column[channel, :n].tolist(), strict=True)
    pairs = [(e, clone + c if buffered and c < N_NAV else c) for e, c in filter_pairs]
    first = model.entry.shape[1]  # entries of receiver-error states follow those of the filter
    if channel in (differences := difference_channels(prepared)):
        at = solution + differences.index(channel)
        pairs += [(first, at), (first + 1, at + len(differences))]
    if chain is not None and of_receiver:
        pairs += [(first + i, solution + int(chain.pick[i])) for i in range(6)]
        if extrapolated:
            pairs += [(first + 6 + i, clone + VEL + i) for i in range(3)]
            pairs += [(first + 9 + i, clone + N_NAV + i) for i in range(3)]
    return pairs


_ROWS = {
    PSEUDORANGE: "pseudorange noise",
    RANGE_RATE: "range-rate noise",
    POSITION: "position solution noise",
    VELOCITY: "velocity solution noise",
    CARRIER_PHASE: "carrier-phase noise",
}


def noise_sources(prepared: Prepared, names: list[str]) -> Ints:
    """Return the source of the white measurement noise of each channel, (n_channel,).

    It is -1 for a difference of two epochs, whose noise is in the receiver-error states.
    """
    sources = [
        names.index(_ROWS[kind]) if kind in _ROWS and _ROWS[kind] in names else -1
        for kind in prepared.model.row_type.tolist()
    ]
    for first, device in zip(prepared.channels.first, prepared.devices, strict=True):
        for scalar in range(len(device.channels.labels)):
            sources[first + scalar] = names.index(device.noise)
    return np.array(sources, dtype=np.int64)
