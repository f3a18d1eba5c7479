"""Open loops with a mode logic: both engines agree on the outputs after the filter has stopped and started again."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.quantities.records import MODES
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import LOOSE, MATCHED, loaded, prepare_hop, with_fields

RUNS = 400
TIMES = (5.0, 9.0, 11.0, 12.0, 13.0, 15.0, 20.0, 22.0, 24.0, 27.0)
LOSSES = [
    {"kind": "satellite_outage", "start": "6 s", "duration": "5 s"},
    {"kind": "satellite_outage", "start": "16 s", "duration": "5 s"},
]


def restarted(after_stop, start):
    """A flight whose filter two losses stop, and which starts again twice: each start discards all estimates."""
    logic = {"start_after": 2, "correct_after": "1 s", "stop_after": "3 s", "after_stop": after_stop}
    scenario = loaded(MATCHED, LOOSE)
    card = with_fields(scenario.filter, feedback="open", logic=logic, init=start)
    prepared_case = prepare_hop(with_fields(scenario.model_copy(update={"filter": card}), faults=LOSSES))
    modes = [MODES[int(mode)] for mode in run_block(prepared_case, 3, 0, 1).changes[:, 3]]
    assert (modes.count("converging"), modes.count("stopped")) == (3, 2)
    return prepared_case


@pytest.mark.parametrize("start", ["from_card", "from_gnss"])
@pytest.mark.parametrize("after_stop", ["inertial", "predicted"])
def test_linear_covariance_describes_outputs_after_restarts(after_stop, start):
    prepared_case = restarted(after_stop, start)
    history, err = covariance(prepared_case), run_block(prepared_case, 3, 0, RUNS).err[:, :, :9]
    at = [int(np.argmin(np.abs(prepared_case.t_hist - t))) for t in TIMES]
    ratio = err[:, at].var(axis=0, ddof=1) / history.true_sigma[at, :9] ** 2
    tail = 1e-3 / 2 / ratio.size
    low, high = chi2.ppf([tail, 1.0 - tail], RUNS - 1) / (RUNS - 1)
    assert np.all((ratio > low) & (ratio < high)), ratio.round(2)
    for hist in at:
        variance = history.true_sigma[hist, :9] ** 2
        contribution = adjoint(prepared_case, float(prepared_case.t_hist[hist])).contribution.sum(axis=(1, 2))
        np.testing.assert_allclose(contribution, variance, rtol=1e-6)
