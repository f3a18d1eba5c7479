"""Results with known answers: matched, wrong, and linear covariance alone."""

from __future__ import annotations

import pytest

from lvnav_trade.results.tables.read import load
from tests import synthetic


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("good"), failing=(3,)))


@pytest.fixture(scope="module")
def wrong(tmp_path_factory):
    """Runs drawn 1.6 times as large as linear covariance says."""
    return load(synthetic.results(tmp_path_factory.mktemp("wrong"), n_run=80, wrong=1.6))


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Linear covariance without runs."""
    return load(synthetic.results(tmp_path_factory.mktemp("alone"), n_run=0))
