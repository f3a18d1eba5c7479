"""Scripts of the studies that come with the tool, for tests; the metrics that they add are taken away again."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from lvnav_studies import Publication
from lvnav_trade.api.pages import load_script
from lvnav_trade.results.registry import registry

CAMPAIGNS = Path(__file__).resolve().parents[1] / "campaigns"


def publication(name: str) -> Publication:
    """Return what the script of a study adds."""
    found = load_script(CAMPAIGNS / name / "study.py")
    assert isinstance(found, Publication)
    return found


def module(study: str, name: str) -> ModuleType:
    """Return a module next to the script of a study."""
    publication(study)
    return sys.modules[name]


@contextmanager
def metrics_of_the_package() -> Iterator[None]:
    """Take away the metrics that scripts add within."""
    before = dict(registry())
    try:
        yield
    finally:
        registry().clear()
        registry().update(before)
