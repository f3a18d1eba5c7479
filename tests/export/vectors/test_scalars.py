"""Scalar measurements of reference vectors: none without aiding; the reported covariance counts for a solver."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from lvnav_trade.export.vectors.scalars import measurement_rows, reports_covariance


def prepared_with(aided=False, has_covariance=False, solver=None):
    return SimpleNamespace(
        channels=None,
        signals=None,
        channel_names=(),
        model=SimpleNamespace(has_epochs=aided, has_reported_covariance=has_covariance),
        options=SimpleNamespace(solver=solver),
        t_epoch=(0.0, 1.0),
    )


def test_a_filter_without_aiding_has_no_scalar_measurement():
    assert list(measurement_rows(prepared_with(), None)) == []


@pytest.mark.parametrize(
    ("has_covariance", "solver", "reports"),
    [(True, "solver", True), (True, None, False), (False, "solver", False)],
)
def test_a_covariance_is_reported_by_a_receiver_that_solves(has_covariance, solver, reports):
    assert reports_covariance(prepared_with(has_covariance=has_covariance, solver=solver)) is reports
