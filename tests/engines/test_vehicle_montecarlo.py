"""Blocks of runs with an attitude reference: addressed by their number, replayed bit for bit."""

from __future__ import annotations

import numpy as np

from lvnav_trade.engines.montecarlo import channels, compile_kernels, run_block
from tests.engines.modelled import modelled


def test_a_run_is_the_same_in_any_block():
    prepared = modelled()
    compile_kernels(prepared)
    block, part = run_block(prepared, 7, 0, 10), run_block(prepared, 7, 8, 2)
    for name in ("err", "sigma", "nees", "nis", "innovation"):
        np.testing.assert_array_equal(getattr(block, name)[8:], getattr(part, name))
    assert channels(prepared) == 15
