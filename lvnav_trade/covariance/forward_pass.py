"""One forward pass of linear covariance: a case made ready for it, and its results."""

from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.covariance.components import Components
from lvnav_trade.covariance.forward import forward
from lvnav_trade.covariance.workspace import (
    HistoryRotations,
    NominalReport,
    PassResults,
    UpdateTape,
    new_flight,
    new_joint,
    new_nominal,
    new_nominal_previous_epoch,
)
from lvnav_trade.filter.policies.delay import N_PAST
from lvnav_trade.filter.policies.imu_samples import new_sample_work
from lvnav_trade.filter.policies.integrity.state import Monitor, new_monitor
from lvnav_trade.filter.policies.mode_logic import ModeState, new_mode_state
from lvnav_trade.quantities.frames import matrices
from lvnav_trade.simulation.epoch.filter_case import FilterCase, OptionalState, case_of
from lvnav_trade.simulation.preparation.prepare import Prepared


class PassOutcome(NamedTuple):
    """Results of a forward pass.

    out : Covariances, means and budget at the history times.
    monitor : Fault monitor; None without tests for faults.
    mode_state : State of the mode logic; None without a mode logic.
    """

    out: PassResults
    monitor: Monitor | None
    mode_state: ModeState | None


def run_pass(prepared: Prepared, true: Components, tape: UpdateTape, aided: bool = True) -> PassOutcome:
    """Run a forward pass and return its results.

    Parameters
    ----------
    prepared
        Prepared case.
    true
        Its error components.
    tape
        Tape for the updates; without length nothing is recorded.
    aided
        Whether measurements are processed.
    """
    work = new_nominal(prepared)
    parts = _new_parts(prepared)
    case = linear_case(prepared, aided)
    joint = new_joint(prepared, true, tape)
    flight = new_flight(prepared, true)
    C_i_b = np.ascontiguousarray(np.swapaxes(matrices(prepared.record.q), 1, 2))
    rotations = HistoryRotations(attitude=C_i_b, axes=prepared.record.axes)
    forward(work, parts, case, joint, flight, rotations)
    return PassOutcome(joint.out, parts.monitor, parts.mode_state)


def linear_case(prepared: Prepared, aided: bool = True) -> FilterCase:
    """Return the inputs of an epoch in linear covariance.

    To first order, a direct, an iterated and an unscented filter equal the extended filter, and an open loop equals a
    closed loop (`OptionalState` without its arrays). No measurement is rejected by the gate.
    """
    options = prepared.options._replace(direct=None, iterated=None, unscented=None, solver=None)
    is_aided = prepared.model.aided and aided
    model = prepared.model._replace(aided=is_aided, gate_squared=np.inf)
    return case_of(prepared, options=options, model=model)


def _new_parts(prepared: Prepared) -> OptionalState:
    """Return the arrays of the optional features that a case has, for its nominal flight."""
    options = prepared.options
    parts = dict[str, Any]()
    n_epoch = prepared.t_epoch.size
    sizes = (n_epoch, prepared.channels.n_receiver, prepared.n_row)
    if options.rules is not None:
        parts["mode_state"] = new_mode_state(*sizes)
    if options.integrity is not None:
        parts["monitor"] = new_monitor(*sizes, options.integrity.window)
    if options.late is not None:
        n_stored = 1 + options.late.buffered.size
        parts["state_history"] = np.zeros((n_stored, N_PAST))
    if options.vehicle is not None:
        n_entry = options.vehicle.columns.shape[1]
        parts["motion"] = new_sample_work(prepared.layout.n_state, n_entry)
    if options.solver is not None:
        parts["receiver"] = NominalReport(np.zeros((6, 6)))
    previous_epoch = new_nominal_previous_epoch(prepared)
    return OptionalState(previous_epoch=previous_epoch, **parts)
