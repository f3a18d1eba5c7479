"""Propagation over gaps: a wrong transition and errors that are too large are found."""

from __future__ import annotations

from lvnav_trade.covariance.history import covariance
from lvnav_trade.covariance.selfcheck.state_checks import propagation
from lvnav_trade.kernels.transition import VEL_ATT
from tests.building import MATCHED, loaded, prepare_hop, with_fields
from tests.covariance.diagnostics.checked import failed


def test_a_transition_that_lacks_the_turned_force_is_found():
    prepared_case = prepare_hop(with_fields(loaded(MATCHED), faults=[{"kind": "satellite_outage", "start": "8 s",
                                                                 "duration": "12 s"}]))  # fmt: skip
    history, events = covariance(prepared_case), {"end0": 20.0}
    assert failed(propagation(prepared_case, history, events)) == []
    assert {"gap of 13 s", "update interval"} == {
        check.quantity for check in propagation(prepared_case, history, events)
    }
    keep = prepared_case.model.block_kinds != VEL_ATT
    wrong = prepared_case.model._replace(
        **{name: getattr(prepared_case.model, name)[keep] for name in ("block_rows", "block_columns", "block_kinds",
                                                                  "block_drivers")}
    )  # fmt: skip
    assert failed(propagation(prepared_case._replace(model=wrong), history, events))


def test_errors_that_are_too_large_for_a_gap_are_found():
    outage = [{"kind": "satellite_outage", "start": "0 s", "duration": "20 s"}]
    prepared_case = prepare_hop(with_fields(loaded(MATCHED), faults=outage, **{"initial.heading": "20 deg"}))
    (gap, *_) = propagation(prepared_case, covariance(prepared_case), {})
    assert gap.verdict == "failed"
    assert gap.figure > 0.1
