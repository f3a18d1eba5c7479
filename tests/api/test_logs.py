"""Recorded data from Python: a fit that writes its card, and only where the log is good."""

from __future__ import annotations

import pytest

from lvnav_trade.api import fit_unit
from lvnav_trade.quantities.errors import InputError
from tests.campaign.test_unit_card import log_of


def test_the_text_of_the_fit_is_the_card(tmp_path):
    card = tmp_path / "unit.yaml"
    found = fit_unit(log_of(tmp_path), card)
    assert card.read_text(encoding="utf-8") == found.text


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match="the card cannot be written there"):
        fit_unit(log_of(tmp_path), tmp_path / "nowhere" / "unit.yaml")


def test_a_file_that_the_tool_did_not_write_stays(tmp_path):
    card, log = tmp_path / "unit.yaml", log_of(tmp_path)
    fit_unit(log, card)
    fit_unit(log, card)
    card.write_text("name: mine\n")
    with pytest.raises(InputError, match="exists and was not written by lvnav-trade"):
        fit_unit(log, card)
    assert card.read_text() == "name: mine\n"
