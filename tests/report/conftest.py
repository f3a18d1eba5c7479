"""One page for all tests."""

from __future__ import annotations

import pytest

from lvnav_trade.report import build
from tests import synthetic


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = synthetic.results(tmp_path_factory.mktemp("report") / "synthetic", n_run=80, failing=(3,))
    return build(folder)


@pytest.fixture(scope="module")
def text(page):
    return page.read_text(encoding="utf-8")
