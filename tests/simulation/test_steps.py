"""Steps of a filter know nothing of the truth."""

from __future__ import annotations

import inspect

from lvnav_trade.simulation import steps


def test_no_step_takes_what_is_true_or_drawn():
    for name in ("begin_filter", "propagate", "begin_epoch", "update"):
        step = getattr(steps, name)
        taken = set(inspect.signature(getattr(step, "py_func", step)).parameters)
        assert not taken & {"start", "history", "k0", "k1"}
