"""What this core can do at best: fused multiply-adds on vectors of eight, in independent chains."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit
from numba.core import cgutils
from numba.extending import intrinsic

from benchmarks.common import best
from lvnav_trade.kernels.lanes import number_like, view
from lvnav_trade.kernels.vector import WIDTH, f64x8

CHAINS = 12


@intrinsic
def _fma(typingctx: Any, a: Any, b: Any, c: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        vector = context.get_value_type(f64x8)
        kind = ir.FunctionType(vector, [vector, vector, vector])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{WIDTH}f64"), args)

    return f64x8(f64x8, f64x8, f64x8), codegen


@njit(error_model="numpy")
def _chains(x, rounds):
    v = view(x)
    a0, a1, a2, a3, a4, a5 = v[0], v[1], v[2], v[3], v[4], v[5]
    a6, a7, a8, a9, a10, a11 = v[6], v[7], v[8], v[9], v[10], v[11]
    m, c = number_like(a0, 0.999999), number_like(a0, 1e-6)
    for _ in range(rounds):
        a0, a1, a2, a3 = _fma(a0, m, c), _fma(a1, m, c), _fma(a2, m, c), _fma(a3, m, c)
        a4, a5, a6, a7 = _fma(a4, m, c), _fma(a5, m, c), _fma(a6, m, c), _fma(a7, m, c)
        a8, a9, a10, a11 = _fma(a8, m, c), _fma(a9, m, c), _fma(a10, m, c), _fma(a11, m, c)
    v[0] = a0 + a1 + a2 + a3 + a4 + a5 + a6 + a7 + a8 + a9 + a10 + a11


def peak() -> float:
    """Return this core's floating-point operations per second at best."""
    x, rounds = np.ones((CHAINS, WIDTH)), 300_000
    return 2 * CHAINS * WIDTH * rounds / best(lambda: _chains(x, rounds))
