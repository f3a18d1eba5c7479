"""Statements of kernels do in C what they do in Python."""

import numpy as np
import pytest

from lvnav_trade.export.translation.values import TranslationError
from tests.export.translation import kernels
from tests.export.translation.compiled import called, code_of, needs_compiler


@needs_compiler
@pytest.mark.parametrize(("function", "x", "more"), [
    (kernels.loops, [1.5, -2.0, 2.0, 4.0, 7.0], ()),
    (kernels.numbers, [0.7, -3.9], (7,)),
    (kernels.numbers, [-0.7, 3.9], (2,)),
    (kernels.functions, [3.0, 0.5], ()),
    (kernels.functions, [300.0, 0.5], ()),
    (kernels.parts, [[1.0, 2.0, 3.0], [0.25, 5.0, 6.0], [7.0, 8.0, 9.0]], (2,)),
    (kernels.returns, [3.0, -1.0], (5,)),
])  # fmt: skip
def test_a_kernel_as_c_does_what_it_does_in_python(function, x, more):
    mine, his = np.array(x), np.array(x)
    expected, found = np.zeros(16), np.zeros(16)
    function(expected, mine, *more)
    called(function, found, his, *more)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(his, mine)


@needs_compiler
def test_what_stands_on_both_sides_of_an_assignment_is_read_before_it_is_written():
    def swaps(out, x):
        a, b = x[0], x[1]
        a, b = b, a
        c = d = a - b
        x[2], x[3] = x[3], x[2]
        out[0], out[1], out[2], out[3] = a, b, c, d

    x, found = np.array([1.0, 2.0, 3.0, 4.0]), np.zeros(4)
    called(swaps, found, x)
    assert found.tolist() == [2.0, 1.0, 1.0, 1.0]
    assert x.tolist() == [1.0, 2.0, 4.0, 3.0]


def test_what_is_known_leaves_no_branch():
    code = code_of(kernels.settled, np.zeros(1), None, True)
    assert "out[0] = 1.0;" in code
    assert "if (" not in code
    assert "for (" not in code


def test_a_statement_without_a_translation_is_named_with_its_line():
    with pytest.raises(TranslationError, match=r"kernels\.swaps, line 8: is no place to store to: \*_rest"):
        code_of(kernels.swaps, np.zeros(4), np.zeros(4))
