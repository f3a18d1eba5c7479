"""What the verbs that run campaigns answer."""

from __future__ import annotations

import pandas as pd
import pytest

from lvnav_trade.cli.answers import _verdicts, check_preferred, shown
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


@pytest.mark.parametrize(("count", "lines"), [(50, 51), (400, 42)])
def test_of_many_rows_the_worst_are_printed(count: int, lines: int) -> None:
    verdicts = ["met", "undecided", "met", "violated"] * (count // 4) + ["met"] * (count % 4)
    text = _verdicts(pd.DataFrame({"case": range(count), "verdict": verdicts}), "requirements.csv").splitlines()
    assert len(text) == lines
    if count == 400:
        assert all("violated" in line for line in text[1:-1])
        assert text[-1] == "360 more rows, none worse: requirements.csv"
