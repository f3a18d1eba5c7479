"""A program of kernels: versions by what is known, tables stored once, nothing that does nothing."""

import re

import numpy as np

from lvnav_trade.export.translation.program import Program
from lvnav_trade.export.translation.values import Array, Constant, Scalar

OUT = Array("out", (3,), "double")
TABLE = np.array([1.0, 2.0, 3.0])


def _scaled(x, axis, scale):
    if scale is None:
        return x[axis]
    return scale * x[axis]


def _nothing(x):
    for i in range(0):
        x[i] = 0.0


def twice(out, x):
    """Two versions of a kernel: by what is known.

    The second paragraph is not for C.
    """
    _nothing(out)
    out[0] = _scaled(x, 0, None)
    out[1] = _scaled(x, 0, None) + TABLE[int(x[0])]
    out[2] = _scaled(x, 0, 2.5) + TABLE[int(x[1])]


def made():
    program = Program("state")
    program.translated_kernel(twice, {"out": OUT, "x": OUT}, "entry")
    return program.text(["entry"])


def test_a_kernel_has_one_function_for_each_set_of_what_is_known():
    assert len(re.findall(r"^static double test_program_scaled\w*\(", made(), re.MULTILINE)) == 2


def test_what_does_nothing_is_not_there():
    assert "nothing" not in made()


def test_a_table_is_stored_once():
    assert made().count("static const double TEST_PROGRAM_TABLE[3] = {1.0, 2.0, 3.0};") == 1
    assert made().count("TEST_PROGRAM_TABLE[") == 3


def test_the_first_paragraph_of_a_docstring_is_the_comment():
    assert "/* Two versions of a kernel: by what is known. */\nvoid entry(" in made()
    assert "second paragraph" not in made()


def test_a_function_of_known_numbers_is_its_value():
    def known(n):
        return n + 1

    def caller(out, n):
        out[0] = known(n)

    program = Program("state")
    program.global_value(known, "known")
    found = program.translated_kernel(known, {"n": Constant(3)})
    assert found.constant == Constant(4)
    assert program.translated_kernel(known, {"n": Scalar("n", "int")}).constant is None
    assert caller is not None
