"""f64x8: eight runs in one value, so that a kernel written for one run steps eight.

A kernel is written for one run, in plain indexing: ``P[i, j] = P[i, j] - gain * K[j]``. Given float64 arrays it
steps one run; given views made by `view` of arrays whose last axis has `WIDTH` runs it steps eight at once. The
source must be *lane-clean*: no branch on a value that differs between runs (use `where`), accumulators that start
from `like`.

The lane types are numba extension types on LLVM vectors; LLVM splits them where the processor is narrower. With
``NUMBA_DISABLE_JIT=1`` only the one-run form exists, and every name here is an ordinary Python function.
"""

from __future__ import annotations

import math
import operator

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload

from lvnav_trade.kernels.vector import (
    DOUBLES,
    FLAGS,
    WIDTH,
    WORDS,
    LaneView,
    Mask8,
    U64x8,
    f64x8,
    is_lane,
    is_number,
    mask8,
    splat,
    splat_word,
    u64x8,
)

LINE = 64  # bytes of a cache line

# ---------------------------------------------------------------------------------------------- views


def aligned_zeros(shape: tuple[int, ...], dtype: type = np.float64) -> np.ndarray:
    """Return zeros that begin where a cache line does: a line holds the eight runs of a value, and lanes across
    two lines take two loads.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    room = np.zeros(size + LINE, dtype=np.uint8)
    start = -room.ctypes.data % LINE
    return room[start : start + size].view(dtype).reshape(shape)


@intrinsic
def _make_view(typingctx, array):
    item = f64x8 if array.dtype == types.float64 else u64x8
    lane_view = LaneView(item, array.ndim - 1)

    def codegen(context, builder, sig, args):
        source = context.make_array(array)(context, builder, args[0])
        target = cgutils.create_struct_proxy(lane_view)(context, builder)
        target.data = source.data
        shape = cgutils.unpack_tuple(builder, source.shape)
        for axis in range(lane_view.ndim):
            setattr(target, f"n{axis}", shape[axis])
        return target._getvalue()

    return lane_view(array), codegen


def view(array):
    """Return the lane view of a C-contiguous array (..., 8), best of `aligned_zeros`; the caller keeps it alive."""
    raise NotImplementedError("lanes exist in compiled code only")


@overload(view)
def _view(array):
    if isinstance(array, types.Array) and array.layout == "C" and array.dtype in (types.float64, types.uint64):
        return lambda array: _make_view(array)
    return None


def _offset(builder, proxy, indices):
    """Return the element offset of the lanes at `indices` (fewer than all: the start of a sub-view)."""
    width = ir.Constant(ir.IntType(64), WIDTH)
    total = None
    for axis in range(proxy._fe_type.ndim):
        index = indices[axis] if axis < len(indices) else ir.Constant(ir.IntType(64), 0)
        total = index if axis == 0 else builder.add(builder.mul(total, getattr(proxy, f"n{axis}")), index)
    return builder.mul(total, width)


def _indices(context, builder, proxy, kind, value):
    """Return the indices as integers; with NUMBA_BOUNDSCHECK=1 one outside the view raises IndexError."""
    if isinstance(kind, types.BaseTuple):
        parts = cgutils.unpack_tuple(builder, value)
        found = [context.cast(builder, p, k, types.intp) for p, k in zip(parts, kind.types, strict=True)]
    else:
        found = [context.cast(builder, value, kind, types.intp)]
    if context.enable_boundscheck:
        for axis, index in enumerate(found):
            cgutils.do_boundscheck(context, builder, index, getattr(proxy, f"n{axis}"), axis)
    return found


def _lane_pointer(context, builder, lane_view, view_value, index_kind, index_value):
    proxy = cgutils.create_struct_proxy(lane_view)(context, builder, value=view_value)
    offset = _offset(builder, proxy, _indices(context, builder, proxy, index_kind, index_value))
    vector = DOUBLES if lane_view.item is f64x8 else WORDS
    return builder.bitcast(builder.gep(proxy.data, [offset]), vector.as_pointer())


@intrinsic
def _load(typingctx, lane_view, index):
    def codegen(context, builder, sig, args):
        value = builder.load(_lane_pointer(context, builder, sig.args[0], args[0], sig.args[1], args[1]))
        value.align = 8
        return value

    return lane_view.item(lane_view, index), codegen


@intrinsic
def _store(typingctx, lane_view, index, value):
    def codegen(context, builder, sig, args):
        pointer = _lane_pointer(context, builder, sig.args[0], args[0], sig.args[1], args[1])
        builder.store(args[2], pointer).align = 8
        return context.get_dummy_value()

    return types.void(lane_view, index, value), codegen


@intrinsic
def _sub_view(typingctx, lane_view, index):
    smaller = LaneView(lane_view.item, lane_view.ndim - 1)

    def codegen(context, builder, sig, args):
        proxy = cgutils.create_struct_proxy(lane_view)(context, builder, value=args[0])
        offset = _offset(builder, proxy, _indices(context, builder, proxy, sig.args[1], args[1]))
        target = cgutils.create_struct_proxy(smaller)(context, builder)
        target.data = builder.gep(proxy.data, [offset])
        for axis in range(smaller.ndim):
            setattr(target, f"n{axis}", getattr(proxy, f"n{axis + 1}"))
        return target._getvalue()

    return smaller(lane_view, index), codegen


@intrinsic
def _view_shape(typingctx, lane_view):
    def codegen(context, builder, sig, args):
        proxy = cgutils.create_struct_proxy(lane_view)(context, builder, value=args[0])
        sizes = [getattr(proxy, f"n{axis}") for axis in range(lane_view.ndim)]
        return context.make_tuple(builder, sig.return_type, sizes)

    return types.UniTuple(types.intp, lane_view.ndim)(lane_view), codegen


def _index_count(index):
    return len(index.types) if isinstance(index, types.BaseTuple) else 1


@overload(operator.getitem)
def _getitem(v, index):
    if not isinstance(v, LaneView):
        return None
    if _index_count(index) == v.ndim:
        return lambda v, index: _load(v, index)
    if _index_count(index) == 1:
        return lambda v, index: _sub_view(v, index)
    return None


@overload(operator.setitem)
def _setitem(v, index, value):
    if not isinstance(v, LaneView) or _index_count(index) != v.ndim:
        return None
    if value is v.item:
        return lambda v, index, value: _store(v, index, value)
    if v.item is f64x8 and is_number(value):
        return lambda v, index, value: _store(v, index, splat(float(value)))
    return None


def size(array, axis):
    """Return the length of an axis of an array or view."""
    return array.shape[axis]


@overload(size)
def _size(array, axis):
    if isinstance(array, LaneView):
        return lambda array, axis: _view_shape(array)[axis]
    return lambda array, axis: array.shape[axis]


# ------------------------------------------------------------------------------------- named functions


@intrinsic
def _select(typingctx, mask, a, b):
    def codegen(context, builder, sig, args):
        return builder.select(*args)

    return a(mask8, a, b), codegen


def where(condition, a, b):
    """Return `a` in the runs where the condition holds, `b` in the others."""
    return a if condition else b


@overload(where)
def _where(condition, a, b):
    if isinstance(condition, Mask8):
        if is_lane(a) and is_number(b):
            return lambda condition, a, b: _select(condition, a, splat(float(b)))
        if is_number(a) and is_lane(b):
            return lambda condition, a, b: _select(condition, splat(float(a)), b)
        if is_number(a) and is_number(b):
            return lambda condition, a, b: _select(condition, splat(float(a)), splat(float(b)))
        return lambda condition, a, b: _select(condition, a, b)
    return lambda condition, a, b: a if condition else b


def _vector_intrinsic(name):
    @intrinsic
    def call(typingctx, a):
        def codegen(context, builder, sig, args):
            signature = ir.FunctionType(DOUBLES, [DOUBLES])
            function = cgutils.get_or_insert_function(builder.module, signature, f"{name}.v{WIDTH}f64")
            return builder.call(function, [args[0]])

        return f64x8(f64x8), codegen

    return call


_vector_sqrt, _vector_abs = _vector_intrinsic("llvm.sqrt"), _vector_intrinsic("llvm.fabs")


def sqrt(x):
    """Return the square root."""
    return math.sqrt(x)


@overload(sqrt)
def _sqrt(x):
    if is_lane(x):
        return lambda x: _vector_sqrt(x)
    return lambda x: math.sqrt(x)


def magnitude(x):
    """Return the absolute value."""
    return abs(x)


@overload(magnitude)
def _magnitude(x):
    if is_lane(x):
        return lambda x: _vector_abs(x)
    return lambda x: abs(x)


def _reduction(function, name):
    @intrinsic
    def reduce(typingctx, mask):
        def codegen(context, builder, sig, args):
            signature = ir.FunctionType(ir.IntType(1), [FLAGS])
            reducer = cgutils.get_or_insert_function(builder.module, signature, f"{name}.v{WIDTH}i1")
            return builder.call(reducer, [args[0]])

        return types.boolean(mask8), codegen

    @overload(function)
    def dispatch(mask):
        if isinstance(mask, Mask8):
            return lambda mask: reduce(mask)
        return lambda mask: mask


def any_of(mask):
    """Say whether the condition holds in any of the runs."""
    return mask


def all_of(mask):
    """Say whether the condition holds in all runs."""
    return mask


_reduction(any_of, "llvm.vector.reduce.or")
_reduction(all_of, "llvm.vector.reduce.and")


def like(x, number):
    """Return a number in the form of `x`: how an accumulator starts."""
    return float(number)


@overload(like)
def _like(x, number):
    if is_lane(x) or isinstance(x, U64x8):
        return lambda x, number: splat(float(number))
    return lambda x, number: float(number)


def word_like(x, number):
    """Return an unsigned word in the form of the word `x`."""
    return np.uint64(number)


@overload(word_like)
def _word_like(x, number):
    if isinstance(x, U64x8):
        return lambda x, number: splat_word(np.uint64(number))
    return lambda x, number: np.uint64(number)


def _conversion(function, source_lane, target_lane, source, target, vector_cast, scalar_cast):
    @intrinsic
    def convert_lanes(typingctx, a):
        def codegen(context, builder, sig, args):
            return vector_cast(builder, args[0])

        return target_lane(source_lane), codegen

    @intrinsic
    def convert_one(typingctx, a):
        def codegen(context, builder, sig, args):
            return scalar_cast(builder, args[0])

        return target(source), codegen

    @overload(function)
    def dispatch(a):
        if a is source_lane:
            return lambda a: convert_lanes(a)
        return lambda a: convert_one(a)


def bits(x):
    """Return the 64 bits of a float64 as a word."""
    return np.float64(x).view(np.uint64)


def from_bits(word):
    """Return the float64 that has these 64 bits."""
    return np.uint64(word).view(np.float64)


def to_float(word):
    """Return a word's value as float64, rounded to nearest."""
    return float(word)


_DOUBLE, _WORD = ir.DoubleType(), ir.IntType(64)
_conversion(
    bits, f64x8, u64x8, types.float64, types.uint64, lambda b, a: b.bitcast(a, WORDS), lambda b, a: b.bitcast(a, _WORD)
)
_conversion(
    from_bits,
    u64x8,
    f64x8,
    types.uint64,
    types.float64,
    lambda b, a: b.bitcast(a, DOUBLES),
    lambda b, a: b.bitcast(a, _DOUBLE),
)
_conversion(
    to_float,
    u64x8,
    f64x8,
    types.uint64,
    types.float64,
    lambda b, a: b.uitofp(a, DOUBLES),
    lambda b, a: b.uitofp(a, _DOUBLE),
)
