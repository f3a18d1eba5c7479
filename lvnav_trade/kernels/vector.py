"""The lane types and their operators: eight float64, eight words, eight truth values, each an LLVM vector.

Extension types of numba; the bodies inside @intrinsic and @overload are typed by numba. Multiply and add
never contract to one rounding: eight runs give the bits of one.
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, overload, register_model

WIDTH = 8

DOUBLES = ir.VectorType(ir.DoubleType(), WIDTH)
WORDS = ir.VectorType(ir.IntType(64), WIDTH)
FLAGS = ir.VectorType(ir.IntType(1), WIDTH)


class F64x8(types.Type):
    """Eight float64."""

    def __init__(self) -> None:
        super().__init__(name="f64x8")


class U64x8(types.Type):
    """Eight unsigned 64-bit words."""

    def __init__(self) -> None:
        super().__init__(name="u64x8")


class Mask8(types.Type):
    """Eight truth values."""

    def __init__(self) -> None:
        super().__init__(name="mask8")


class LaneView(types.Type):
    """An array whose last axis is eight runs, indexed as if that axis were not there; it does not own its memory."""

    def __init__(self, item: Any, ndim: int) -> None:
        self.item, self.ndim = item, ndim
        super().__init__(name=f"LaneView({item}, {ndim})")


f64x8, u64x8, mask8 = F64x8(), U64x8(), Mask8()


@register_model(F64x8)
class _DoublesModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, DOUBLES)


@register_model(U64x8)
class _WordsModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, WORDS)


@register_model(Mask8)
class _FlagsModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, FLAGS)


@register_model(LaneView)
class _ViewModel(models.StructModel):
    def __init__(self, dmm, fe_type):
        scalar = types.float64 if fe_type.item is f64x8 else types.uint64
        members = [("data", types.CPointer(scalar))] + [(f"n{axis}", types.intp) for axis in range(fe_type.ndim)]
        super().__init__(dmm, fe_type, members)


def is_lane(*kinds: Any) -> bool:
    """Say whether all these numba types are eight float64."""
    return all(isinstance(kind, F64x8) for kind in kinds)


def is_number(kind: Any) -> bool:
    """Say whether a numba type is one number."""
    return isinstance(kind, types.Float | types.Integer)


def broadcast(builder, vector, value):
    """Emit a vector whose eight entries are one value."""
    undefined = ir.Constant(vector, ir.Undefined)
    one = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, undefined, ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH))


@intrinsic
def splat(typingctx, x):
    """Return eight times one float64."""

    def codegen(context, builder, sig, args):
        return broadcast(builder, DOUBLES, args[0])

    return f64x8(types.float64), codegen


@intrinsic
def splat_word(typingctx, x):
    """Return eight times one word."""

    def codegen(context, builder, sig, args):
        return broadcast(builder, WORDS, args[0])

    return u64x8(types.uint64), codegen


def _float_operator(symbol, instruction):
    @intrinsic
    def vector_op(typingctx, a, b):
        def codegen(context, builder, sig, args):
            return getattr(builder, instruction)(args[0], args[1])

        return f64x8(f64x8, f64x8), codegen

    @overload(symbol)
    def dispatch(a, b):
        if is_lane(a, b):
            return lambda a, b: vector_op(a, b)
        if is_lane(a) and is_number(b):
            return lambda a, b: vector_op(a, splat(float(b)))
        if is_number(a) and is_lane(b):
            return lambda a, b: vector_op(splat(float(a)), b)
        return None


def _word_operator(symbol, instruction):
    @intrinsic
    def vector_op(typingctx, a, b):
        def codegen(context, builder, sig, args):
            return getattr(builder, instruction)(args[0], args[1])

        return u64x8(u64x8, u64x8), codegen

    @overload(symbol)
    def dispatch(a, b):
        if isinstance(a, U64x8) and isinstance(b, U64x8):
            return lambda a, b: vector_op(a, b)
        if isinstance(a, U64x8) and isinstance(b, types.Integer):
            return lambda a, b: vector_op(a, splat_word(np.uint64(b)))
        if isinstance(a, types.Integer) and isinstance(b, U64x8):
            return lambda a, b: vector_op(splat_word(np.uint64(a)), b)
        return None


def _comparison(symbol, predicate):
    @intrinsic
    def compare(typingctx, a, b):
        def codegen(context, builder, sig, args):
            return builder.fcmp_ordered(predicate, args[0], args[1])

        return mask8(f64x8, f64x8), codegen

    @overload(symbol)
    def dispatch(a, b):
        if is_lane(a, b):
            return lambda a, b: compare(a, b)
        if is_lane(a) and is_number(b):
            return lambda a, b: compare(a, splat(float(b)))
        if is_number(a) and is_lane(b):
            return lambda a, b: compare(splat(float(a)), b)
        return None


for _symbol, _instruction in (
    (operator.add, "fadd"),
    (operator.iadd, "fadd"),
    (operator.sub, "fsub"),
    (operator.isub, "fsub"),
    (operator.mul, "fmul"),
    (operator.imul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _float_operator(_symbol, _instruction)
for _symbol, _instruction in (
    (operator.add, "add"),
    (operator.mul, "mul"),
    (operator.xor, "xor"),
    (operator.and_, "and_"),
    (operator.or_, "or_"),
    (operator.lshift, "shl"),
    (operator.rshift, "lshr"),
):
    _word_operator(_symbol, _instruction)
for _symbol, _predicate in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
):
    _comparison(_symbol, _predicate)


@intrinsic
def _negate(typingctx, a):
    def codegen(context, builder, sig, args):
        return builder.fneg(args[0])

    return f64x8(f64x8), codegen


@overload(operator.neg)
def _neg(a):
    if is_lane(a):
        return lambda a: _negate(a)
    return None


def _mask_operator(symbol, instruction):
    @intrinsic
    def mask_op(typingctx, a, b):
        def codegen(context, builder, sig, args):
            return getattr(builder, instruction)(args[0], args[1])

        return mask8(mask8, mask8), codegen

    @overload(symbol)
    def dispatch(a, b):
        if isinstance(a, Mask8) and isinstance(b, Mask8):
            return lambda a, b: mask_op(a, b)
        return None


_mask_operator(operator.and_, "and_")
_mask_operator(operator.or_, "or_")
