"""What the C of a filter has as functions of its own does what the flight does."""

from __future__ import annotations

import inspect

from lvnav_trade.export import entries
from lvnav_trade.simulation import flight_loop, steps


def test_the_steps_are_those_of_the_flight():
    flown = inspect.getsource(getattr(flight_loop.fly, "py_func", flight_loop.fly))
    for entry, called in (
        (entries.begin, "begin_filter"),
        (entries.propagate, "propagate"),
        (entries.update, "begin_epoch"),
        (entries.update, "update"),
    ):
        assert f"steps.{called}(" in inspect.getsource(entry)
        assert f"{called}(work, optional_state" in flown
        assert hasattr(steps, called)
