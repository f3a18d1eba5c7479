"""One page for all tests."""

from __future__ import annotations

import pytest

from lvnav_trade.report import build, keep
from tests import synthetic


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = synthetic.results(tmp_path_factory.mktemp("report") / "synthetic", n_run=80, failing=(3,))
    return build(folder)


@pytest.fixture(scope="module")
def text(page):
    return page.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def kept(page, tmp_path_factory):
    return keep(page.parent, tmp_path_factory.mktemp("kept") / "report")
