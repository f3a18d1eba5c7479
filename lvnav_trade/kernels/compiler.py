"""Compilation of kernels: numba's compiler, with some of its classes replaced by faster ones of this package.

`jit.py` defines what a kernel is. The classes here shorten the wait for the first call; results are the same bits.
"""

import gc
import itertools
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FunctionType
from typing import Any

import numba
from numba.core.bytecode import FunctionIdentity
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.registry import CPUDispatcher, cpu_target

from lvnav_trade.kernels.by_address import PACKAGE, Compiler
from lvnav_trade.kernels.cache_files import KernelCache
from lvnav_trade.kernels.resolved_calls import install_call_cache

_PART = "_part_of_lvnav_trade"
_PACKAGE_NAME = f"{len(PACKAGE)}{PACKAGE}"  # in the names of numba, a module after its length
_ENTRY_NAME = f"_ZN7cpython{_PACKAGE_NAME}"
_ENTRY = "entry"  # numba's own kinds are "object" and "bitcode"


def _number_functions() -> None:
    """Start the numbers of functions that this process compiles at random.

    Numba distinguishes functions with the same name and signature (such as + and * of lanes) by a number, which every
    process counts from one. The cache combines functions compiled by different processes, and the linker merges two
    functions with the same full name: a kernel would add instead of multiply.
    """
    FunctionIdentity._unique_ids = itertools.count(secrets.randbits(64))


_number_functions()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_number_functions)


class Library(JITCodeLibrary):  # type: ignore[misc]  # numba publishes no types
    """Compiled form of a function. A kernel that only kernels call (a part) has only what its callers need.

    A caller optimises again whatever it calls, at all depths. A part is therefore optimised lightly and has no machine
    code. A kernel that Python calls (an entry) is stored as machine code only: its intermediate code is three times as
    large, and every process would read it.
    """

    is_entry = False

    @property
    def is_part(self) -> bool:
        """Whether only kernels call it."""
        return _PART in self.name

    def add_ir_module(self, ir_module: Any) -> None:
        """Add the intermediate code of a function. The Python wrapper of a kernel is not optimised.

        The wrapper unpacks arrays once per call, which takes a hundredth of the time of a run.
        """
        for function in ir_module.functions:
            if function.name.startswith(_ENTRY_NAME) and not function.is_declaration:
                function.attributes.add("optnone")
                function.attributes.add("noinline")
        super().add_ir_module(ir_module)

    def _optimize_functions(self, ll_module: Any) -> None:
        """Optimise functions; those of this package lightly, because their callers optimise them again."""
        defined_functions = [function for function in ll_module.functions if not function.is_declaration]
        if not any(_PACKAGE_NAME in function.name for function in defined_functions):
            super()._optimize_functions(ll_module)
            return
        ll_module.data_layout = self._codegen._data_layout
        passes, builder = self._codegen._function_pass_manager(opt=1)
        for function in defined_functions:
            passes.run(function, builder)

    def _optimize_final_module(self) -> None:
        if not self.is_part:
            super()._optimize_final_module()
            return
        options = {"loop_vectorize": False, "slp_vectorize": False, "opt": 0, "cost": "cheap"}  # numba's own first step
        passes, builder = self._codegen._module_pass_manager(**options)
        passes.run(self._final_module, builder)

    def _finalize_final_module(self) -> None:
        if self.is_part:
            self._finalize_dynamic_globals()
            self._finalized = True
        else:
            super()._finalize_final_module()

    def _get_compiled_object(self) -> Any:
        return b"" if self.is_part else super()._get_compiled_object()

    def serialize_using_object_code(self) -> Any:
        """Return name, kind and content for the cache."""
        if not self.is_entry:
            return super().serialize_using_object_code()
        self._ensure_finalized()
        symbols = (*self._final_module.functions, *self._final_module.global_variables)
        names = frozenset(symbol.name for symbol in symbols if not symbol.is_declaration)
        return self.name, _ENTRY, (self._get_compiled_object(), names)

    @classmethod
    def _unserialize(cls, codegen: Any, state: tuple[str, str, Any]) -> Any:
        name, form, content = state
        if form != _ENTRY:
            return super()._unserialize(codegen, state)
        library = codegen.create_library(name)
        library.enable_object_caching()
        code, names = content
        library._set_compiled_object(code)
        library._finalize_final_module()
        codegen._engine._defined_symbols |= names
        return library


class Codegen(JITCPUCodegen):  # type: ignore[misc]
    """Numba's compiler, with libraries as above."""

    _library_class = Library

    def set_env(self, env_name: str, env: Any) -> None:
        """Set the environment of a function in its machine code; a part has none."""
        if self._engine.get_global_value_address(env_name):
            super().set_env(env_name, env)


cpu_target.target_context.codegen().__class__ = Codegen
install_call_cache()


_COLLECTION_THRESHOLD = 100_000  # new objects; Python's own number is 700 or 2,000


@contextmanager
def _rare_collection() -> Iterator[None]:
    """Collect garbage less often. Nearly all objects of the compiler are in use, and collection takes a tenth of its
    time.
    """
    thresholds = gc.get_threshold()
    gc.set_threshold(_COLLECTION_THRESHOLD, *thresholds[1:])
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)


class Kernel(CPUDispatcher):  # type: ignore[misc]  # numba publishes no types
    """A kernel as Python calls it. Kernels call its twin `inner`, which has no Python wrapper.

    The wrapper unpacks and checks every array of every record among the arguments. For a small function with the
    records of a run that is a third of the compilation. Only a kernel that Python calls gets a wrapper, at that call.
    """

    inner: Any

    def compile(self, sig: Any) -> Any:
        """Compile a signature and everything that it calls, or load it from the cache."""
        with _rare_collection():
            return super().compile(sig)

    @property
    def _numba_type_(self) -> Any:
        """Type under which other kernels see this kernel: its twin."""
        return numba.types.Dispatcher(self.inner)


class InnerKernel(CPUDispatcher):  # type: ignore[misc]
    """A kernel as other kernels call it.

    A literal argument, such as an axis or a column, does not make another version. LLVM sees the literal when it
    inlines the call.
    """

    def compile(self, sig: Any) -> Any:
        """Compile a signature or load it from the cache; numba asks many times for the same signature."""
        version = self.overloads.get(sig) if isinstance(sig, tuple) else None
        return super().compile(sig) if version is None else version.entry_point

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return the version for given types of arguments; a literal counts as its type."""
        return super().get_call_template(tuple(map(numba.types.unliteral, args)), kws)


def compile_kernel(function: Callable[..., Any], options: dict[str, Any]) -> Callable[..., Any]:
    """Return a kernel for Python, with its twin for kernels. options: those of numba.njit."""
    options = options | {"pipeline_class": Compiler, "no_cfunc_wrapper": True}
    twin = FunctionType(
        function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
    )
    twin.__module__, twin.__qualname__ = function.__module__, f"{function.__qualname__}{_PART}"  # another cache file
    kernel = numba.njit(**options)(function)
    kernel.__class__ = Kernel
    kernel.inner = numba.njit(**options, no_cpython_wrapper=True)(twin)
    kernel.inner.__class__ = InnerKernel
    kernel._cache, kernel.inner._cache = KernelCache(function), KernelCache(twin)
    return kernel
