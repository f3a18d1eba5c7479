"""Functions of a filter in C: begin, propagate, update, and the outputs of an open loop.

They are translated like the kernels that they call, and never run.
"""

from typing import Any

from lvnav_trade.engines.simulate import steps
from lvnav_trade.filters.feedforward import apply_correction, remove_correction


def begin(work: Any, parts: Any, options: Any, start: Any, nav: Any) -> None:
    """Begin, all else at zero, at a navigation state: quaternion body to inertial, velocity (m/s), position (m)."""
    for i in range(10):
        work.nav[i] = nav[i]
    for i in range(work.P.shape[0]):
        for j in range(work.P.shape[0]):
            work.P[i, j] = start.P[i, j]
    steps.begin_filter(work, parts, options)


def propagate(work: Any, parts: Any, case: Any, window: Any) -> None:
    """Propagate over a window by self->increments, angles (rad) and velocities (m/s) of its ticks, body axes."""
    steps.propagate(work, parts, case, window)


def update(work: Any, parts: Any, case: Any, epoch: Any) -> None:
    """Update by what was measured at an epoch, which count from 0."""
    steps.begin_epoch(work, parts, case, epoch)
    if case.model.aided:
        steps.update(work, parts, case, epoch)


def correct_outputs(work: Any, parts: Any, model: Any) -> None:
    """Let nav, par, clock_hat and extra be the corrected outputs of an open loop, until restore_outputs."""
    apply_correction(work, parts.open_loop, parts.watch, model)


def restore_outputs(work: Any, parts: Any, model: Any) -> None:
    """Let nav, par, clock_hat and extra be those of the inertial system again."""
    remove_correction(work, parts.open_loop, model)
