"""Records are passed from kernel to kernel by address.

Numba passes each of the hundreds of fields of a record as an argument. Unpacking records before every call and packing
them again after it was more than half of the compilation. A record (NamedTuple of this package) never changes, so the
kernel that creates it stores it on its stack, and called kernels read it there: each field once, at their beginning. A
record within a record is passed by its own address.
"""

from functools import cache
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.analysis import must_use_alloca
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.datamodel import default_manager
from numba.core.datamodel.models import TupleModel
from numba.core.imputils import impl_ret_borrowed, lower_getattr_generic
from numba.core.ir import Assign
from numba.core.lowering import Lower
from numba.core.registry import cpu_target
from numba.core.typed_passes import BaseNativeLowering, NativeLowering
from numba.np.arrayobj import fix_integer_index

PACKAGE = __name__.partition(".")[0]
_BYTE, _WORD = ir.IntType(8), ir.IntType(64)


class _Address:
    """Location of a record: an address and an offset in bytes, with the fields already read from there."""

    def __init__(self, address: Any, offset: int) -> None:
        self.address, self.offset = address, offset
        self.fields: dict[int, Any] = {}

    def pointer(self, builder: Any) -> Any:
        """Return the record's address."""
        return builder.gep(self.address, [ir.Constant(_WORD, self.offset)]) if self.offset else self.address

    def value(self, builder: Any, kind: Any) -> Any:
        """Return the record, with its location attached."""
        found = builder.load(builder.bitcast(self.pointer(builder), kind.as_pointer()))
        found.place = self
        return found

    def field(self, builder: Any, kind: Any, index: int) -> Any:
        """Return a field of the record (an LLVM struct), read at the beginning of the function."""
        if index not in self.fields:
            inner, place = kind.elements[index], _Address(self.address, self.offset + _offsets(kind)[index])
            with builder.goto_entry_block():
                self.fields[index] = place.value(builder, inner)
        return self.fields[index]


@cache
def _offsets(kind: Any) -> list[int]:
    """Return the offsets (bytes) of the fields of an LLVM struct."""
    data, context = cpu_target.target_context.codegen().target_data, ir.Context()
    return [kind.get_element_offset(data, index, context) for index in range(len(kind.elements))]


class RecordModel(TupleModel):  # type: ignore[misc]  # numba tells no types
    """Data model of a record of this package: passed by address."""

    def get_argument_type(self) -> Any:
        """Return the type of an address."""
        return _BYTE.as_pointer()

    def as_argument(self, builder: Any, value: Any) -> Any:
        """Return the address of a record: its location, or a copy on the stack of this function."""
        place = getattr(value, "place", None)
        if place is not None:
            return place.pointer(builder)
        with builder.goto_entry_block():
            kept = builder.alloca(value.type)
        builder.store(value, kept)
        return builder.bitcast(kept, _BYTE.as_pointer())

    def from_argument(self, builder: Any, value: Any) -> Any:
        """Return the record at an address."""
        return _Address(value, 0).value(builder, self.get_value_type())


def _model_of(plain: Any) -> Any:
    def made(manager: Any, kind: Any) -> Any:
        is_ours = kind.instance_class.__module__.partition(".")[0] == PACKAGE
        return (RecordModel if is_ours else plain)(manager, kind)

    return made


@lower_getattr_generic(types.NamedTuple)  # type: ignore[untyped-decorator]
def _field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    index, place = kind.fields.index(name), getattr(value, "place", None)
    found = builder.extract_value(value, index) if place is None else place.field(builder, value.type, index)
    return impl_ret_borrowed(context, builder, kind[index], found)


class _Lower(Lower):  # type: ignore[misc]
    """Numba's generator of intermediate code, with fewer memory accesses.

    A variable that is assigned once is a value and needs no memory, unless references are counted.
    """

    def _find_singly_assigned_variable(self) -> None:
        super()._find_singly_assigned_variable()
        if self.context.enable_nrt:  # reference counting needs the variable in memory
            return
        if self.flags is None or not self.flags.enable_ssa or self.func_ir.func_id.is_generator:
            return
        number: dict[str, int] = {}
        for block in self.blocks.values():
            for assignment in block.find_insts(Assign):
                number[assignment.target.name] = number.get(assignment.target.name, 0) + 1
        kept = must_use_alloca(self.blocks)
        self._singly_assigned_vars |= {name for name, times in number.items() if times == 1 and name not in kept}

    def loadvar(self, name: str) -> Any:
        """Return the value of a variable. A variable that is read before the block of its assignment needs memory."""
        if name not in self._blk_local_varmap:
            self._singly_assigned_vars.discard(name)
        return super().loadvar(name)

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        """Return an element of an array, without the copy of the array and the operator lookup of numba."""
        array, at = signature.args
        if not self._is_element(array, at):
            return super().lower_getitem(resty, expr, value, index, signature)
        pointer = self._pointer(array, value.name, at, index.name)
        found = self.context.unpack_value(self.builder, array.dtype, pointer, align=None if array.aligned else 1)
        return self.context.cast(self.builder, found, signature.return_type, resty)

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        """Set an element of an array."""
        array, at, kind = signature.args
        if not self._is_element(array, at) or not isinstance(kind, types.Number | types.Boolean):
            return super().lower_setitem(target_var, index_var, value_var, signature)
        pointer = self._pointer(array, target_var.name, at, index_var.name)
        value = self.context.cast(self.builder, self.loadvar(value_var.name), self.typeof(value_var.name), kind)
        value = self.context.cast(self.builder, value, kind, array.dtype)
        self.context.pack_value(self.builder, array.dtype, value, pointer, align=None if array.aligned else 1)
        return None

    def _is_element(self, array: Any, at: Any) -> bool:
        """Return whether an index selects one number of an array."""
        if not isinstance(array, types.Array) or not isinstance(array.dtype, types.Number | types.Boolean):
            return False
        kinds = tuple(at) if isinstance(at, types.BaseTuple) else (at,)
        is_checked = self.context.enable_boundscheck
        return len(kinds) == array.ndim and all(isinstance(one, types.Integer) for one in kinds) and not is_checked

    def _pointer(self, array: Any, name: str, at: Any, index: str) -> Any:
        """Return the address of an element; a negative index counts from the end."""
        builder, model = self.builder, self.context.data_model_manager[array]
        given, asked = self.loadvar(name), self.context.cast(builder, self.loadvar(index), self.typeof(index), at)
        shape = cgutils.unpack_tuple(builder, model.get(builder, given, "shape"), array.ndim)
        kinds, parts = (at,), [asked]
        if isinstance(at, types.BaseTuple):
            kinds, parts = tuple(at), cgutils.unpack_tuple(builder, asked, array.ndim)
        places = [fix_integer_index(self.context, builder, *one) for one in zip(kinds, parts, shape, strict=True)]
        strides = (
            []
            if array.layout == "C"
            else cgutils.unpack_tuple(builder, model.get(builder, given, "strides"), array.ndim)
        )
        return cgutils.get_item_pointer2(
            self.context, builder, model.get(builder, given, "data"), shape, strides, array.layout, places
        )


@register_pass(mutates_CFG=True, analysis_only=False)
class _Lowering(BaseNativeLowering):  # type: ignore[misc]
    _name = "lowering_of_records"

    @property
    def lowering_class(self) -> type:
        return _Lower


class Compiler(CompilerBase):  # type: ignore[misc]
    """Numba's compiler with the code generator above."""

    def define_pipelines(self) -> list[Any]:
        """Return numba's passes with the last one replaced."""
        found = DefaultPassBuilder.define_nopython_pipeline(self.state)
        found.passes = [(_Lowering if one is NativeLowering else one, why) for one, why in found.passes]
        found.finalize()
        return [found]


default_manager.register(types.NamedTuple, _model_of(TupleModel))
