"""Recorded runs of a case for its filter in C, and the C program that replays them."""

from __future__ import annotations

from collections.abc import Set
from typing import Any

import numpy as np

from lvnav_trade.export.code import NAME, FilterProgram
from lvnav_trade.export.storage import BY_TICK
from lvnav_trade.export.translation.values import INT, ONLY, Array, size_of
from lvnav_trade.simulation.montecarlo import record_run
from lvnav_trade.simulation.preparation.prepare import PreparedCase

LIMIT = 1e-9
"""Largest difference of a replay from the runs, relative to the magnitude of the state."""
# Names of fields in the recorded run, by their name in the struct.
_MEASURED = {
    "ranges": "ranges",
    "solution": "solution",
    "receiver_covariance": "covariance",
    "sensor_measurements": "sensor_measurements",
}
_COMPARED = {"nav": "nav", "x": "x", "par": "par", "clock_hat": "clock", "extra": "extra"}
_END = -1  # index of the estimates at the end of a run


def flight_bytes(prepared_case: PreparedCase, program: FilterProgram) -> bytes:
    """Return the inputs of a filter in every window and epoch, which are equal in all runs, as bytes of doubles.

    The first number is the number of windows. Each window has its number of ticks, the number of its epoch (negative
    without an epoch), whether estimates are compared after it, and its inputs.

    Parameters
    ----------
    prepared_case : PreparedCase
        The prepared scenario.
    program : FilterProgram
        C code of its filter, which determines the inputs.
    """
    schedule = prepared_case.schedule
    values: list[Any] = [schedule.n_tick.size]
    for w, epoch in enumerate(schedule.epoch):
        values += [schedule.n_tick[w], epoch, _is_compared(prepared_case, w)]
        for _, value, axis in program.inputs["window"].values():
            values.append(_window_values(prepared_case, w, value, axis))
        if epoch >= 0:
            for _, value, axis in program.inputs["epoch"].values():
                values.append(np.take(value, epoch, axis=axis))
    return _bytes(values)


def _window_values(prepared_case: PreparedCase, w: int, value: Any, axis: int) -> Any:
    """Return the values of a field in a window.

    A field by tick gives the number of the first tick, followed by the values of the ticks.

    Parameters
    ----------
    prepared_case : PreparedCase
        The prepared scenario.
    w : int
        Number of the window, from 0.
    value : array
        Values of the field in all windows or ticks.
    axis : int
        Time axis of `value`; `BY_TICK` for a field by tick.
    """
    if axis != BY_TICK:
        return np.take(value, w, axis=axis)
    first = prepared_case.schedule.first_tick[w]
    last = first + prepared_case.schedule.n_tick[w]
    return np.concatenate([[float(first)], np.ravel(value[first:last])])


def run_bytes(prepared_case: PreparedCase, program: FilterProgram, seed: int, run: int) -> bytes:
    """Return increments, measurements and estimates of a recorded run as bytes of doubles.

    After the initial state, each window has its increments, the measurements of its epoch, and, where estimates are
    compared, the estimates and the diagonal of the covariance after the epoch.

    Parameters
    ----------
    prepared_case : PreparedCase
        The prepared scenario.
    program : FilterProgram
        C code of its filter, which determines the recorded arrays.
    seed : int
        Seed of the campaign.
    run : int
        Number of the run, from 0.
    """
    tape = record_run(prepared_case, seed, run).tape
    schedule = prepared_case.schedule
    values: list[Any] = [tape.start]
    for w, epoch in enumerate(schedule.epoch):
        first = schedule.first_tick[w]
        last = first + schedule.n_tick[w]
        values.append(tape.increments[first:last])
        if epoch >= 0:
            values += [getattr(tape, _MEASURED[name])[epoch] for name in _measurement_names(program)]
        if _is_compared(prepared_case, w):
            index = epoch if epoch >= 0 else _END
            values += [getattr(tape.estimates_after, _COMPARED[name])[index] for name in _estimate_names(program)]
            values.append(np.diagonal(tape.estimates_after.P[index]))
    return _bytes(values)


def _bytes(values: list[Any]) -> bytes:
    flat_values = [np.ravel(np.asarray(value, dtype=float)) for value in values]
    return np.concatenate(flat_values).tobytes()


def _is_compared(prepared_case: PreparedCase, w: int) -> bool:
    """Return whether estimates are compared after a window: at each epoch, and at the end."""
    return bool(prepared_case.schedule.epoch[w] >= 0 or w == prepared_case.schedule.n_tick.size - 1)


def _measurement_names(program: FilterProgram) -> list[str]:
    """Return the fields of the struct that receive measurements."""
    return [name for name in _MEASURED if name in program.state]


def _estimate_names(program: FilterProgram) -> list[str]:
    """Return the fields of the struct that are compared with the simulation."""
    return [name for name in _COMPARED if name in program.state]


def _reading(array: Array, place: str, file: str, depth: int) -> list[str]:
    """Return the C statements that read an array of the struct from a file of doubles.

    Parameters
    ----------
    array : Array
        The array.
    place : str
        The array as a C expression.
    file : str
        C name of the open file.
    depth : int
        Number of epochs that the struct stores. A ring buffer is read at the epoch modulo this number.
    """
    lines: list[str] = []
    text = place
    for axis, size in enumerate(array.shape):
        if array.ring(axis) == ONLY:
            continue
        if array.ring(axis) > 1:
            text += f"[epoch % {depth}]"
            continue
        name = f"i{axis}"
        lines.append(f"{_STEP * len(lines)}for (int {name} = 0; {name} < {size_of(size)}; {name}++)")
        text += f"[{name}]"
    cast = "(int)" if array.c_type == INT else ""
    lines.append(f"{_STEP * len(lines)}{text} = {cast}next({file});")
    return lines


def _reading_ticks(array: Array, place: str) -> list[str]:
    """Return the C statements that read the values of a window's ticks, which follow the number of the first tick."""
    return [
        "for (int k = 0, first = (int)next(flight); k < n_tick; k++)",
        f"{_STEP}for (int i = 0; i < {size_of(array.shape[1])}; i++)",
        f"{_STEP * 2}{place}[(first + k) % {array.ring(0)}][i] = next(flight);",
    ]


def _read_into(
    fields: dict[str, Array], prefix: str, file: str, depth: int, level: int, ticks: Set[str] = frozenset()
) -> str:
    """Return the C statements that read all fields of a struct.

    Parameters
    ----------
    fields : dict
        Arrays by name of the field. Arrays of zero length are omitted.
    prefix : str
        C expression of the struct, with the dot.
    file, depth
        As in `_reading`.
    level : int
        Level of indentation.
    ticks : set of str
        Names of the fields with values by tick.
    """
    lines = []
    for name, array in fields.items():
        if 0 in array.shape:
            continue
        if name in ticks:
            lines += _reading_ticks(array, f"{prefix}{name}")
        else:
            lines += _reading(array, f"{prefix}{name}", file, depth)
    return "\n".join(f"{_STEP * level}{line}" for line in lines)


def replay_text(program: FilterProgram, n_state: int) -> str:
    """Return the C program that replays runs: `replay flight.bin run_0.bin run_1.bin ...`.

    For each run it prints the largest difference of every estimate, relative to the magnitude of its block, and the
    largest difference of velocity and position in sigmas. It returns 1 if a relative difference exceeds `LIMIT`.

    Parameters
    ----------
    program : FilterProgram
        C code of the filter.
    n_state : int
        Number of states of the filter.
    """
    windows = {name: array for name, (array, _, _) in program.inputs["window"].items()}
    epochs = {name: array for name, (array, _, _) in program.inputs["epoch"].items()}
    ticks = {name for name, (_, _, axis) in program.inputs["window"].items() if axis == BY_TICK}
    measurement_arrays = {name: program.state[name] for name in _measurement_names(program)}
    blocks = _estimate_blocks(program)
    comparisons = []
    for number, (label, text, first, count) in enumerate(blocks):
        first_state = _SIGMAS.get(label, "-1")
        comparisons.append(
            f"            difference({text} + {first}, {count}, file, worst + {number}, {first_state}, &sigmas);"
        )
    return _REPLAY.format(
        name=NAME,
        limit=LIMIT,
        n_state=n_state,
        n_block=len(blocks) + 1,
        labels=", ".join(f'"{label}"' for label, *_ in blocks),
        window=_read_into(windows, "self.window.", "flight", program.depth, 2, ticks),
        epoch=_read_into(epochs, "self.epoch.", "flight", program.depth, 3),
        measured=_read_into(measurement_arrays, "self.", "file", program.depth, 3),
        compared="\n".join(comparisons),
        epoch_argument=", epoch" if program.counts_epochs else "",
    )


def _estimate_blocks(program: FilterProgram) -> list[tuple[str, str, int, int]]:
    """Return label, array in C, first element and number of elements of every block of estimates."""
    blocks = [
        ("attitude", "self.nav", 0, 4),
        ("velocity", "self.nav", 4, 3),
        ("position", "self.nav", 7, 3),
    ]
    for name in _estimate_names(program)[1:]:
        sizes = [size_of(size) for size in program.state[name].sizes]
        blocks.append((name, f"(const double *)self.{name}", 0, int(np.prod(sizes))))
    return blocks


_STEP = " " * 4
_SIGMAS = {"velocity": "3", "position": "6"}
_REPLAY = r"""/* Replays runs that were recorded with the filter of the simulation: replay flight.bin run_0.bin ... */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "{name}.h"

enum {{ N_STATE = {n_state}, N_BLOCK = {n_block} }};
static const char *labels[N_BLOCK] = {{{labels}, "variance"}};
static struct {name} self;

static double next(FILE *file)
{{
    double value;
    if (fread(&value, sizeof value, 1, file) != 1) {{
        fprintf(stderr, "a recording ends too early\n");
        exit(2);
    }}
    return value;
}}

static FILE *opened(const char *path)
{{
    FILE *file = fopen(path, "rb");
    if (file == NULL) {{
        fprintf(stderr, "%s: cannot be read\n", path);
        exit(2);
    }}
    return file;
}}

/* Find the largest difference of values from those of a recording, as a share of the largest of them; of states from
   first_state on, unless that is negative, in sigmas too. */
static void difference(const double *values, int n, FILE *file, double *worst, int first_state, double *sigmas)
{{
    double size = 0.0, largest = 0.0;
    for (int i = 0; i < n; i++) {{
        double expected = next(file), off = fabs(values[i] - expected);
        if (isnan(expected) && isnan(values[i]))
            continue;
        size = fmax(size, fabs(expected));
        largest = off <= largest ? largest : off;
        if (first_state >= 0)
            *sigmas = fmax(*sigmas, off / sqrt(self.P[first_state + i][first_state + i]));
    }}
    if (largest != 0.0)
        *worst = largest / size <= *worst ? *worst : largest / size;
}}

static int replayed(const char *flight_path, const char *path)
{{
    FILE *flight = opened(flight_path), *file = opened(path);
    double worst[N_BLOCK] = {{0.0}}, sigmas = 0.0, nav[10];
    int n_window = (int)next(flight), n_compared = 0, fails = 0;
    for (int i = 0; i < 10; i++)
        nav[i] = next(file);
    {name}_begin(&self, nav);
    for (int w = 0; w < n_window; w++) {{
        int n_tick = (int)next(flight), epoch = (int)next(flight), compares = (int)next(flight);
{window}
        for (int k = 0; k < n_tick; k++)
            for (int i = 0; i < 6; i++)
                self.increments[k][i] = next(file);
        if (n_tick > 0)
            {name}_propagate(&self);
        if (epoch >= 0) {{
{epoch}
{measured}
            {name}_update(&self{epoch_argument});
        }}
        if (compares) {{
            n_compared++;
{compared}
            for (int i = 0; i < N_STATE; i++) {{
                double expected = next(file), off = fabs(self.P[i][i] - expected);
                if (off != 0.0 && !(off / fabs(expected) <= worst[N_BLOCK - 1]))
                    worst[N_BLOCK - 1] = off / fabs(expected);
            }}
        }}
    }}
    for (int b = 0; b < N_BLOCK; b++) {{
        printf("%s,%s,%d,%.3e\n", path, labels[b], n_compared, worst[b]);
        fails |= !(worst[b] <= {limit});
    }}
    printf("%s,sigmas,%d,%.3e\n", path, n_compared, sigmas);
    fclose(flight);
    fclose(file);
    return fails;
}}

int main(int argc, char **argv)
{{
    int fails = 0;
    if (argc < 3) {{
        fprintf(stderr, "replay flight.bin run_0.bin ...\n");
        return 2;
    }}
    printf("run,estimate,times,difference\n");
    for (int i = 2; i < argc; i++)
        fails |= replayed(argv[1], argv[i]);
    return fails;
}}
"""
