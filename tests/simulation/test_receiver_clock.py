"""The clock that a run is shown with is the one that it flew with."""

from __future__ import annotations

import numpy as np

from lvnav_trade.simulation.montecarlo import record_run, run_block
from lvnav_trade.simulation.receiver_clock import true_clock
from tests.export.cases import prepared_of

SEED, RUN = 4, 3


def test_the_true_clock_is_the_filters_estimate_and_its_error() -> None:
    prepared_case = prepared_of({"measurements": "ranges", "correction": "closed"})
    estimate, block = (
        record_run(prepared_case, SEED, RUN).tape.estimates_after,
        run_block(prepared_case, SEED, RUN, 1, uses_lanes=False),
    )
    clock = true_clock(prepared_case, SEED, RUN)
    at = {one.quantity: k for k, one in enumerate(prepared_case.outputs)}
    last = np.searchsorted(prepared_case.t_epoch, prepared_case.t_hist[-1] + 1e-6) - 1
    since = prepared_case.record.time_since_epoch[-1]
    error = block.err[0, -1]
    bias = clock[last, 0] + since * clock[last, 1]
    assert np.isclose(bias, estimate.clock[-1, 0] + error[at["clock_bias"]], rtol=0.0, atol=1e-9)
    assert np.isclose(clock[last, 1], estimate.clock[-1, 1] + error[at["clock_drift"]], rtol=0.0, atol=1e-9)
    assert np.ptp(clock[:, 0]) > 1.0  # it is not the error of a clock that stands
