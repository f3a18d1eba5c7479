"""Runs of a case of any kind behind one name: what is reported beside the filter's errors is in block and replay."""

from __future__ import annotations

import numpy as np

from lvnav_trade.engines import montecarlo
from lvnav_trade.engines.montecarlo import replay, run_block
from tests.building import LOOSE, case
from tests.engines.test_reported import flown


def test_a_case_that_reports_nothing_beside_its_filter_is_flown_as_it_is():
    prepared = case(LOOSE)
    np.testing.assert_array_equal(run_block(prepared, 3, 0, 8).err, montecarlo.run_block(prepared, 3, 0, 8).err)


def test_a_block_has_a_column_for_every_output():
    prepared, _, runs = flown("bancroft")
    assert runs.err.shape[2] == runs.sigma.shape[2] == len(prepared.outputs)
    assert callable(replay)
