"""Storage of a filter in C: arrays of a run in a struct, constants in tables.

Quantities that vary between windows or epochs without being states are inputs, which the caller sets. Quantities that
are constant over the flight are tables.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lvnav_trade.export.translation.program import Program
from lvnav_trade.export.translation.values import DOUBLE, INT, ONLY, SAME, Array, Constant, RecordValue, Value, table_of
from lvnav_trade.simulation.epoch.filter_case import case_of
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.simulation.run_arrays import new_work

# Time axes (epochs or windows) of the arrays read from signals, sensors and options.
EPOCHS = {
    "signals": {
        "satellite_by_slot": 0,
        "n_used": 0,
        "antenna": 0,
        "satellite_position": 0,
        "satellite_velocity": 0,
        "variance": 0,
        "scale": 0,
        "beta": 0,
        "partial": 1,
        "reference": 0,
    },
    "sensors": {"is_measuring": 1, "filter_parameters": 1, "theta": 1},
    "delay_processing": {"delay": 0, "base": 0},
    "rules": {"is_good": 0},
    "differences": {"is_present": 0, "reset_variance": 0},
}
WINDOWS = {
    "schedule": {"first_tick": 0, "n_tick": 0, "length_index": 0, "injection": 0, "linearisation": 0},
    "delay_processing": {"state_epochs": 1, "velocity_epochs": 1},
}
# Tables of the whole flight: constants if all rows are equal, otherwise read by row number.
ROWS = {
    "model": {"seconds": 0, "decay": 0, "noise": 0, "inflation": 0, "h_infinity_weight": 0},
    "delay_processing": {"offset": 1},
    "gains": {"gain": 0},
}
# Indexed by ticks of the IMU: the caller sets the values of a window before it is propagated.
TICKS = {"vehicle": {"walk"}}
BY_TICK = -1  # in place of a time axis
# Outputs of a receiver, sensor or clock at an epoch: inputs in any case, even if they are constant on this flight.
DEVICE_OUTPUTS = {
    "satellite_by_slot",
    "n_used",
    "satellite_position",
    "satellite_velocity",
    "is_measuring",
    "filter_parameters",
    "theta",
    "is_good",
    "is_present",
    "reset_variance",
}
# Arrays of a run, by record, whose first axis counts epochs.
EPOCH_ARRAYS = {
    "work": ("innovation", "nis", "n_row", "n_reject"),
    "mode_state": ("mode", "reason"),
    "monitor": ("fault_type", "is_excluded"),
}
# True quantities of a flight, which are not part of its filter.
_UNREAD = ("rate", "force")
# Options of which the filter reads nothing.
_UNREAD_OPTIONS = {
    "reported_samples",
    "reported_solution",
    "solver",
    "further_observables",
    "backup",
    "has_transition_errors",
}


def _c_type(array: np.ndarray) -> str:
    return DOUBLE if array.dtype.kind == "f" else INT


class Storage:
    """Arguments of the functions of a filter, as values of a program.

    Parameters
    ----------
    prepared_case : PreparedCase
        The prepared scenario.
    program : Program
        Receives the constant tables.
    depth : int
        Number of epochs that the struct stores.

    Attributes
    ----------
    state : dict
        Arrays of a run by name, which are fields of the struct.
    inputs : dict
        Arrays that the caller sets, by struct ("window", "epoch") and name: array, values, time axis. The axis is
        `BY_TICK` for values by tick.
    n_tick : int
        Largest number of IMU ticks in a window.
    """

    def __init__(self, prepared_case: PreparedCase, program: Program, depth: int = 1) -> None:
        self.program, self.depth = program, depth
        self.state: dict[str, Array] = {}
        self.inputs: dict[str, dict[str, tuple[Array, Any, int]]] = {"window": {}, "epoch": {}}
        self.n_tick = int(prepared_case.schedule.n_tick.max(initial=0))
        work, optional_state = new_work(prepared_case, uses_lanes=False)
        self.work = self._arrays("work", work, "")
        states = {name: self._optional_state(name, record) for name, record in optional_state._asdict().items()}
        self.optional_state = RecordValue("optional_state", states)
        self.model = self._record("model", prepared_case.model)
        self.schedule = self._record("schedule", prepared_case.schedule)
        self.signals = self._record("signals", prepared_case.signals, only=EPOCHS["signals"])
        self.sensors: Value = Constant(None)
        if prepared_case.sensors is not None:
            read_fields = {*EPOCHS["sensors"], "code", "channel", "scalars"}
            self.sensors = self._record("sensors", prepared_case.sensors, only=read_fields)
        options = {name: self._option(name, record) for name, record in prepared_case.options._asdict().items()}
        self.options = RecordValue("options", options)
        case = case_of(prepared_case)
        self.case = RecordValue(
            "case",
            {
                "schedule": self.schedule,
                "signals": self.signals,
                "sensors": self.sensors,
                "model": self.model,
                "options": self.options,
                "tick": Constant(case.tick),
                "step": Constant(case.step),
            },
        )
        self.start = RecordValue("start", {"P": self._table("start_P", np.asarray(prepared_case.initial_state.P))})

    # ---------------------------------------------------------------------------------- arrays of a run

    def _optional_state(self, name: str, state: Any) -> Value:
        """Return an optional state of the filter as a value; None for records of a simulation."""
        if state is None or name in ("tape", "solution_error", "transition_errors", "previous_observables"):
            return Constant(None)
        if name == "units":
            return RecordValue("units", {"redundant": Constant(None)})
        if isinstance(state, np.ndarray):
            return self._state_array(name, state)
        return self._arrays(name, state, f"{name}_")

    def _arrays(self, owner: str, record: Any, prefix: str) -> RecordValue:
        """Return the arrays of a record as fields of the struct.

        owner : name of the record
        prefix : prefix of the names of the fields
        """
        arrays: dict[str, Value] = {}
        for name, array in record._asdict().items():
            if isinstance(array, np.ndarray):
                counts = name in EPOCH_ARRAYS.get(owner, ())
                arrays[name] = self._state_array(f"{prefix}{name}", array, counts)
        return RecordValue(owner, arrays)

    def _state_array(self, name: str, array: np.ndarray, counts: bool = False) -> Array:
        """Return an array of a run as a field of the struct.

        counts : whether its first axis counts epochs, of which the struct stores `depth`
        """
        shape = array.shape
        rings = (0,) * array.ndim
        if counts:
            shape = (self.depth, *shape[1:])
            rings = (self.depth, *rings[1:])
        self.state[name] = Array(f"self->{name}", shape, _c_type(array), rings=rings)
        return self.state[name]

    # ------------------------------------------------------------------------------- settings, inputs

    def _option(self, name: str, option: Any) -> Value:
        if option is None or name in _UNREAD_OPTIONS:
            return Constant(None)
        if name == "imu_array":
            return RecordValue("imu_array", {"redundant": Constant(None)})
        return self._record(name, option) if hasattr(option, "_asdict") else Constant(option)

    def _record(self, owner: str, record: Any, only: Any = None) -> RecordValue:
        """Return the fields of a record of settings.

        owner : name of the record, which selects the time axes of its fields
        only : names of the fields that the filter reads; all if None
        """
        fields = {}
        for name, value in record._asdict().items():
            is_truth = owner == "vehicle" and name in _UNREAD
            if not is_truth and (only is None or name in only):
                fields[name] = self._field(owner, name, value)
        return RecordValue(owner, fields)

    def _field(self, owner: str, name: str, value: Any) -> Value:
        """Return a field of a record: a constant, a table, or an input if it varies between windows or epochs.

        owner, name : names of the record and of the field
        """
        if hasattr(value, "_asdict"):
            return self._record(name, value)
        if not isinstance(value, np.ndarray):
            return Constant(value.item() if isinstance(value, np.generic) else value)
        label = name if owner in ("signals", "schedule") else f"{owner}_{name}"
        for struct, axes, depth in (("epoch", EPOCHS, self.depth), ("window", WINDOWS, ONLY)):
            if name in axes.get(owner, {}):
                axis = axes[owner][name]
                table = None if name in DEVICE_OUTPUTS else self._constant(label, value, axis)
                return table or self._input(struct, label, value, axis, depth)
        if name in TICKS.get(owner, ()):
            return self._constant(label, value, 0) or self._tick_input(label, value)
        if name in ROWS.get(owner, {}):
            return self._constant(label, value, ROWS[owner][name]) or self._table(label, value)
        return self._table(label, value)

    def _table(self, label: str, content: np.ndarray) -> Array:
        return self.program.table(label, content)

    def _constant(self, label: str, value: np.ndarray, axis: int) -> Array | None:
        """Return a table without its time axis if all entries along this axis are equal; otherwise None.

        label : name of the table
        axis : time axis of `value`
        """
        if not value.shape[axis]:
            return None
        first = np.take(value, [0], axis=axis)
        constant_value = np.broadcast_to(first, value.shape)
        if not np.array_equal(value, constant_value, equal_nan=value.dtype.kind == "f"):
            return None
        rings = [0] * value.ndim
        shape = list(value.shape)
        rings[axis] = SAME
        shape[axis] = 1
        table = self._table(label, np.take(value, 0, axis=axis))
        return table_of(table.text, table.value, tuple(rings), tuple(shape))

    def _input(self, struct: str, label: str, value: np.ndarray, axis: int, depth: int) -> Array:
        """Return an array that the caller sets, and register it in `inputs`.

        struct : "window" or "epoch"
        label : name of the field
        value : values over the whole run
        axis : time axis of `value`
        depth : number of places along the time axis
        """
        rings = [0] * value.ndim
        shape = list(value.shape)
        rings[axis] = shape[axis] = depth
        array = Array(f"self->{struct}.{label}", tuple(shape), _c_type(value), rings=tuple(rings))
        self.inputs[struct][label] = (array, value, axis)
        return array

    def _tick_input(self, label: str, value: np.ndarray) -> Array:
        """Return an array of the ticks of a window that the caller sets."""
        places = max(2, self.n_tick)  # with a single place, only the present tick could be read
        rings = (places,) + (0,) * (value.ndim - 1)
        array = Array(f"self->window.{label}", (places, *value.shape[1:]), DOUBLE, rings=rings)
        self.inputs["window"][label] = (array, value, BY_TICK)
        return array
