"""Metrics that the scripts of studies add are known in this folder's tests alone."""

from __future__ import annotations

from unittest.mock import patch

import pytest

from lvnav_trade.campaign.running import work
from tests.scripts import metrics_of_the_package


@pytest.fixture(autouse=True, scope="module")
def _clean():
    with metrics_of_the_package():
        yield


@pytest.fixture(scope="module")
def _all_cases_kept():
    """Keep the prepared cases of a small campaign from one stage to the next."""
    with patch.object(work, "KEPT_CASES", 8):
        yield
