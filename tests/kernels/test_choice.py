"""A kernel that calls one of several by number does what tests written by hand would do."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from lvnav_trade.kernels.choice import choose_kernel, source_of


def double(out, x):
    out[0] = 2.0 * x


def add(y, out, x):
    out[0] = x + y


@choose_kernel([double, None, add, double])
def chosen(out, code, x, y):
    """Set out (1,) by the number."""


@pytest.mark.parametrize(("code", "expected"), [(0, 6.0), (1, -1.0), (2, 8.0), (3, 6.0), (4, -1.0)])
def test_the_kernel_of_the_number_is_called_with_the_arguments_that_it_names(code, expected):
    out = np.array([-1.0])
    chosen(out, code, 3.0, 5.0)
    assert out[0] == expected


def test_it_is_as_if_someone_had_written_it():
    assert source_of(chosen).splitlines() == [
        "def chosen(out, code, x, y):",
        "    if code == 0 or code == 3:",
        "        test_choice_double(out, x)",
        "    elif code == 2:",
        "        test_choice_add(y, out, x)",
    ]
    assert (chosen.__name__, chosen.__module__, chosen.__doc__) == ("chosen", __name__, "Set out (1,) by the number.")
    assert chosen.__code__.co_filename == __file__


def test_the_source_of_any_other_function_is_that_of_its_file():
    assert source_of(choose_kernel) == inspect.getsource(choose_kernel)


def test_two_kernels_of_one_name_are_both_called():
    def other(out, x):
        out[0] = -x

    other.__name__ = "double"

    @choose_kernel([double, other])
    def either(out, code, x):
        """Set out (1,)."""

    out = np.zeros(1)
    either(out, 1, 3.0)
    assert out[0] == -3.0


def test_a_kernel_that_asks_for_what_is_not_there_is_named():
    with pytest.raises(TypeError, match=r"test_choice\.add asks for y; there is out, code, x"):

        @choose_kernel([add])
        def unable(out, code, x):
            """Set out (1,)."""
