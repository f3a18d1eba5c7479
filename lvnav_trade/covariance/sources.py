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
    names = ["initial attitude", "initial velocity", "initial position"]
    names += _imu_sources(prepared)
    if prepared.model.aided:
        names += dict.fromkeys(family.source for family in prepared.families)
    names += _receiver_sources(prepared)
    names += [device.noise for device in prepared.devices]
    return names


def _imu_sources(prepared: Prepared) -> list[str]:
    imus = dict(mounted(prepared.scenario.imu)).items()
    names = []
    for number, _ in imus:
        names += [keyed(f"{label} random walk", number) for label in ("gyro", "accelerometer")]
    names += dict.fromkeys(term.name for term in prepared.sources)
    for number, imu in imus:
        for label, card in (("gyro", imu.gyro), ("accelerometer", imu.accel)):
            if card.quantisation > 0.0:
                names.append(keyed(f"{label} quantisation", number))
    return names


def _receiver_sources(prepared: Prepared) -> list[str]:
    solver = prepared.options.solver
    if prepared.model.tight:
        names = ["receiver clock start", "receiver clock", "pseudorange noise", "range-rate noise"]
        if any(name in PHASES for name in prepared.channels.further):
            names.append("carrier-phase noise")
        return names
    if solver is not None:
        names = ["receiver clock", "pseudorange noise", "range-rate noise"]
        if solver.smoothing is not None:
            names.append(PHASE_NOISE)
        return names
    if prepared.model.n_receiver:
        return ["position solution noise", "velocity solution noise"]
    return []


def source_labels(prepared: Prepared) -> tuple[str, ...]:
    """Return the error sources of a case as named in the report; in an IMU array the first IMU has a number too."""
    labels = []
    for name in source_names(prepared):
        label = label_of(name)
        if prepared.options.units is not None and name.startswith(("gyro ", "accelerometer ")):
            label = "unit 1 " + label
        labels.append(label)
    return tuple(labels)


def n_joint(prepared: Prepared) -> int:
    """Return the number of joint states: estimation error, receiver-error states, clones."""
    late = prepared.options.late
    n_clone = 0 if late is None else N_CLONE * late.buffered.size
    return prepared.layout.n_state + n_receiver_error(prepared) + n_clone


def n_receiver_error(prepared: Prepared) -> int:
    """Return the number of receiver-error states: of its solution, or of ranges at this and the previous epoch."""
    if prepared.chain is None:
        return 2 * len(difference_channels(prepared))
    return prepared.chain.move.shape[1]


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
    late = prepared.options.late
    n = prepared.layout.n_state
    n_error = n_receiver_error(prepared)
    n_channel = len(prepared.model.n_entry)
    n_place = 1 if late is None else late.buffered.size
    solution = n if n_error else -1
    clone = -1 if late is None else n + n_error
    table = []
    for place in range(n_place):
        clone_of_place = clone + N_CLONE * place
        table.append([_entry_states(prepared, channel, solution, clone_of_place) for channel in range(n_channel)])
    n_most = max((len(pairs) for rows in table for pairs in rows), default=0)
    entry = np.zeros((n_place, n_channel, n_most), dtype=np.int64)
    column = np.zeros_like(entry)
    for place, rows in enumerate(table):
        for channel, pairs in enumerate(rows):
            for i, (jacobian_entry, state) in enumerate(pairs):
                entry[place, channel, i] = jacobian_entry
                column[place, channel, i] = state
    noises = _error_noises(prepared)
    n_entry = [len(pairs) for pairs in table[0]]
    solution_source = [names.index(name) for name in noises]
    return {
        "n_entry": np.array(n_entry, dtype=np.int64),
        "entry": entry,
        "column": column,
        "solution": solution,
        "solution_source": np.array(solution_source, dtype=np.int64),
        "clone": clone,
    }


def _error_noises(prepared: Prepared) -> list[str]:
    """Return the sources of the white noise that drives the receiver-error states."""
    if prepared.chain is not None:
        return [_WHITE[code] for code in prepared.chain.kind]
    observables, n_kind = prepared.channels.observables, prepared.model.n_kind
    return [noise_of(observables[channel % n_kind]) for channel in difference_channels(prepared)]


def _entry_states(prepared: Prepared, channel: int, solution: int, clone: int) -> list[tuple[int, int]]:
    """Return the pairs (Jacobian entry, joint state) of a channel; a buffered measurement depends on its clone."""
    model = prepared.model
    chain = prepared.chain
    late = prepared.options.late
    is_receiver = channel < prepared.channels.n_receiver
    is_extrapolated = late is not None and late.extrapolated and is_receiver
    is_buffered = late is not None and late.line[channel] >= 0 and not is_extrapolated
    pairs = []
    for k in range(model.n_entry[channel]):
        entry = int(model.entry[channel, k])
        state = int(model.column[channel, k])
        if is_buffered and state < N_NAV:
            state += clone
        pairs.append((entry, state))
    first = model.entry.shape[1]  # entries of receiver-error states follow those of the filter
    differences = difference_channels(prepared)
    if channel in differences:
        state = solution + differences.index(channel)
        previous_state = state + len(differences)
        pairs += [(first, state), (first + 1, previous_state)]
    if chain is not None and is_receiver:
        pairs += [(first + i, solution + int(chain.pick[i])) for i in range(6)]
        if is_extrapolated:
            velocity = first + 6
            earlier_velocity = first + 9
            pairs += [(velocity + i, clone + VEL + i) for i in range(3)]
            pairs += [(earlier_velocity + i, clone + N_NAV + i) for i in range(3)]
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
    sources = []
    for row_type in prepared.model.row_type.tolist():
        name = _ROWS.get(row_type, "")
        sources.append(names.index(name) if name in names else -1)
    for first, device in zip(prepared.channels.first, prepared.devices, strict=True):
        for scalar in range(len(device.channels.labels)):
            sources[first + scalar] = names.index(device.noise)
    return np.array(sources, dtype=np.int64)
