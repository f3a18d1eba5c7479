"""Answers about calls are kept as long as they hold."""

from __future__ import annotations

import operator

import numba
import numpy as np
import pytest
from numba import types
from numba.core.registry import cpu_target
from numba.extending import overload

from lvnav_trade.kernels.jit import array_jit, jit


@jit
def _half(a):
    return 0.5 * a


def test_an_answer_is_looked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    look = types.Function.get_call_type
    monkeypatch.setattr(types.Function, "get_call_type", lambda *given: asked.append(given[0]) or look(*given))
    kinds = (types.float32, types.uint16)  # of no kernel, so that no other test has asked
    cpu_target.typing_context.refresh()
    found = [cpu_target.typing_context.resolve_function_type(operator.pow, kinds, {}) for _ in range(3)]
    assert found[0] is found[1] is found[2]
    assert found[0] is not None
    assert len(asked) == 1


def test_what_numba_learns_later_counts() -> None:
    def spread(values):
        raise NotImplementedError

    @jit
    def twice(values):
        return 2.0 * spread(values)

    with pytest.raises(numba.TypingError):
        twice(np.arange(3.0))

    @overload(spread)
    def _spread(values):
        return lambda values: values[-1] - values[0]

    @jit
    def twice_again(values):
        return 2.0 * spread(values)

    assert twice_again(np.arange(3.0)) == 4.0


def test_an_answer_for_kernels_that_make_arrays_is_none_for_others() -> None:
    @array_jit
    def counted(n):
        return np.full(n, 2.0).size

    @jit
    def plain(n):
        return np.full(n, 2.0).size

    assert counted(5) == 5
    with pytest.raises(numba.TypingError):
        plain(5)
