"""Recorded data from Python: a fit that writes its card, and only where the log is good."""

from __future__ import annotations

import pytest

from lvnav_trade.errors import InputError
from lvnav_trade.logs import fit_unit
from tests.campaign.test_unit_card import log_of


def test_the_text_of_the_fit_is_the_card(tmp_path):
    card = tmp_path / "unit.yaml"
    found = fit_unit(log_of(tmp_path), card)
    assert card.read_text(encoding="utf-8") == found.text


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match="the card cannot be written there"):
        fit_unit(log_of(tmp_path), tmp_path / "nowhere" / "unit.yaml")
