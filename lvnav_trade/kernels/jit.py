"""The one numba decorator; cache folder named by source digest."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any


def _source_digest(package: Path) -> str:
    """Digest of every module that holds a kernel: numba's own cache does not see an edit in another file."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        text = path.read_bytes()
        if b"kernels.jit import" in text or path.parent.name == "kernels":
            digest.update(str(path.relative_to(package)).encode())
            digest.update(text)
    return digest.hexdigest()[:16]


def _set_cache_folder() -> None:
    """Point numba at a per-version folder, before numba is first imported; a folder of the user's own is kept as
    root.
    """
    root = os.environ.get("NUMBA_CACHE_DIR") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "lvnav_trade"
    )
    if not Path(root).name.startswith("kernels-"):
        root = os.path.join(root, "kernels-" + _source_digest(Path(__file__).resolve().parents[1]))
    os.environ["NUMBA_CACHE_DIR"] = root


_set_cache_folder()

import numba  # noqa: E402  (the cache folder must be known first)
from numba.core.registry import CPUDispatcher  # noqa: E402

numba.config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]


class Kernel(CPUDispatcher):  # type: ignore[misc]  # numba tells no types
    """A kernel that other kernels call by its twin `inner`, which has no entry for Python.

    The entry unpacks and checks every array of every record among the arguments: a third of what there is to compile of
    a small function that takes the records of a flight. Only a kernel that Python calls gets one, by that call.
    """

    inner: Any

    @property
    def _numba_type_(self) -> Any:
        """What a kernel that names this one sees: its twin."""
        return numba.types.Dispatcher(self.inner)


def _compiled(function: Callable[..., Any], **how: Any) -> Callable[..., Any]:
    if numba.config.DISABLE_JIT:
        return function
    how = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": False, **how}
    twin = FunctionType(
        function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
    )
    twin.__module__, twin.__qualname__ = function.__module__, f"{function.__qualname__}_inner"  # another cache file
    kernel = numba.njit(**how)(function)
    kernel.__class__ = Kernel
    kernel.inner = numba.njit(**how, no_cpython_wrapper=True, no_cfunc_wrapper=True)(twin)
    return kernel


def jit(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel: cached, without the interpreter lock, division by zero gives inf or NaN as in numpy."""
    return _compiled(function)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a step of a loop into its caller: a call would copy hundreds of words of settings and views each time.

    The compiler of machine code inlines it. Inlining by numba itself (`inline="always"`) compiles 15 % sooner and flies
    20 % slower.
    """
    return _compiled(function, forceinline=True)
