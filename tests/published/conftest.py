"""Metrics that the scripts of studies add are known in this folder's tests alone."""

from __future__ import annotations

import pytest

from tests.scripts import metrics_of_the_package


@pytest.fixture(autouse=True, scope="module")
def _clean():
    with metrics_of_the_package():
        yield
