"""The two passes of linear covariance behind one name: see test_vehicle_lincov."""

from __future__ import annotations

from lvnav_trade.engines.lincov.history import covariance
from tests.building import LOOSE, case
from tests.engines.modelled import modelled


def test_every_kind_of_case_has_a_linear_covariance():
    for prepared, n_out in ((case(LOOSE), 15), (modelled(), 36)):
        assert covariance(prepared).true_sigma.shape == (prepared.t_hist.size, n_out)
