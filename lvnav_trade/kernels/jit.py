"""The one numba decorator."""

import os
from collections.abc import Callable
from typing import Any

from lvnav_trade.kernels.cache_folder import is_plain, set_cache_folder

set_cache_folder()

import numba  # noqa: E402  (the cache folder must be known first)

numba.config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]


def _compiled(function: Callable[..., Any], **how: Any) -> Callable[..., Any]:
    if numba.config.DISABLE_JIT:
        return function
    how = {"nogil": True, "error_model": "numpy", "fastmath": False, "_nrt": False, **how}
    if is_plain():
        return numba.njit(cache=True, **how)(function)
    from lvnav_trade.kernels.compiler import compiled

    return compiled(function, how)


def jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel: cached, without the interpreter lock, division by zero gives inf or NaN as in numpy.

    It makes no array, see `making_arrays`.
    """
    return _compiled(function)


def making_arrays(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that makes arrays, and whatever of its callers hands them on.

    Only here are references to arrays counted. A kernel that works on what it is given does without, for the count
    takes two locked instructions wherever a record's array is named: a third of a flight at 200 Hz covariance. So a
    kernel under `jit` returns no array.
    """
    return _compiled(function, _nrt=True)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a step of a loop into its caller: a call would copy hundreds of words of settings and views each time.

    The compiler of machine code inlines it. Inlining by numba itself (`inline="always"`) compiles 15 % sooner and flies
    20 % slower.
    """
    return _compiled(function, forceinline=True)
