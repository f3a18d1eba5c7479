"""Which numbers of the results are equal on every machine, and how far the others may differ; measured.

See docs/numbers_across_machines.md for the environments, the figures and what moves the numbers.
"""

from __future__ import annotations

from typing import Any

from lvnav_trade.store.schema import TABLES

BIT_EQUAL = ("outputs", "starts")
"""Tables without a rounded number: draws are keyed, and come out of the same kernels on every processor."""
TOLERANCE = 1e-6
"""Largest difference of a number, as a share of the largest size in its column; measured: 1e-7."""
COARSE = {"nonlinearity": 1e-2}
"""Tables of differences that cancel, and their tolerance; measured: 8e-4."""
UNDETERMINED = {"cases": ("facts",), "observability": ("direction", "weakest")}
"""Columns of text that hold rounded numbers: those of cases in full, and directions of singular values that are zero
but for rounding, of which every combination is as good.
"""


def across_machines() -> dict[str, Any]:
    """Return what the manifest says of the same campaign, tool and seed on another processor or with other libraries.

    bit_equal: tables that are equal; tolerance: for each other table the largest difference of a number as a share of
    the largest size in its column; undetermined: columns of text without a tolerance. With the same processor and
    libraries all tables are equal, whatever the number of workers.
    """
    return {
        "bit_equal": list(BIT_EQUAL),
        "tolerance": {name: COARSE.get(name, TOLERANCE) for name in TABLES if name not in BIT_EQUAL},
        "undetermined": {name: list(columns) for name, columns in UNDETERMINED.items()},
    }
