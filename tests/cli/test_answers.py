"""What the verbs that run campaigns answer."""

from __future__ import annotations

import pytest

from lvnav_trade.cli.answers import check_preferred, shown
from lvnav_trade.errors import InputError


def test_only_what_cards_state_can_be_preferred() -> None:
    check_preferred(["cost", "mass", "error"])
    with pytest.raises(InputError, match=r"^--prefer weigth: should be one of "):
        check_preferred(["cost", "weigth"])


def test_answers_are_kept_where_json_is_wanted_and_not_printed(capsys: pytest.CaptureFixture[str]) -> None:
    found, show = shown(as_json=True)
    show(["an answer"], ["a case"])
    assert found == ["an answer"]
    assert capsys.readouterr().out == ""
