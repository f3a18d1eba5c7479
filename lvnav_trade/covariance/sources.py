"""Error sources of a case, and the Jacobians of its measurements with respect to the joint vector."""

from typing import Any

import numpy as np

from lvnav_trade.covariance.difference_errors import difference_channels, observable_noise_source
from lvnav_trade.filter.states import CARRIER_PHASE, POSITION, PSEUDORANGE, RANGE_RATE, VELOCITY
from lvnav_trade.imu.array import source_key, triad_imus
from lvnav_trade.kernels.transition import VEL
from lvnav_trade.quantities.error_sources import PHASE_NOISE, label_of
from lvnav_trade.quantities.records import Ints
from lvnav_trade.sensors.receiver_observables import PHASES
from lvnav_trade.simulation.epoch.joint import N_CLONE, N_NAV
from lvnav_trade.simulation.preparation.prepare import PreparedCase


def source_names(prepared_case: PreparedCase) -> list[str]:
    """Return the names of all error sources of a case, in the order of the budget."""
    names = ["initial attitude", "initial velocity", "initial position"]
    names += _imu_sources(prepared_case)
    if prepared_case.model.has_epochs:
        names += dict.fromkeys(family.source for family in prepared_case.families)
    names += _receiver_sources(prepared_case)
    names += [device.noise for device in prepared_case.devices]
    return names


def _imu_sources(prepared_case: PreparedCase) -> list[str]:
    imus = dict(triad_imus(prepared_case.scenario.imu)).items()
    names = []
    for number, _ in imus:
        names += [source_key(f"{label} random walk", number) for label in ("gyro", "accelerometer")]
    names += dict.fromkeys(term.name for term in prepared_case.sources)
    for number, imu in imus:
        for label, card in (("gyro", imu.gyro), ("accelerometer", imu.accel)):
            if card.quantisation > 0.0:
                names.append(source_key(f"{label} quantisation", number))
    return names


def _receiver_sources(prepared_case: PreparedCase) -> list[str]:
    solver = prepared_case.options.solver
    if prepared_case.model.tight:
        names = ["receiver clock start", "receiver clock", "pseudorange noise", "range-rate noise"]
        if any(name in PHASES for name in prepared_case.channels.further):
            names.append("carrier-phase noise")
        return names
    if solver is not None:
        names = ["receiver clock", "pseudorange noise", "range-rate noise"]
        if solver.smoothing is not None:
            names.append(PHASE_NOISE)
        return names
    if prepared_case.model.n_receiver:
        return ["position solution noise", "velocity solution noise"]
    return []


def source_labels(prepared_case: PreparedCase) -> tuple[str, ...]:
    """Return the error sources of a case as named in the report; in an IMU array the first IMU has a number too."""
    labels = []
    for name in source_names(prepared_case):
        label = label_of(name)
        if prepared_case.options.imu_array is not None and name.startswith(("gyro ", "accelerometer ")):
            label = "unit 1 " + label
        labels.append(label)
    return tuple(labels)


def n_joint(prepared_case: PreparedCase) -> int:
    """Return the number of joint states: estimation error, receiver-error states, clones."""
    delays = prepared_case.options.delay_processing
    n_clone = 0 if delays is None else N_CLONE * delays.is_buffered.size
    return prepared_case.layout.n_state + n_receiver_error(prepared_case) + n_clone


def n_receiver_error(prepared_case: PreparedCase) -> int:
    """Return the number of receiver-error states: of its solution, or of ranges at this and the previous epoch."""
    if prepared_case.chain is None:
        return 2 * len(difference_channels(prepared_case))
    return prepared_case.chain.transition.shape[1]


# By the codes of `solution`.
_NOISE_NAMES = (
    "pseudorange noise",
    "range-rate noise",
    "receiver clock",
    "position solution noise",
    "velocity solution noise",
    PHASE_NOISE,
)


def measurement_tables(prepared_case: PreparedCase, names: list[str]) -> dict[str, Any]:
    """Return Jacobian structure and offsets of the joint vector, by name of the field of `Components`."""
    delays = prepared_case.options.delay_processing
    n = prepared_case.layout.n_state
    n_error = n_receiver_error(prepared_case)
    n_channel = len(prepared_case.model.n_entry)
    n_place = 1 if delays is None else delays.is_buffered.size
    solution = n if n_error else -1
    clone = -1 if delays is None else n + n_error
    table = []
    for place in range(n_place):
        place_clone = clone + N_CLONE * place
        table.append([_entry_states(prepared_case, channel, solution, place_clone) for channel in range(n_channel)])
    max_entries = max((len(pairs) for rows in table for pairs in rows), default=0)
    entry = np.zeros((n_place, n_channel, max_entries), dtype=np.int64)
    column = np.zeros_like(entry)
    for place, rows in enumerate(table):
        for channel, pairs in enumerate(rows):
            for i, (jacobian_entry, state) in enumerate(pairs):
                entry[place, channel, i] = jacobian_entry
                column[place, channel, i] = state
    noises = _error_noises(prepared_case)
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


def _error_noises(prepared_case: PreparedCase) -> list[str]:
    """Return the sources of the white noise that drives the receiver-error states."""
    if prepared_case.chain is not None:
        return [_NOISE_NAMES[code] for code in prepared_case.chain.noise_type]
    observables, n_observable = prepared_case.channels.observables, prepared_case.model.n_observable
    return [
        observable_noise_source(observables[channel % n_observable]) for channel in difference_channels(prepared_case)
    ]


def _entry_states(prepared_case: PreparedCase, channel: int, solution: int, clone: int) -> list[tuple[int, int]]:
    """Return the pairs (Jacobian entry, joint state) of a channel; a buffered measurement depends on its clone."""
    model = prepared_case.model
    chain = prepared_case.chain
    delays = prepared_case.options.delay_processing
    is_receiver = channel < prepared_case.channels.n_receiver
    is_extrapolated = delays is not None and delays.is_extrapolated and is_receiver
    is_buffered = delays is not None and delays.line[channel] >= 0 and not is_extrapolated
    pairs = []
    for k in range(model.n_entry[channel]):
        entry = int(model.entry[channel, k])
        state = int(model.column[channel, k])
        if is_buffered and state < N_NAV:
            state += clone
        pairs.append((entry, state))
    first = model.entry.shape[1]  # entries of receiver-error states follow those of the filter
    differences = difference_channels(prepared_case)
    if channel in differences:
        state = solution + differences.index(channel)
        previous_state = state + len(differences)
        pairs += [(first, state), (first + 1, previous_state)]
    if chain is not None and is_receiver:
        pairs += [(first + i, solution + int(chain.solution_states[i])) for i in range(6)]
        if is_extrapolated:
            velocity = first + 6
            earlier_velocity = first + 9
            pairs += [(velocity + i, clone + VEL + i) for i in range(3)]
            pairs += [(earlier_velocity + i, clone + N_NAV + i) for i in range(3)]
    return pairs


_ROW_NOISE_NAMES = {
    PSEUDORANGE: "pseudorange noise",
    RANGE_RATE: "range-rate noise",
    POSITION: "position solution noise",
    VELOCITY: "velocity solution noise",
    CARRIER_PHASE: "carrier-phase noise",
}


def noise_sources(prepared_case: PreparedCase, names: list[str]) -> Ints:
    """Return the source of the white measurement noise of each channel, (n_channel,).

    It is -1 for a difference of two epochs, whose noise is in the receiver-error states.
    """
    sources = []
    for channel_type in prepared_case.model.channel_type.tolist():
        name = _ROW_NOISE_NAMES.get(channel_type, "")
        sources.append(names.index(name) if name in names else -1)
    for first, device in zip(prepared_case.channels.first_channels, prepared_case.devices, strict=True):
        for scalar in range(len(device.channels.labels)):
            sources[first + scalar] = names.index(device.noise)
    return np.array(sources, dtype=np.int64)
