"""Kernels as C, compiled and called, to be held against the kernels themselves."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lvnav_trade.export.translation.program import Program, bind_arguments
from lvnav_trade.export.translation.values import DOUBLE, INT, Array, Constant, Scalar, Value

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler on this machine")
HEAD = """#include <math.h>
static int smaller(int a, int b) { return a < b ? a : b; }
static int larger(int a, int b) { return a > b ? a : b; }
static int remainder_of(int a, int b) { return ((a % b) + b) % b; }
static int floor_divided(int a, int b) { return (a - remainder_of(a, b)) / b; }
int unused(int a, int b) { return smaller(a, b) + larger(a, b) + floor_divided(a, b); }
"""


def value_of(name: str, argument: Any) -> Value:
    """Return an argument as the translator sees it: arrays and numbers vary, all else is known."""
    if isinstance(argument, np.ndarray):
        return Array(name, argument.shape, DOUBLE if argument.dtype.kind == "f" else INT)
    if isinstance(argument, float):
        return Scalar(name, DOUBLE)
    if isinstance(argument, int) and not isinstance(argument, bool):
        return Scalar(name, INT)
    return argument if isinstance(argument, Constant) else Constant(argument)


def code_of(function: Any, *arguments: Any) -> str:
    """Return the C of a kernel for arguments like these."""
    program = Program("state")
    names = list(bind_arguments(function, [Constant(0)] * len(arguments), {}))
    given = {name: value_of(name, argument) for name, argument in zip(names, arguments, strict=True)}
    program.translated_kernel(function, given, "entry")
    return program.text(["entry"])


def called(function: Any, *arguments: Any) -> None:
    """Call a kernel as C; arrays of float64 or int32 among the arguments are changed as it changes them."""
    with tempfile.TemporaryDirectory() as place:
        Path(place, "kernel.c").write_text(HEAD + code_of(function, *arguments))
        flags = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-shared", "-fPIC"]
        built = subprocess.run(
            ["cc", *flags, "-o", "kernel.so", "kernel.c", "-lm"], cwd=place, capture_output=True, text=True, check=False
        )
        assert built.returncode == 0, built.stderr
        passed = []
        for argument in arguments:
            if isinstance(argument, np.ndarray):
                passed.append(argument.ctypes.data_as(ctypes.c_void_p))
            elif isinstance(argument, float):
                passed.append(ctypes.c_double(argument))
            elif isinstance(argument, int) and not isinstance(argument, bool):
                passed.append(ctypes.c_int(argument))
        ctypes.CDLL(str(Path(place, "kernel.so"))).entry(*passed)
