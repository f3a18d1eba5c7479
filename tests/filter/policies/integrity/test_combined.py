"""Tests for faults beside everything that they combine with: right decisions in both engines."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.quantities.records import OF_CHANNEL, OF_CLOCK, OF_INERTIAL
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import MATCHED, loaded, prepare_hop, with_fields

RUNS, START = 80, 12.0
DURING = {"start": f"{START} s", "duration": "15 s"}
FAULTS = {
    OF_CHANNEL: [{"kind": "range_bias", "size": "40 m", **DURING}],
    OF_CLOCK: [{"kind": "clock_jump", "start": f"{START} s", "size": "40 m"}],
    OF_INERTIAL: [
        {"kind": "accel_bias_step", "size": ["2000 mg", "0 mg", "0 mg"], "start": "11.5 s", "duration": "1 s"}
    ],
}  # fmt: skip
LATE = {"receiver.latency": "0.3 s"}
COMBINED = {
    "mode logic": {"filter.logic": {"check_flags": True, "start_after": 2, "stop_after": "30 s"}},
    "open loop": {"filter.feedback": "open"},
    "buffered": {**LATE, "filter.delay_compensation": {"kind": "buffered"}},
    "unscented": {"filter.algorithm": "unscented"},
    "differenced clock": {"filter.clock": "differenced"},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", COMBINED)
def test_what_failed_is_isolated_in_both_engines(name):
    for kind, faults in FAULTS.items():
        if name == "differenced clock" and kind == OF_CLOCK:
            continue  # a filter that differences the clock out does not feel its jump
        case = prepare_hop(
            with_fields(loaded(MATCHED), faults=faults, **{"filter.integrity": {"hold": "20 s"}, **COMBINED[name]})
        )
        block, nominal = run_block(case, 3, 0, RUNS), covariance(case).decisions
        run, at = np.unique(block.decisions[:, 0], return_index=True)
        first = block.decisions[at]
        right = (first[:, 2] == kind) & (first[:, 1] >= START - 1e-9) & (first[:, 1] < START + 4.8)
        assert np.count_nonzero(right) >= 0.9 * RUNS, (name, kind, run.size, first[:5])
        assert nominal[0, 2] == kind, (name, kind, nominal[:5])
