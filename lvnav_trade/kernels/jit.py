"""Decorators of kernels, functions that numba compiles."""

import os
from collections.abc import Callable
from typing import Any

from lvnav_trade.kernels.cache_folder import is_plain, set_cache_folder

set_cache_folder()

import numba  # noqa: E402  (the cache folder must be known first)

numba.config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]


def _compile(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    if numba.config.DISABLE_JIT:
        return function
    options = {"nogil": True, "error_model": "numpy", "fastmath": False, "_nrt": False, **options}
    if is_plain():
        return numba.njit(cache=True, **options)(function)
    from lvnav_trade.kernels.compiler import compile_kernel

    return compile_kernel(function, options)


def jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that creates no array, see `array_jit`.

    The kernel is cached and runs without the interpreter lock. Division by zero gives inf or NaN, as in numpy.
    """
    return _compile(function)


def array_jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that creates arrays; callers that pass such arrays on need this decorator too.

    Only these kernels count references to arrays. Counting takes two locked instructions wherever an array of a record
    is named, a third of the time of a run with the covariance at 200 Hz. Kernels under `jit` do not count and therefore
    return no array.
    """
    return _compile(function, _nrt=True)


def inline_jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that is inlined into its callers, for steps of a loop.

    A call would copy hundreds of words of settings and views each time. LLVM inlines the kernel. Inlining by numba
    (`inline="always"`) shortens compilation by 15 % but makes runs 20 % slower.
    """
    return _compile(function, forceinline=True)
