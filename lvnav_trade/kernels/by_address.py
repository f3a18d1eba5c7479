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

    def value(self, builder: Any, llvm_type: Any) -> Any:
        """Return the record, with its location attached."""
        record = builder.load(builder.bitcast(self.pointer(builder), llvm_type.as_pointer()))
        record.place = self
        return record

    def field(self, builder: Any, struct: Any, index: int) -> Any:
        """Return a field of the record (an LLVM struct), read at the beginning of the function."""
        if index not in self.fields:
            place = _Address(self.address, self.offset + _offsets(struct)[index])
            with builder.goto_entry_block():
                self.fields[index] = place.value(builder, struct.elements[index])
        return self.fields[index]


@cache
def _offsets(struct: Any) -> list[int]:
    """Return the offsets (bytes) of the fields of an LLVM struct."""
    target_data = cpu_target.target_context.codegen().target_data
    context = ir.Context()
    return [struct.get_element_offset(target_data, index, context) for index in range(len(struct.elements))]


class RecordModel(TupleModel):  # type: ignore[misc]  # numba publishes no types
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
            copy = builder.alloca(value.type)
        builder.store(value, copy)
        return builder.bitcast(copy, _BYTE.as_pointer())

    def from_argument(self, builder: Any, value: Any) -> Any:
        """Return the record at an address."""
        return _Address(value, 0).value(builder, self.get_value_type())


def _record_model(plain_model: Any) -> Any:
    """Return a factory of data models: `RecordModel` for records of this package, `plain_model` for others."""

    def model(manager: Any, record_type: Any) -> Any:
        package, _, _ = record_type.instance_class.__module__.partition(".")
        if package == PACKAGE:
            return RecordModel(manager, record_type)
        return plain_model(manager, record_type)

    return model


@lower_getattr_generic(types.NamedTuple)  # type: ignore[untyped-decorator]
def _field(context: Any, builder: Any, record_type: Any, value: Any, name: str) -> Any:
    index = record_type.fields.index(name)
    place = getattr(value, "place", None)
    if place is None:
        field = builder.extract_value(value, index)
    else:
        field = place.field(builder, value.type, index)
    return impl_ret_borrowed(context, builder, record_type[index], field)


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
        n_assigned: dict[str, int] = {}
        for block in self.blocks.values():
            for assignment in block.find_insts(Assign):
                name = assignment.target.name
                n_assigned[name] = n_assigned.get(name, 0) + 1
        in_memory = must_use_alloca(self.blocks)
        self._singly_assigned_vars |= {name for name, n in n_assigned.items() if n == 1 and name not in in_memory}

    def loadvar(self, name: str) -> Any:
        """Return the value of a variable. A variable that is read before the block of its assignment needs memory."""
        if name not in self._blk_local_varmap:
            self._singly_assigned_vars.discard(name)
        return super().loadvar(name)

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        """Return an element of an array, without the copy of the array and the operator lookup of numba."""
        array, index_type = signature.args
        if not self._is_element(array, index_type):
            return super().lower_getitem(resty, expr, value, index, signature)
        pointer = self._pointer(array, value.name, index_type, index.name)
        alignment = None if array.aligned else 1
        element = self.context.unpack_value(self.builder, array.dtype, pointer, align=alignment)
        return self.context.cast(self.builder, element, signature.return_type, resty)

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        """Set an element of an array."""
        array, index_type, value_type = signature.args
        if not self._is_element(array, index_type) or not isinstance(value_type, types.Number | types.Boolean):
            return super().lower_setitem(target_var, index_var, value_var, signature)
        pointer = self._pointer(array, target_var.name, index_type, index_var.name)
        value = self.loadvar(value_var.name)
        value = self.context.cast(self.builder, value, self.typeof(value_var.name), value_type)
        value = self.context.cast(self.builder, value, value_type, array.dtype)
        alignment = None if array.aligned else 1
        self.context.pack_value(self.builder, array.dtype, value, pointer, align=alignment)
        return None

    def _is_element(self, array: Any, index_type: Any) -> bool:
        """Return whether an index selects one number of an array."""
        if self.context.enable_boundscheck:
            return False
        if not isinstance(array, types.Array) or not isinstance(array.dtype, types.Number | types.Boolean):
            return False
        index_types = tuple(index_type) if isinstance(index_type, types.BaseTuple) else (index_type,)
        return len(index_types) == array.ndim and all(isinstance(item, types.Integer) for item in index_types)

    def _pointer(self, array: Any, name: str, index_type: Any, index_name: str) -> Any:
        """Return the address of an element; a negative index counts from the end."""
        builder = self.builder
        model = self.context.data_model_manager[array]
        value = self.loadvar(name)
        index = self.context.cast(builder, self.loadvar(index_name), self.typeof(index_name), index_type)
        shape = cgutils.unpack_tuple(builder, model.get(builder, value, "shape"), array.ndim)
        index_types = (index_type,)
        indices = [index]
        if isinstance(index_type, types.BaseTuple):
            index_types = tuple(index_type)
            indices = cgutils.unpack_tuple(builder, index, array.ndim)
        places = []
        for axis_type, axis_index, size in zip(index_types, indices, shape, strict=True):
            places.append(fix_integer_index(self.context, builder, axis_type, axis_index, size))
        strides = []
        if array.layout != "C":
            strides = cgutils.unpack_tuple(builder, model.get(builder, value, "strides"), array.ndim)
        data = model.get(builder, value, "data")
        return cgutils.get_item_pointer2(self.context, builder, data, shape, strides, array.layout, places)


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
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes = []
        for compiler_pass, description in pipeline.passes:
            passes.append((_Lowering if compiler_pass is NativeLowering else compiler_pass, description))
        pipeline.passes = passes
        pipeline.finalize()
        return [pipeline]


default_manager.register(types.NamedTuple, _record_model(TupleModel))
