"""A kept report of a study counted anew: what is refused. What is written: tests/studies/test_script.py."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from lvnav_trade.campaign.reading.study_card import load_study
from lvnav_trade.campaign.syntax.card_lookup import tool_folder
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.report.recount import recount
from lvnav_trade.report.script import StudyScript
from lvnav_trade.results.evaluation.published import COLUMNS, marks

PAGE = """\
# A paper

## Answer

Of 1.

The campaigns of this study.

| campaign | cases | runs | failed runs | as published | both engines agree |
| --- | ---: | ---: | ---: | --- | --- |
| polar | 2 | 40 | 0 | 9 of 9 | 1 of 1 cases |

## Assumptions

1. None.
"""


def kept(folder: Path, **cells: object) -> Path:
    row = {"id": "polar references 1", "item": "apogee", "case": "polar: base", "unit": "km", "published": 0.4243}
    numbers = {"ours": 0.2, "ratio": 0.47, "band_low": 0.5, "band_high": 2.0, "in_band": False}
    rows = pd.DataFrame([row | numbers | {"verdict": "undecided"} | marks({}, "number") | cells], columns=COLUMNS)
    rows.to_csv(folder / "references.csv", index=False)
    (folder / "report.md").write_text(PAGE)
    (folder / "figures").mkdir()
    return folder


def again(folder: Path) -> Path:
    script = StudyScript(tool_folder("campaigns") / "gains")
    study, questions = load_study(script.folder, None, {"missions": None, "steps": None, "single": None})
    return recount(study, [one.campaign for one in questions], folder, script)


def test_the_answer_is_counted_and_the_rest_of_the_page_stays(tmp_path: Path) -> None:
    text = again(kept(tmp_path)).read_text()
    assert "0 of 1 numbers are reproduced, 0 are not, 1 is undecided" in text
    assert "| polar | 2 | 40 | 0 | 0 of 1 | 1 of 1 cases |" in text
    assert text.endswith("\n## Assumptions\n\n1. None.\n")
    assert (tmp_path / "figures/ratios.png").is_file()


def test_a_row_of_which_nothing_is_stated_any_more_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"references\.csv: the study has no statement any more for 'polar references 99'"
    ):
        again(kept(tmp_path, id="polar references 99"))


def test_a_page_without_an_answer_is_refused(tmp_path: Path) -> None:
    (kept(tmp_path) / "report.md").write_text("# Nothing\n")
    with pytest.raises(InputError, match="is not the report of a study with an answer"):
        again(tmp_path)
