"""Results with and without runs."""

from __future__ import annotations

import pytest

from lvnav_trade.results.tables.read import load
from tests import synthetic


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("plots"), n_run=80))


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("alone"), n_run=0))
