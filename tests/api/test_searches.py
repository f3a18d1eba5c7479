"""Searches end to end: refused before anything is computed; a page with its tables."""

from __future__ import annotations

import pytest

from lvnav_trade import api
from lvnav_trade.quantities.errors import InputError


@pytest.mark.parametrize(("search", "message"), [
    (api.solve, "asks no inverse question"), (api.indices, "has no block indices"),
    (api.tune, "tunes no filter"),
])  # fmt: skip
def test_a_campaign_that_asks_nothing_is_refused(search, message, tmp_path) -> None:
    with pytest.raises(InputError, match=message):
        search("campaigns/smoke.yaml", folder=tmp_path / "page")
    assert not (tmp_path / "page").exists()


def test_a_folder_of_the_user_is_refused_first(tmp_path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="did not write"):
        api.solve("campaigns/trade/heading_needed.yaml", folder=tmp_path)
