"""A single forward pass: without measurements it describes the inertial system, whatever the filter is."""

from __future__ import annotations

import numpy as np

from lvnav_trade.covariance.components import build_components
from lvnav_trade.covariance.forward_pass import run_pass
from lvnav_trade.covariance.sources import n_joint
from lvnav_trade.covariance.workspace import new_tape, row_width
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import INERTIAL, LOOSE, MATCHED, case


def passed(prepared_case, aided):
    nothing = new_tape(0, 0, n_joint(prepared_case), row_width(prepared_case))
    return run_pass(prepared_case, build_components(prepared_case), nothing, has_aiding=aided).results


def test_without_measurements_a_pass_describes_the_runs_of_the_inertial_system():
    loose, runs = case(MATCHED, LOOSE), 400
    out, err = passed(loose, aided=False), run_block(case(MATCHED, INERTIAL), 3, 0, runs).err
    sigma = np.sqrt(np.trace(out.true[-1, 6:9, 6:9]))
    assert abs(np.sqrt(np.mean(np.sum(err[:, -1, 6:9] ** 2, axis=1))) / sigma - 1.0) < 0.15
    assert sigma > 3.0 * np.sqrt(np.trace(passed(loose, aided=True).true[-1, 6:9, 6:9]))
    np.testing.assert_array_equal(out.n_row, 0)
