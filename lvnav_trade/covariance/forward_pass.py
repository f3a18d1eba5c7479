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
from lvnav_trade.simulation.preparation.prepare import PreparedCase


class PassOutcome(NamedTuple):
    """Results of a forward pass.

    results : Covariances, means and budget at the history times.
    monitor : Fault monitor; None without tests for faults.
    mode_state : State of the mode logic; None without a mode logic.
    """

    results: PassResults
    monitor: Monitor | None
    mode_state: ModeState | None


def run_pass(
    prepared_case: PreparedCase, components: Components, tape: UpdateTape, has_aiding: bool = True
) -> PassOutcome:
    """Run a forward pass and return its results.

    Parameters
    ----------
    prepared_case
        Prepared case.
    components
        Its error components.
    tape
        Tape for the updates; without length nothing is recorded.
    has_aiding
        Whether measurements are processed.
    """
    work = new_nominal(prepared_case)
    optional_state = _new_optional_state(prepared_case)
    case = linear_case(prepared_case, has_aiding)
    joint = new_joint(prepared_case, components, tape)
    flight = new_flight(prepared_case, components)
    C_i_b = np.ascontiguousarray(np.swapaxes(matrices(prepared_case.record.q), 1, 2))
    rotations = HistoryRotations(attitude=C_i_b, axes=prepared_case.record.axes)
    forward(work, optional_state, case, joint, flight, rotations)
    return PassOutcome(joint.results, optional_state.monitor, optional_state.mode_state)


def linear_case(prepared_case: PreparedCase, has_aiding: bool = True) -> FilterCase:
    """Return the inputs of an epoch in linear covariance.

    To first order, a direct, an iterated and an unscented filter equal the extended filter, and an open loop equals a
    closed loop (`OptionalState` without its arrays). No measurement is rejected by the gate. The backup strapdown is a
    pass of its own.
    """
    nonlinear_options = {"direct": None, "iteration_settings": None, "has_sigma_points": None, "solver": None}
    options = prepared_case.options._replace(**nonlinear_options, backup=None)
    has_epochs = prepared_case.model.has_epochs and has_aiding
    model = prepared_case.model._replace(has_epochs=has_epochs, gate_squared=np.inf)
    return case_of(prepared_case, options=options, model=model)


def _new_optional_state(prepared_case: PreparedCase) -> OptionalState:
    """Return the arrays of the optional features that a case has, for its nominal flight."""
    options = prepared_case.options
    records = dict[str, Any]()
    n_epoch = prepared_case.t_epoch.size
    sizes = (n_epoch, prepared_case.channels.n_receiver, prepared_case.n_row)
    if options.rules is not None:
        records["mode_state"] = new_mode_state(*sizes)
    if options.fault_tests is not None:
        records["monitor"] = new_monitor(*sizes, options.fault_tests.window)
    if options.delay_processing is not None:
        n_stored = 1 + options.delay_processing.is_buffered.size
        records["state_history"] = np.zeros((n_stored, N_PAST))
    if options.vehicle is not None:
        n_entry = options.vehicle.columns.shape[1]
        records["motion"] = new_sample_work(prepared_case.layout.n_state, n_entry)
    if options.solver is not None:
        records["receiver"] = NominalReport(np.zeros((6, 6)))
    previous_epoch = new_nominal_previous_epoch(prepared_case)
    return OptionalState(previous_epoch=previous_epoch, **records)
