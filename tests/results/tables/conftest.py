"""One folder of results for all tests."""

from __future__ import annotations

import pytest

from tests import synthetic


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return synthetic.results(tmp_path_factory.mktemp("store") / "whole", n_run=100)
