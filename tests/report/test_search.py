"""Pages of searches."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lvnav_trade.campaign.search.solve import ANSWERS, CONFIRMED, INTERVALS, SCANNED
from lvnav_trade.report import search
from lvnav_trade.report.blocks import Picture, Table

ONE = [("base", "frozen", np.nan, "", 1.5, "deg", "tilt", True, 0.1, 9, "")]
LOOKS = [("base", "frozen", np.nan, "", x, "deg", "tilt", x, 1.5, "mrad", x / 1.5, 0.9) for x in (0.1, 1.0, 2.0)]


def test_an_answer_is_a_page_with_its_figure_its_tables_and_runs(tmp_path) -> None:
    answers, scanned = pd.DataFrame(ONE, columns=ANSWERS), pd.DataFrame(LOOKS, columns=SCANNED)
    confirmed = pd.DataFrame([("base", "frozen", 1.4, "deg", "tilt", 80, 3, 0.04, "met", True)], columns=CONFIRMED)
    blocks = search.solution_blocks(answers, pd.DataFrame(columns=INTERVALS), scanned, confirmed, ["initial.tilt"])
    assert [block.name for block in blocks if isinstance(block, Picture)] == ["solve"]
    assert "along" not in next(block for block in blocks if isinstance(block, Table)).head
    page = search.write(tmp_path / "page", "title", "asked", blocks, {"answers": answers, "none": answers[:0]})
    assert {file.name for file in page.parent.iterdir()} >= {"report.md", "report.html", "answers.csv", "figures"}
    assert not (page.parent / "none.csv").exists()


def test_two_fields_are_a_boundary() -> None:
    rows = [(*ONE[0][:2], x, "s", 1.0 / x, *ONE[0][5:]) for x in (1.0, 2.0)]
    blocks = search.solution_blocks(
        pd.DataFrame(rows, columns=ANSWERS), pd.DataFrame(columns=INTERVALS), pd.DataFrame(LOOKS, columns=SCANNED),
        pd.DataFrame(columns=CONFIRMED),
        ["initial.tilt", "receiver.latency"],
    )  # fmt: skip
    assert [block.name for block in blocks if isinstance(block, Picture)] == ["boundary"]


def test_indices_and_a_tuning_are_tables() -> None:
    frame = pd.DataFrame({"source": ["a", "b"], **{f"{way}_{order}": [0.6, 0.4] for way in ("frozen", "retuned")
                                                    for order in ("first", "total", "total_half_width")}})  # fmt: skip
    found = search.sensitivity_blocks(frame, "base", "velocity_error_3d at injection", 0.9, 0.99, 64)
    assert found[0].text == "a 0.60 +- 0.60 (frozen 0.60); b 0.40 +- 0.40 (frozen 0.40)."
    assert "90 % of the mean square" in found[1].text
    cases = pd.DataFrame({"case": ["a", "b"], "role": ["tuned", "held out"], "ratio_before": [2.0, 3.0],
                          "ratio_after": [0.5, 0.75]})  # fmt: skip
    made = search.tuning_blocks(pd.DataFrame({"path": ["x"]}), cases, "tune of x")
    assert made[-1].text == "tune of x"
    assert made[0].text == "tuned, worst of 1: 2 before, 0.5 after; held out, worst of 1: 3 before, 0.75 after."
    assert [len(block.rows) for block in made if isinstance(block, Table)] == [1, 2]
