"""Functions of an exported filter: begin, propagate, update, and the outputs of an open loop.

They are translated to C like the kernels that they call, and never run in Python. The first paragraph of a docstring
becomes the comment of the C function.
"""

from typing import Any

from lvnav_trade.filter.policies.open_loop import apply_correction, remove_correction
from lvnav_trade.simulation import steps


def begin(work: Any, optional_state: Any, options: Any, start: Any, nav: Any) -> None:
    """Initialise the filter at a navigation state: quaternion body to inertial, velocity (m/s), position (m).

    Parameters
    ----------
    work : record
        Arrays of the run. `nav` and `P` are set.
    optional_state : record
        Optional states of the filter.
    options : record
        Optional features of the filter.
    start : record
        Initial covariance `P` (n_state, n_state), SI.
    nav : (10,)
        Quaternion body to inertial, scalar first; inertial velocity (m/s) and position (m).
    """
    for i in range(10):
        work.nav[i] = nav[i]
    for i in range(work.P.shape[0]):
        for j in range(work.P.shape[0]):
            work.P[i, j] = start.P[i, j]
    steps.begin_filter(work, optional_state, options)


def propagate(work: Any, optional_state: Any, case: Any, window: Any) -> None:
    """Propagate over a window with self->increments: angles (rad) and velocities (m/s) of its ticks, body axes.

    Parameters
    ----------
    work, optional_state : record
        Arrays of the run, and optional states of the filter.
    case : record
        Schedule, filter model and options.
    window : int
        Number of the window, from 0.
    """
    steps.propagate(work, optional_state, case, window)


def update(work: Any, optional_state: Any, case: Any, epoch: Any) -> None:
    """Process the measurements of an epoch; epochs are counted from 0.

    Parameters
    ----------
    work, optional_state : record
        Arrays of the run, and optional states of the filter.
    case : record
        Schedule, signals, sensors, filter model and options.
    epoch : int
        Number of the epoch.
    """
    steps.begin_epoch(work, optional_state, case, epoch)
    if case.model.has_epochs:
        steps.update(work, optional_state, case, epoch)


def correct_outputs(work: Any, optional_state: Any, model: Any) -> None:
    """Set nav, par, clock_hat and extra to the corrected outputs of an open loop, until restore_outputs.

    Parameters
    ----------
    work, optional_state : record
        Arrays of the run, and optional states of the filter with `open_loop`.
    model : record
        Filter model.
    """
    apply_correction(work, optional_state.open_loop, optional_state.mode_state, model)


def restore_outputs(work: Any, optional_state: Any, model: Any) -> None:
    """Set nav, par, clock_hat and extra to those of the inertial system again.

    The arguments are those of `correct_outputs`.
    """
    remove_correction(work, optional_state.open_loop, model)
