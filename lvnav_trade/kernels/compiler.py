"""How kernels are compiled: numba's compiler with classes of this package in the place of some of its own.

The text of `jit.py` says what a kernel is; whatever is here makes its first call wait less, and computes the same bits.
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
from lvnav_trade.kernels.resolved_calls import remember

_PART = "_part_of_lvnav_trade"
_OWN = f"{len(PACKAGE)}{PACKAGE}"  # in the names of numba, a module after its length
_ENTRY_NAME = f"_ZN7cpython{_OWN}"
_ENTRY = "entry"  # numba's own kinds are "object" and "bitcode"


def _number_functions() -> None:
    """Let this process number the functions that it compiles from a start of its own.

    Numba tells functions of one name and signature apart (the + and the x of a lane are such) by a number that every
    process counts from one. But parts that different processes have compiled meet in the cache, and the linker takes
    two functions of one full name for one: it would add where it should multiply.
    """
    FunctionIdentity._unique_ids = itertools.count(secrets.randbits(64))


_number_functions()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_number_functions)


class Library(JITCodeLibrary):  # type: ignore[misc]  # numba tells no types
    """What numba makes of a function; of a kernel that only kernels call, no more than its callers need.

    Every caller optimises all that it calls once more, down to the bottom. So a part is tidied up and handed on: it is
    not optimised to the end by itself, and has no machine code of its own. An entry, which no kernel calls, is kept as
    machine code alone: its intermediate code, three times as large, would be read into every process that calls it.
    """

    is_entry = False

    @property
    def is_part(self) -> bool:
        """Whether only kernels call it."""
        return _PART in self.name

    def add_ir_module(self, ir_module: Any) -> None:
        """Take in what was written of a function; a kernel's entry for Python is translated as it is: it unpacks arrays
        once a call, in a hundredth of the time that a flight takes.
        """
        for function in ir_module.functions:
            if function.name.startswith(_ENTRY_NAME) and not function.is_declaration:
                function.attributes.add("optnone")
                function.attributes.add("noinline")
        super().add_ir_module(ir_module)

    def _optimize_functions(self, ll_module: Any) -> None:
        """Tidy up functions; those of this package lightly, for whoever takes them in optimises them to the end."""
        defined = [function for function in ll_module.functions if not function.is_declaration]
        if not any(_OWN in function.name for function in defined):
            super()._optimize_functions(ll_module)
            return
        ll_module.data_layout = self._codegen._data_layout
        found = self._codegen._function_pass_manager(opt=1)
        passes, *builder = found if isinstance(found, tuple) else (found,)  # alone up to numba 0.61
        for function in defined:
            passes.run(function, *builder)

    def _optimize_final_module(self) -> None:
        if not self.is_part:
            super()._optimize_final_module()
            return
        light = {"loop_vectorize": False, "slp_vectorize": False, "opt": 0, "cost": "cheap"}  # numba's own first step
        found = self._codegen._module_pass_manager(**light)
        passes, *builder = found if isinstance(found, tuple) else (found,)
        passes.run(self._final_module, *builder)

    def _finalize_final_module(self) -> None:
        if self.is_part:
            self._finalize_dynamic_globals()
            self._finalized = True
        else:
            super()._finalize_final_module()

    def _get_compiled_object(self) -> Any:
        return b"" if self.is_part else super()._get_compiled_object()

    def serialize_using_object_code(self) -> Any:
        """Return what the cache keeps: name, kind, content."""
        if not self.is_entry:
            return super().serialize_using_object_code()
        self._ensure_finalized()
        defined = (*self._final_module.functions, *self._final_module.global_variables)
        names = frozenset(symbol.name for symbol in defined if not symbol.is_declaration)
        return self.name, _ENTRY, (self._get_compiled_object(), names)

    @classmethod
    def _unserialize(cls, codegen: Any, state: tuple[str, str, Any]) -> Any:
        name, kind, content = state
        if kind != _ENTRY:
            return super()._unserialize(codegen, state)
        found = codegen.create_library(name)
        found.enable_object_caching()
        code, names = content
        found._set_compiled_object(code)
        found._finalize_final_module()
        codegen._engine._defined_symbols |= names
        return found


class Codegen(JITCPUCodegen):  # type: ignore[misc]
    """Numba's compiler, with libraries as above."""

    _library_class = Library

    def set_env(self, env_name: str, env: Any) -> None:
        """Tell the machine code of a function its environment; a part has none."""
        if self._engine.get_global_value_address(env_name):
            super().set_env(env_name, env)


cpu_target.target_context.codegen().__class__ = Codegen
remember()


_COLLECTED_AFTER = 100_000  # new objects; Python's own number is 700 or 2,000


@contextmanager
def _seldom_collected() -> Iterator[None]:
    """Let Python look for garbage less often: nearly all that the compiler holds is in use, and to go through it again
    and again is a tenth of its time.
    """
    usual = gc.get_threshold()
    gc.set_threshold(_COLLECTED_AFTER, *usual[1:])
    try:
        yield
    finally:
        gc.set_threshold(*usual)


class Kernel(CPUDispatcher):  # type: ignore[misc]  # numba tells no types
    """A kernel that other kernels call by its twin `inner`, which has no entry for Python.

    The entry unpacks and checks every array of every record among the arguments: a third of what there is to compile of
    a small function that takes the records of a flight. Only a kernel that Python calls gets one, by that call.
    """

    inner: Any

    def compile(self, sig: Any) -> Any:
        """Compile for a signature, and all that it calls, or load it from the cache."""
        with _seldom_collected():
            return super().compile(sig)

    @property
    def _numba_type_(self) -> Any:
        """What a kernel that names this one sees: its twin."""
        return numba.types.Dispatcher(self.inner)


class Part(CPUDispatcher):  # type: ignore[misc]
    """A kernel as other kernels call it: a number that a call states, as an axis or a column, makes no version of its
    own. The compiler of machine code sees such numbers where it inlines.
    """

    def compile(self, sig: Any) -> Any:
        """Compile for a signature or load it from the cache; numba asks many times for each."""
        found = self.overloads.get(sig) if isinstance(sig, tuple) else None
        return super().compile(sig) if found is None else found.entry_point

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return the version for types of arguments, literal ones as their kind."""
        return super().get_call_template(tuple(map(numba.types.unliteral, args)), kws)


def compiled(function: Callable[..., Any], how: dict[str, Any]) -> Callable[..., Any]:
    """Return a kernel for Python, with its twin for kernels; how: numba's options."""
    how = how | {"pipeline_class": Compiler, "no_cfunc_wrapper": True}
    twin = FunctionType(
        function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
    )
    twin.__module__, twin.__qualname__ = function.__module__, f"{function.__qualname__}{_PART}"  # another cache file
    kernel = numba.njit(**how)(function)
    kernel.__class__ = Kernel
    kernel.inner = numba.njit(**how, no_cpython_wrapper=True)(twin)
    kernel.inner.__class__ = Part
    kernel._cache, kernel.inner._cache = KernelCache(function), KernelCache(twin)
    return kernel
