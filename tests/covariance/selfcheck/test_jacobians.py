"""Jacobian rows against differences: what a row has wrong or leaves out is found."""

from __future__ import annotations

import pytest

from lvnav_trade.covariance.selfcheck import jacobians
from lvnav_trade.covariance.selfcheck.jacobians import jacobians as jacobian_checks
from tests.covariance.diagnostics.checked import failed, rich


@pytest.mark.parametrize("entry", [0, 3, 9], ids=["position", "attitude", "clock"])
def test_a_wrong_sign_in_a_row_is_found(monkeypatch, entry):
    sound = jacobians.fill_receiver

    def wrong(work, *args):
        sound(work, *args)
        work.H[0, entry] *= -1.0

    monkeypatch.setattr(jacobians, "fill_receiver", wrong)
    assert [what for what, *_ in failed(jacobian_checks(rich()))] == ["pseudorange"]


def test_a_swing_of_the_antenna_that_a_row_leaves_out_is_found():
    prepared_case = rich()
    entry = prepared_case.model.entry.copy()
    entry[prepared_case.model.entry == 10] = 9  # of the body rate: H_RATE
    wrong = prepared_case._replace(model=prepared_case.model._replace(entry=entry))
    found = failed(jacobian_checks(wrong))
    assert [what for what, *_ in found] == ["range_rate"]
