"""C code of a filter: `translate_filter` returns the header, the source and the inputs."""

from __future__ import annotations

import re
import textwrap
from typing import Any, NamedTuple

from lvnav_trade.export import entries
from lvnav_trade.export.scope import refuse_redundant_imus
from lvnav_trade.export.storage import Storage
from lvnav_trade.export.translation.expressions import RingTooShort
from lvnav_trade.export.translation.program import Program
from lvnav_trade.export.translation.values import DOUBLE, INT, Array, RecordValue, Scalar, Value, size_of
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.state_layout import state_names
from lvnav_trade.simulation.preparation.prepare import PreparedCase

NAME = "nav_filter"
# Comments on the fields of the struct that are measured and estimated; the others are work arrays.
MEASURED = {
    "increments": "angle (rad) and velocity (m/s) increments of every tick, body axes; propagate changes them",
    "solution": "position (m) and velocity (m/s) of the receiver's solution, inertial frame",
    "ranges": "measurements of every slot at the epoch: pseudorange (m), range rate (m/s), further observables",
    "receiver_covariance": "covariance that the receiver reports with its solution, SI",
    "sensor_measurements": "measurements of the other sensors, in the order of the scenario, SI",
}
ESTIMATED = {
    "nav": "quaternion body to inertial, velocity (m/s), position (m), inertial frame",
    "P": "covariance of the states, SI",
    "x": "error state, truth minus estimate; zero between epochs in a closed loop",
    "par": "estimated IMU parameters, body axes, SI",
    "clock_hat": "estimated bias (m) and drift (m/s) of the receiver clock",
    "extra": "estimates of the extra states, SI",
    "innovation": "innovations of the last epoch by channel, normalised by their sigma; NAN: no measurement",
    "nis": "sum of squared normalised innovations of the accepted measurements",
    "n_row": "number of accepted measurements",
    "n_reject": "number of measurements that the gate rejected",
    "mode_state_state": "mode, good samples in a row, s since the start, s since the last error-free epoch, reason",
    "backup_nav": "backup strapdown, which is never corrected, as nav",
    "backup_P": "covariance of the error of the backup strapdown, as P",
}
INPUTS = {
    "first_tick": "number of the first IMU tick of the window, from 0",
    "n_tick": "number of IMU ticks in the window",
    "length_index": "index of the window's length among the lengths of the filter's windows",
    "injection": "index of the change of operating region at the end of the window, -1 none",
    "linearisation": "where the transition is linearised: 0 this window, 1 as before, 2 at its start, 3 at the first",
    "delay_processing_state_epochs": "first epoch with a measurement valid at the window's end; epoch after the last",
    "delay_processing_velocity_epochs": "the same for the earlier velocity from which the acceleration follows",
    "vehicle_walk": "variance of the step of each vehicle state into a tick, at the tick's number modulo the places",
    "n_used": "number of satellites in use",
    "satellite_by_slot": "satellite in every slot",
    "antenna": "antenna that receives a satellite",
    "satellite_position": "position of a satellite at transmission (m), inertial frame",
    "satellite_velocity": "derivative of that position by the time of reception (m/s)",
    "variance": "noise variance of a channel in the filter model, SI",
    "scale": "square root of the tuning factor on the variance of a channel",
    "beta": "under-weighting factor of a channel",
    "partial": "derivative of a channel's measurement by the extra states in it",
    "reference": "slot of the reference satellite of differences, -1 none",
    "sensors_is_measuring": "whether a sensor measures",
    "sensors_filter_parameters": "parameters of a sensor that the filter knows at the epoch",
    "sensors_theta": "Earth rotation angle (rad)",
    "delay_processing_delay": "delay of the receiver's measurement (s)",
    "delay_processing_base": "time from the earlier velocity to the time of validity (s)",
    "rules_is_good": "whether the receiver's sample passes the input checks",
    "differences_is_present": "whether a channel has a measurement",
    "differences_reset_variance": "variance to which an extra state is reset, -1: no reset",
}
_OPENED = f"void {NAME}_begin(struct {NAME} *self, const double *nav)\n{{\n"
_HELPERS = {
    "smaller": "static int smaller(int a, int b)\n{\n    return a < b ? a : b;\n}",
    "larger": "static int larger(int a, int b)\n{\n    return a > b ? a : b;\n}",
    "remainder_of": "static int remainder_of(int a, int b)\n{\n    return ((a % b) + b) % b;\n}",
    "floor_divided": "static int floor_divided(int a, int b)\n{\n    return (a - remainder_of(a, b)) / b;\n}",
}


class FilterProgram(NamedTuple):
    """C code of a filter."""

    header: str
    source: str
    inputs: dict[str, dict[str, tuple[Array, Any, int]]]  # by struct and field: array, values of the flight, time axis
    state: dict[str, Array]  # arrays of the struct that are used
    depth: int  # number of epochs that the struct stores
    open_loop: bool  # whether the outputs are the sum of the inertial solution and the error state
    counts_epochs: bool  # whether update has the number of the epoch as argument


def translate_filter(prepared_case: PreparedCase, title: str) -> FilterProgram:
    """Return the C code of the filter of a case.

    Parameters
    ----------
    prepared_case : PreparedCase
        The prepared scenario.
    title : str
        Title in the header.

    Returns
    -------
    FilterProgram
        Header, source and inputs.

    Raises
    ------
    InputError
        Redundant IMUs are tested ahead of the filter, or the filter refers to more than one earlier epoch.
    """
    refuse_redundant_imus(prepared_case)
    for depth in (1, 2):
        program = Program(NAME)
        storage = Storage(prepared_case, program, depth)
        try:
            names = _translate_entries(program, storage)
        except RingTooShort:
            continue
        return _filter_program(program, storage, names, title, prepared_case)
    raise InputError("the filter uses states more than one epoch old")


def _translate_entries(program: Program, storage: Storage) -> list[str]:
    """Translate the functions of the C interface; return their names."""
    nav = Array("nav", (10,), DOUBLE, constant=True)
    window = Scalar("window", INT)
    epoch = Scalar("epoch", INT)
    common: dict[str, Value] = {"work": storage.work, "optional_state": storage.optional_state}
    arguments: dict[str, dict[str, Value]] = {
        "begin": {**common, "options": storage.options, "start": storage.start, "nav": nav},
        "propagate": {**common, "case": storage.case, "window": window},
        "update": {**common, "case": storage.case, "epoch": epoch},
    }
    if isinstance(storage.optional_state.fields["open_loop"], RecordValue):
        arguments["correct_outputs"] = {**common, "model": storage.model}
        arguments["restore_outputs"] = {**common, "model": storage.model}
    names = []
    for entry, entry_arguments in arguments.items():
        kernel = program.translated_kernel(getattr(entries, entry), entry_arguments, f"{NAME}_{entry}")
        names.append(kernel.name)
    return names


def _filter_program(
    program: Program, storage: Storage, names: list[str], title: str, prepared_case: PreparedCase
) -> FilterProgram:
    """Return the header and source of a filter whose entry functions are translated.

    Parameters
    ----------
    program : Program
        Translated kernels and tables.
    storage : Storage
        Arrays of the struct, and inputs.
    names : list of str
        C names of the entry functions, `update` third.
    title : str
        Title in the comments of both files.
    prepared_case : PreparedCase
        Prepared scenario, for the names of the states.
    """
    code = program.text(names)
    used_fields = set(re.findall(r"self->(?:window\.|epoch\.)?(\w+)", code)) | {"nav", "P", "x"}
    state = {name: array for name, array in storage.state.items() if name in used_fields}
    inputs = {}
    for struct, fields in storage.inputs.items():
        inputs[struct] = {name: field for name, field in fields.items() if f"self->{struct}.{name}" in code}
    code = code.replace(_OPENED, f"{_OPENED}    memset(self, 0, sizeof *self);\n", 1)
    prototypes = [_prototype(code, name) for name in names]
    include = f'/* {title} */\n\n#include <math.h>\n#include <string.h>\n\n#include "{NAME}.h"'
    return FilterProgram(
        header=_header(title, prepared_case, state, inputs, prototypes, storage.depth),
        source="\n\n".join([include, *_helper_functions(code), code]),
        inputs=inputs,
        state=state,
        depth=storage.depth,
        open_loop=len(names) > 3,
        counts_epochs="int epoch)" in prototypes[2],
    )


def _helper_functions(code: str) -> list[str]:
    """Return the C functions of integers that the code calls, directly or through another of them."""
    names = {name for name in _HELPERS if re.search(rf"\b{name}\(", code)}
    if "floor_divided" in names:
        names.add("remainder_of")
    return [text for name, text in _HELPERS.items() if name in names]


def _prototype(code: str, name: str) -> str:
    """Return the declaration of a function in the code, with the comment ahead of it."""
    match = re.search(rf"((?:/\*(?:[^*]|\*(?!/))*\*/\n)?)(void {name}\([^)]*(?:\)\[\d+\][^)]*)*\))\n", code)
    assert match is not None
    return f"{match.group(1)}{match.group(2)};"


def _declaration(array: Array, name: str) -> str:
    sizes = "".join(f"[{size_of(size)}]" for size in array.sizes)
    return f"{array.c_type} {name}{sizes};"


def _field_line(array: Array, name: str, comment: str) -> str:
    """Return the declaration of a field of a struct with its comment."""
    declaration = f"    {_declaration(array, name)}"
    return f"{declaration} /* {comment} */" if comment else declaration


def _struct(label: str, fields: dict[str, tuple[Array, Any, int]], comment: str) -> list[str]:
    """Return the lines of a struct of inputs; empty without fields.

    Parameters
    ----------
    label : str
        Suffix of the struct's name, "window" or "epoch".
    fields : dict
        Array, values and time axis by name, as in `FilterProgram.inputs`.
    comment : str
        Comment above the struct.
    """
    if not fields:
        return []
    lines = [f"/* {comment} */", f"struct {NAME}_{label} {{"]
    for name, (array, _, _) in fields.items():
        lines.append(_field_line(array, name, INPUTS.get(name, "")))
    return [*lines, "};", ""]


def _header(title: str, prepared_case: PreparedCase, state: Any, inputs: Any, prototypes: list[str], depth: int) -> str:
    """Return the text of the header: states, structs, prototypes.

    Parameters
    ----------
    title : str
        First line of the comment at the top.
    prepared_case : PreparedCase
        Prepared scenario, for the names of the states.
    state : dict
        Arrays of the struct of the filter by name.
    inputs : dict
        Inputs by struct and field, as in `FilterProgram.inputs`.
    prototypes : list of str
        Declarations of the entry functions.
    depth : int
        Number of epochs that the struct stores.
    """
    ring_note = "" if depth == 1 else f" Those of an epoch stand at its number modulo {depth}."
    lines = [
        f"/* {title}",
        "",
        "   States of P and x (SI; attitude, velocity and position in the inertial frame):",
        *(f"   {number:2d} {name}" for number, name in enumerate(state_names(prepared_case.layout))),
        "   */",
        f"#ifndef {NAME.upper()}_H",
        f"#define {NAME.upper()}_H",
        "",
        *_struct("window", inputs["window"], "What a window differs by from others: set before propagate."),
        *_struct("epoch", inputs["epoch"], f"What an epoch differs by from others: set before update.{ring_note}"),
        *_filter_struct(state, inputs),
        "",
        *prototypes,
        "",
        "#endif",
    ]
    wrapped_lines: list[str] = []
    for line in lines:
        wrapped_lines += _wrap_line(line)
    return "\n".join(wrapped_lines) + "\n"


def _filter_struct(state: Any, inputs: Any) -> list[str]:
    """Return the lines of the struct of the filter: inputs, measurements, estimates, work arrays."""
    lines = [f"struct {NAME} {{"]
    lines += [f"    struct {NAME}_{label} {label};" for label in inputs if inputs[label]]
    work_arrays = {name: "" for name in state if name not in MEASURED and name not in ESTIMATED}
    for heading, comments in (("measured", MEASURED), ("estimated", ESTIMATED), ("work", work_arrays)):
        names = [name for name in comments if name in state]
        if names:
            lines.append(f"    /* {heading} */")
        lines += [_field_line(state[name], name, comments[name]) for name in names]
    return [*lines, "};"]


def _wrap_line(line: str) -> list[str]:
    if len(line) <= 118 or "\n" in line:
        return [line]
    return textwrap.wrap(line, 118, subsequent_indent="        ") or [""]
