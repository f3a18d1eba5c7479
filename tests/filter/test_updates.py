"""The update by an epoch's rows: their order does not matter, and what is counted of them."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.simulation.montecarlo import run_block
from tests.building import LOOSE, MATCHED, case


def test_the_order_of_satellites_does_not_matter():
    """All rows of an epoch are linearised at one point: a permutation changes rounding only."""
    prepared_case = case(MATCHED)
    signals = prepared_case.signals
    assert np.all(signals.n_used == signals.n_used[0])  # so that every slot is filled and may be turned round
    turned = prepared_case._replace(
        signals=signals._replace(satellite_by_slot=np.ascontiguousarray(signals.satellite_by_slot[:, ::-1]))
    )
    one, two = run_block(prepared_case, 1, 0, 8), run_block(turned, 1, 0, 8)
    assert np.abs((one.err - two.err) / one.sigma).max() < 1e-6
    np.testing.assert_allclose(two.sigma, one.sigma, rtol=1e-6)
    np.testing.assert_allclose(two.nis, one.nis, rtol=1e-4)


@pytest.mark.parametrize("settings", [(), (LOOSE,)], ids=["tight", "loose"])
def test_innovations_stand_in_the_channels_of_their_rows(settings):
    prepared_case = case(*settings)
    block = run_block(prepared_case, 1, 0, 1)
    filled = np.isfinite(block.innovation[0])
    if settings:
        assert filled.all()
        assert filled.shape[1] == 6
    else:
        np.testing.assert_array_equal(filled[:, 0::2], prepared_case.sky.is_tracked)
        np.testing.assert_array_equal(filled[:, 1::2], prepared_case.sky.is_tracked)
    np.testing.assert_allclose(np.nansum(block.innovation**2, axis=2), block.nis, rtol=1e-12)
