"""Form of a row: what every measurement adds to its truth, and what it clears."""

from __future__ import annotations

import numpy as np

from lvnav_trade.sensors.jacobian_row import N_ENTRY, add, clear


def test_errors_add_to_the_true_quantities():
    out = np.zeros(3)
    add.py_func(out, np.array([1.0, 2.0, 3.0, 99.0]), 0.5, -2.0, 0.25)
    assert out.tolist() == [1.5, 0.0, 3.25]


def test_a_row_is_cleared_up_to_the_entries_of_extra_states():
    h = np.arange(1.0, N_ENTRY + 4.0)
    clear.py_func(h)
    assert not h[:N_ENTRY].any()
    assert h[N_ENTRY:].tolist() == [N_ENTRY + 1.0, N_ENTRY + 2.0, N_ENTRY + 3.0]
