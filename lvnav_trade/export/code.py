"""C code of a filter: `exported` returns the header, the source and the inputs."""

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
from lvnav_trade.simulation.preparation.prepare import Prepared

NAME = "nav_filter"
# Comments on the fields of the struct that are measured and estimated; the others are work arrays.
MEASURED = {
    "increments": "of every tick of the window: angles (rad) and velocities (m/s), body axes; changed by propagate",
    "solution": "of the receiver: position (m) and velocity (m/s), inertial frame",
    "ranges": "of every slot of the epoch: pseudorange (m), range rate (m/s), further observables",
    "rx_covariance": "that the receiver reports with its solution, SI",
    "observed": "by the other sensors, in the order of the scenario, SI",
}
ESTIMATED = {
    "nav": "quaternion body to inertial, velocity (m/s), position (m), inertial frame",
    "P": "covariance of the states, SI",
    "x": "error state, truth minus estimate: between epochs zero in a closed loop",
    "par": "estimated parameters of the inertial unit, body axes, SI",
    "clock_hat": "estimated bias (m) and drift (m/s) of the receiver's clock",
    "extra": "estimates of the extra states, SI",
    "innovation": "of the last epoch by channel, over their own sigma; NAN: none",
    "nis": "sum of squares of those that were accepted",
    "n_row": "how many were accepted",
    "n_reject": "how many the gate rejected",
    "watch_state": "mode, good samples in a row, s since the start, s since the last epoch without error, reason",
    "backup_nav": "of the strapdown that is never corrected, as nav",
    "backup_P": "covariance of its error, as P",
}
INPUTS = {
    "first_tick": "number of the window's first tick of the unit, from 0",
    "n_tick": "how many ticks the window has",
    "length": "which of the filter's lengths of a window it has",
    "injection": "which change of operating region is at its end, -1 none",
    "linearised": "where the transition is linearised: 0 this window, 1 as before, 2 at its start, 3 at the first",
    "late_valid": "first epoch whose measurement is valid at the window's end, and the one after the last",
    "late_early": "the same of the epochs whose velocity a while before is then",
    "vehicle_walk": "variance of the step of each state of the vehicle into a tick, at its number modulo the places",
    "n_used": "how many satellites are used",
    "used": "satellite in every slot",
    "antenna": "that receives a satellite",
    "satellite": "its position when it sent (m), inertial frame",
    "satellite_velocity": "its derivative by the time of reception (m/s)",
    "variance": "of a channel's noise as the filter assumes it, SI",
    "scale": "root of the factor of tuning on the variance of a channel",
    "beta": "under-weighting of a channel",
    "partial": "derivative of a channel by the extra states that enter it",
    "reference": "slot of the satellite that others are differenced with, -1 none",
    "sensors_on": "whether a sensor measures",
    "sensors_known": "what the filter knows of a sensor at the epoch",
    "sensors_theta": "angle of the Earth (rad)",
    "late_delay": "by which the receiver is late (s)",
    "late_base": "from the velocity before to the time of validity (s)",
    "rules_good": "whether the receiver's sample passes the checks at the input",
    "delayed_present": "whether a channel is measured",
    "delayed_renewed": "variance that an extra state begins anew with, -1 where it does not",
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


def exported(prepared: Prepared, title: str) -> FilterProgram:
    """Return the C code of the filter of a case.

    Parameters
    ----------
    prepared : Prepared
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
    refuse_redundant_imus(prepared)
    for depth in (1, 2):
        program = Program(NAME)
        storage = Storage(prepared, program, depth)
        try:
            made = _translated(program, storage, prepared)
        except RingTooShort:
            continue
        return _assembled(program, storage, made, title, prepared, depth)
    raise InputError("the filter uses states more than one epoch old")


def _translated(program: Program, storage: Storage, prepared: Prepared) -> list[str]:
    """Translate the functions of the C interface; return their names."""
    s, nav = storage, Array("nav", (10,), DOUBLE, constant=True)
    window, epoch = Scalar("window", INT), Scalar("epoch", INT)
    steps: dict[str, dict[str, Value]] = {
        "begin": {"work": s.work, "parts": s.parts, "options": s.options, "start": s.start, "nav": nav},
        "propagate": {"work": s.work, "parts": s.parts, "case": s.case, "window": window},
        "update": {"work": s.work, "parts": s.parts, "case": s.case, "epoch": epoch},
    }
    if isinstance(storage.parts.fields["open_loop"], RecordValue):
        for name in ("correct_outputs", "restore_outputs"):
            steps[name] = {"work": s.work, "parts": s.parts, "model": s.model}
    return [
        program.translated(getattr(entries, name), arguments, f"{NAME}_{name}").name
        for name, arguments in steps.items()
    ]


def _assembled(
    program: Program, storage: Storage, names: list[str], title: str, prepared: Prepared, depth: int
) -> FilterProgram:
    code = program.text(names)
    used = set(re.findall(r"self->(?:window\.|epoch\.)?(\w+)", code))
    state = {name: array for name, array in storage.state.items() if name in used | {"nav", "P", "x"}}
    inputs = {
        struct: {name: content for name, content in fields.items() if f"self->{struct}.{name}" in code}
        for struct, fields in storage.inputs.items()
    }
    code = code.replace(_OPENED, f"{_OPENED}    memset(self, 0, sizeof *self);\n", 1)
    helpers = [text for name, text in _HELPERS.items() if re.search(rf"\b{name}\(", code) or _needed(name, code)]
    prototypes = [_prototype(code, name) for name in names]
    header = _header(title, prepared, state, inputs, prototypes, depth)
    top = f'/* {title} */\n\n#include <math.h>\n#include <string.h>\n\n#include "{NAME}.h"'
    source = "\n\n".join([top, *helpers, code])
    return FilterProgram(header, source, inputs, state, depth, len(names) > 3, "int epoch)" in prototypes[2])


def _needed(name: str, code: str) -> bool:
    return name == "remainder_of" and "floor_divided(" in code


def _prototype(code: str, name: str) -> str:
    match = re.search(rf"((?:/\*(?:[^*]|\*(?!/))*\*/\n)?)(void {name}\([^)]*(?:\)\[\d+\][^)]*)*\))\n", code)
    assert match is not None
    return f"{match.group(1)}{match.group(2)};"


def _declaration(array: Array, name: str) -> str:
    return f"{array.kind} {name}{''.join(f'[{size_of(size)}]' for size in array.sizes)};"


def _documented(array: Array, name: str, text: str) -> str:
    return f"    {_declaration(array, name)} /* {text} */" if text else f"    {_declaration(array, name)}"


def _struct(label: str, fields: dict[str, tuple[Array, Any, int]], what: str) -> list[str]:
    if not fields:
        return []
    lines = [_documented(array, name, INPUTS.get(name, "")) for name, (array, _, _) in fields.items()]
    return [f"/* {what} */", f"struct {NAME}_{label} {{", *lines, "};", ""]


def _header(title: str, prepared: Prepared, state: Any, inputs: Any, prototypes: list[str], depth: int) -> str:
    counted = [f"   {at:2d} {name}" for at, name in enumerate(state_names(prepared.layout))]
    ring_note = "" if depth == 1 else f" Those of an epoch stand at its number modulo {depth}."
    lines = [
        f"/* {title}",
        "",
        "   States of P and x (SI; attitude, velocity and position in the inertial frame):",
        *counted,
        "   */",
        f"#ifndef {NAME.upper()}_H",
        f"#define {NAME.upper()}_H",
        "",
    ]
    lines += _struct("window", inputs["window"], "What a window differs by from others: set before propagate.")
    lines += _struct("epoch", inputs["epoch"], f"What an epoch differs by from others: set before update.{ring_note}")
    lines.append(f"struct {NAME} {{")
    lines += [f"    struct {NAME}_{label} {label};" for label in inputs if inputs[label]]
    work_arrays = {name: "" for name in state if name not in MEASURED and name not in ESTIMATED}
    for heading, group in (("measured", MEASURED), ("estimated", ESTIMATED), ("work", work_arrays)):
        present = [name for name in group if name in state]
        lines += [f"    /* {heading} */"] * bool(present)
        lines += [_documented(state[name], name, group[name]) for name in present]
    lines += ["};", "", *prototypes, "", "#endif"]
    return "\n".join(line for text in lines for line in _wrapped(text)) + "\n"


def _wrapped(line: str) -> list[str]:
    if len(line) <= 118 or "\n" in line:
        return [line]
    return textwrap.wrap(line, 118, subsequent_indent="        ") or [""]
