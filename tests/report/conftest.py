"""One page for all tests, and figures that are drawn in this process."""

from __future__ import annotations

import shutil
from functools import partial

import pytest

from lvnav_trade.report import build, keep
from lvnav_trade.report.figures import raster
from tests import synthetic


@pytest.fixture(scope="module", autouse=True)
def _drawn_in_this_process():
    """Start no worker processes, each of which would import first what this process has; test_raster.py has them."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(raster, "files", partial(raster.files, jobs=1))
        yield


@pytest.fixture(scope="session")
def first_page(tmp_path_factory):
    folder = synthetic.results(tmp_path_factory.mktemp("first") / "synthetic", n_run=80, failing=(3,))
    return build(folder)


@pytest.fixture(scope="module")
def page(first_page, tmp_path_factory):
    """Return the page in a folder of the module's own, a copy."""
    return shutil.copytree(first_page.parent, tmp_path_factory.mktemp("report") / "synthetic") / first_page.name


@pytest.fixture(scope="module")
def text(page):
    return page.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def kept(page, tmp_path_factory):
    return keep(page.parent, tmp_path_factory.mktemp("kept") / "report")
