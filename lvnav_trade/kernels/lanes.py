"""f64x8: eight runs, or eight error sources, in one value, so that a kernel written for one steps eight.

A kernel is written for one run, in plain indexing: ``P[i, j] = P[i, j] - gain * K[j]``. With float64 arrays it
processes one run. With views, made by `view` of arrays whose last axis has `WIDTH` runs, it processes eight. The source
must be *lane-clean*: no branch on a value that differs between runs (use `where`), and accumulators that start from
`number_like`.

The lane types are numba extension types on LLVM vectors; LLVM splits them on processors with narrower vectors. With
``NUMBA_DISABLE_JIT=1`` only the one-run form exists, and every name here is an ordinary Python function.

Gains and transition matrices are the same for all sources, so one kernel processes eight of them. With
`NUMBA_DISABLE_JIT=1` a group has one source.
"""

import math
import operator
from collections.abc import Mapping
from typing import Any

import numpy as np
from llvmlite import ir
from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic, lower_builtin, overload, overload_attribute, type_callable
from numpy.typing import NDArray

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.vector import WIDTH, Lane, LaneView, as_vector, f64x8, mask8, u64x8

LINE = 64  # bytes of a cache line
sqrt, magnitude = math.sqrt, abs

# ---------------------------------------------------------------------------------------------- views


def aligned_zeros(shape: tuple[int, ...], dtype: type = np.float64) -> np.ndarray:
    """Return zeros aligned to a cache line. A line has the eight runs of one value; unaligned lanes take two loads."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    room = np.zeros(size + LINE, dtype=np.uint8)
    start = -room.ctypes.data % LINE
    return room[start : start + size].view(dtype).reshape(shape)


def zeros_of(shapes: Mapping[str, tuple[int, ...]], lanes: int = 0) -> dict[str, np.ndarray]:
    """Return zeros by name for given shapes: one run, or `lanes` runs on an additional last axis."""
    end = (lanes,) if lanes else ()
    return {name: aligned_zeros((*shape, *end)) for name, shape in shapes.items()}


def _view_type(source_type):
    """Return the numba type of the view of an array or record; other types have no view and stay."""
    if isinstance(source_type, types.Array):
        item = f64x8 if source_type.dtype == types.float64 else u64x8
        return LaneView(item, source_type.ndim - 1)
    if isinstance(source_type, types.BaseNamedTuple):
        field_types = [_view_type(field) for field in source_type.types]
        return types.BaseTuple.from_types(field_types, source_type.instance_class)
    return source_type


def _has_view(source_type):
    if isinstance(source_type, types.BaseNamedTuple):
        return all(_has_view(field) for field in source_type.types)
    if isinstance(source_type, types.Array):
        return source_type.layout == "C" and source_type.dtype in (types.float64, types.uint64)
    return source_type == types.none


def _emit_view(context, builder, source_type, value):
    if isinstance(source_type, types.Array):
        source = context.make_array(source_type)(context, builder, value)
        target = _proxy(context, builder, _view_type(source_type))
        target.data = source.data
        target.shape = cgutils.pack_array(builder, cgutils.unpack_tuple(builder, source.shape)[:-1])
        return target._getvalue()
    if isinstance(source_type, types.BaseNamedTuple):
        fields = cgutils.unpack_tuple(builder, value, len(source_type.types))
        views = []
        for field_type, field in zip(source_type.types, fields, strict=True):
            views.append(_emit_view(context, builder, field_type, field))
        return context.make_tuple(builder, _view_type(source_type), views)
    return value


@intrinsic
def _make_view(typingctx, source):
    def codegen(context, builder, sig, args):
        return _emit_view(context, builder, source, args[0])

    return _view_type(source)(source), codegen


def view(source):
    """Return the lane view of a C-contiguous array (..., 8), preferably from `aligned_zeros`.

    The view does not own its memory: the caller keeps the array alive. For a record (NamedTuple) the result is the
    record of the views of its fields; None stays None.
    """
    raise NotImplementedError("lanes exist in compiled code only")


@overload(view)
def _view(source):
    return (lambda source: _make_view(source)) if _has_view(source) else None


def _proxy(context, builder, lane_view, value=None):
    return cgutils.create_struct_proxy(lane_view)(context, builder, value=value)


def _locate(context, builder, lane_view, value, index_type, index):
    """Return a view's pointer to the lanes at an index, and the remaining shape (empty if the index is complete).

    With NUMBA_BOUNDSCHECK=1 an index outside the view raises IndexError.
    """
    proxy = _proxy(context, builder, lane_view, value)
    shape = cgutils.unpack_tuple(builder, proxy.shape)
    index_components = [index]
    component_types = [index_type]
    if isinstance(index_type, types.BaseTuple):
        index_components = cgutils.unpack_tuple(builder, index)
        component_types = index_type.types
    indices = []
    for index_component, component_type in zip(index_components, component_types, strict=True):
        indices.append(context.cast(builder, index_component, component_type, types.intp))
    if context.enable_boundscheck:
        for axis, axis_index in enumerate(indices):
            cgutils.do_boundscheck(context, builder, axis_index, shape[axis], axis)
    zero = ir.Constant(ir.IntType(64), 0)
    width = ir.Constant(ir.IntType(64), WIDTH)
    offset = indices[0]
    for axis in range(1, len(shape)):
        axis_index = indices[axis] if axis < len(indices) else zero
        offset = builder.add(builder.mul(offset, shape[axis]), axis_index)
    return builder.gep(proxy.data, [builder.mul(offset, width)]), shape[len(indices) :]


def _index_count(index):
    return len(index.types) if isinstance(index, types.BaseTuple) else 1


@type_callable(operator.getitem)
def _element_type(context):
    def element(v, index):
        if not isinstance(v, LaneView) or not 0 < _index_count(index) <= v.ndim:
            return None
        ndim = v.ndim - _index_count(index)
        return LaneView(v.item, ndim) if ndim else v.item

    return element


@lower_builtin(operator.getitem, LaneView, types.Integer)
@lower_builtin(operator.getitem, LaneView, types.BaseTuple)
def _get(context, builder, sig, args):
    data, shape = _locate(context, builder, sig.args[0], args[0], sig.args[1], args[1])
    if shape:
        target = _proxy(context, builder, sig.return_type)
        target.data = data
        target.shape = cgutils.pack_array(builder, shape)
        return target._getvalue()
    value = builder.load(builder.bitcast(data, context.get_value_type(sig.return_type).as_pointer()))
    value.align = 8
    return value


@type_callable(operator.setitem)
def _assignment_type(context):
    def assignment(v, index, value):
        if not isinstance(v, LaneView) or _index_count(index) != v.ndim:
            return None
        return types.none if value == v.item or isinstance(value, v.item.numbers) else None

    return assignment


@lower_builtin(operator.setitem, LaneView, types.Integer, types.Any)
@lower_builtin(operator.setitem, LaneView, types.BaseTuple, types.Any)
def _set(context, builder, sig, args):
    lane_view, index_type, value_type = sig.args
    data, _ = _locate(context, builder, lane_view, args[0], index_type, args[1])
    vector = as_vector(context, builder, value_type, args[2], lane_view.item)
    builder.store(vector, builder.bitcast(data, vector.type.as_pointer())).align = 8
    return context.get_dummy_value()


@intrinsic
def _view_shape(typingctx, lane_view):
    def codegen(context, builder, sig, args):
        return _proxy(context, builder, lane_view, args[0]).shape

    return types.UniTuple(types.intp, lane_view.ndim)(lane_view), codegen


@overload_attribute(LaneView, "shape")
def _shape(v):
    return lambda v: _view_shape(v)


# ------------------------------------------------------------------------------------- named functions


@intrinsic
def _select(typingctx, condition, a, b):
    lane = f64x8
    if isinstance(a, Lane):
        lane = a
    elif isinstance(b, Lane):
        lane = b

    def codegen(context, builder, sig, args):
        first = as_vector(context, builder, sig.args[1], args[1], lane)
        second = as_vector(context, builder, sig.args[2], args[2], lane)
        return builder.select(args[0], first, second)

    return lane(condition, a, b), codegen


def where(condition, a, b):
    """Return `a` in the runs where the condition is true, `b` in the others."""
    return a if condition else b


@overload(where)
def _where(condition, a, b):
    if condition == mask8:
        return lambda condition, a, b: _select(condition, a, b)
    return lambda condition, a, b: a if condition else b


def _lane_constant(lane):
    @intrinsic
    def eight_times(typingctx, number):
        def codegen(context, builder, sig, args):
            return as_vector(context, builder, number, args[0], lane)

        return lane(number), codegen

    return eight_times


_eight_floats, _eight_words = _lane_constant(f64x8), _lane_constant(u64x8)


def number_like(x, number):
    """Return a number with the type of `x`, one float or eight lanes; the initial value of an accumulator."""
    return float(number)


@overload(number_like)
def _number_like(x, number):
    if isinstance(x, Lane):
        return lambda x, number: _eight_floats(number)
    return lambda x, number: float(number)


def word_like(x, number):
    """Return an unsigned word with the type of the word `x`, one or eight lanes."""
    return np.uint64(number)


@overload(word_like)
def _word_like(x, number):
    if x == u64x8:
        return lambda x, number: _eight_words(number)
    return lambda x, number: np.uint64(number)


def bits(x):
    """Return the 64 bits of a float64 as a word."""
    return np.float64(x).view(np.uint64)


def from_bits(word):
    """Return the float64 that has these 64 bits."""
    return np.uint64(word).view(np.float64)


def to_float(word):
    """Return a word's value as float64, rounded to nearest."""
    return float(word)


def _convert(function, source, target, instruction):
    """Implement a conversion function for numba by one LLVM instruction, for a lane and for one number."""

    @intrinsic
    def convert(typingctx, a):
        def codegen(context, builder, sig, args):
            return getattr(builder, instruction)(args[0], context.get_value_type(sig.return_type))

        return (target(source) if a == source else target.scalar(source.scalar)), codegen

    @overload(function)
    def dispatch(a):
        return lambda a: convert(a)


_convert(bits, f64x8, u64x8, "bitcast")
_convert(from_bits, u64x8, f64x8, "bitcast")
_convert(to_float, u64x8, f64x8, "uitofp")


GROUP = 1 if config.DISABLE_JIT else WIDTH
"""Number of sources in a group."""


def grouped_zeros(shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return zeros of the given shape, with the lanes of a group as an additional last axis."""
    return aligned_zeros((*shape, GROUP))


def group_view(array: Any) -> Any:
    """Return an array of one group, as lanes."""
    return array[..., 0]


@overload(group_view)
def _group_view(array):
    return lambda array: view(array)


@jit
def group(array: Any, index: Any) -> Any:
    """Return one group of sources, as lanes."""
    return group_view(array[index])


@jit
def lane_total(array: Any) -> Any:
    """Return the sum of an array (1, n_lane) over its lanes."""
    total = 0.0
    for lane in range(array.shape[1]):
        total += array[0, lane]
    return total
