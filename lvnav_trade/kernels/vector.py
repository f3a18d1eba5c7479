"""The lane types and their operators: eight float64, eight words, eight truth values, each an LLVM vector.

Extension types of numba; the bodies inside @intrinsic and @overload are typed by numba. Multiply and add
never contract to one rounding: eight runs give the bits of one.
"""

import math
import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, models, register_model, type_callable

WIDTH = 8


class Lane(types.Type):
    """Numba type of eight values of a scalar type; numbers of the types in `numbers` are repeated eight times."""

    def __init__(self, name: str, scalar: Any, numbers: tuple[Any, ...] = ()) -> None:
        self.scalar, self.numbers = scalar, numbers
        super().__init__(name=name)


class LaneView(types.Type):
    """Numba type of an array with eight runs on its last axis, indexed without that axis; it owns no memory."""

    def __init__(self, item: Lane, ndim: int) -> None:
        self.item, self.ndim = item, ndim
        super().__init__(name=f"LaneView({item}, {ndim})")


f64x8 = Lane("f64x8", types.float64, (types.Float, types.Integer))
u64x8 = Lane("u64x8", types.uint64, (types.Integer,))
mask8 = Lane("mask8", types.boolean)


@register_model(Lane)
class _LaneModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, ir.VectorType(dmm[fe_type.scalar].get_value_type(), WIDTH))


@register_model(LaneView)
class _ViewModel(models.StructModel):
    def __init__(self, dmm, fe_type):
        shape = types.UniTuple(types.intp, fe_type.ndim)
        super().__init__(dmm, fe_type, [("data", types.CPointer(fe_type.item.scalar)), ("shape", shape)])


def as_vector(context, builder, operand_type, value, lane):
    """Emit an operand as a vector of a lane type: a lane as it is, a number eight times.

    Parameters
    ----------
    context, builder : numba's target context and LLVM's instruction builder
    operand_type, value : numba type and LLVM value of the operand
    lane : lane type of the result
    """
    if operand_type == lane:
        return value
    undefined_vector = ir.Constant(context.get_value_type(lane), ir.Undefined)
    number = context.cast(builder, value, operand_type, lane.scalar)
    first = builder.insert_element(undefined_vector, number, ir.Constant(ir.IntType(32), 0))
    all_first = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first, undefined_vector, all_first)


def _define(symbol, lane, result, emit):
    """Implement a Python operator of two operands for lanes of a type, and for a lane and a number.

    Parameters
    ----------
    symbol : function of the module `operator`
    lane, result : lane types of the operands and of the result
    emit : function of builder and two vectors that emits the instruction and returns its value
    """

    @type_callable(symbol)
    def operator_type(context):
        def result_type(a, b):
            is_defined = lane in (a, b)
            for operand in (a, b):
                is_defined = is_defined and (operand == lane or isinstance(operand, lane.numbers))
            return result if is_defined else None

        return result_type

    def on_vectors(context, builder, sig, args):
        a = as_vector(context, builder, sig.args[0], args[0], lane)
        b = as_vector(context, builder, sig.args[1], args[1], lane)
        return emit(builder, a, b)

    lower_builtin(symbol, lane, lane)(on_vectors)
    for number in lane.numbers:
        lower_builtin(symbol, lane, number)(on_vectors)
        lower_builtin(symbol, number, lane)(on_vectors)


def _define_unary(symbol, emit):
    """Implement a Python function of one float64 for a lane."""

    @type_callable(symbol)
    def operator_type(context):
        return lambda a: f64x8 if a == f64x8 else None

    lower_builtin(symbol, f64x8)(lambda context, builder, sig, args: emit(builder, args[0]))


def _call(name):
    """Return a function that emits a call of an LLVM function on a vector of float64."""

    def emit(builder, value):
        signature = ir.FunctionType(value.type, [value.type])
        return builder.call(cgutils.get_or_insert_function(builder.module, signature, f"{name}.v{WIDTH}f64"), [value])

    return emit


for _symbol, _lane, _emit in (
    (operator.add, f64x8, ir.IRBuilder.fadd),
    (operator.iadd, f64x8, ir.IRBuilder.fadd),
    (operator.sub, f64x8, ir.IRBuilder.fsub),
    (operator.isub, f64x8, ir.IRBuilder.fsub),
    (operator.mul, f64x8, ir.IRBuilder.fmul),
    (operator.imul, f64x8, ir.IRBuilder.fmul),
    (operator.truediv, f64x8, ir.IRBuilder.fdiv),
    (operator.add, u64x8, ir.IRBuilder.add),
    (operator.mul, u64x8, ir.IRBuilder.mul),
    (operator.xor, u64x8, ir.IRBuilder.xor),
    (operator.and_, u64x8, ir.IRBuilder.and_),
    (operator.or_, u64x8, ir.IRBuilder.or_),
    (operator.lshift, u64x8, ir.IRBuilder.shl),
    (operator.rshift, u64x8, ir.IRBuilder.lshr),
    (operator.and_, mask8, ir.IRBuilder.and_),
    (operator.or_, mask8, ir.IRBuilder.or_),
):
    _define(_symbol, _lane, _lane, _emit)
for _symbol, _sign in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
):
    _define(_symbol, f64x8, mask8, lambda builder, a, b, sign=_sign: builder.fcmp_ordered(sign, a, b))
_define_unary(operator.neg, ir.IRBuilder.fneg)
_define_unary(math.sqrt, _call("llvm.sqrt"))
_define_unary(abs, _call("llvm.fabs"))
