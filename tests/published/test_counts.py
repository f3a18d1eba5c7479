"""What documentation and pages say of studies is what the two columns of the kept CSV say."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from lvnav_trade.report.headline import counts_sentence, verdict_counts
from lvnav_trade.results.evaluation.published import is_evidence

PAGES = {"conae": "docs/conae.md", "gains": "docs/gains.md", "drdc": "docs/modelling_the_vehicle.md"}


def words(page: Path) -> str:
    """Return the text of a page as one line, however it is wrapped."""
    return " ".join(page.read_text().split())


def kept(root: Path, study: str) -> pd.DataFrame:
    return pd.read_csv(root / f"reports/{study}/references.csv", keep_default_na=False)


@pytest.mark.parametrize("study", PAGES)
def test_page_and_documentation_say_what_the_kept_rows_say(root: Path, study: str) -> None:
    rows = kept(root, study)
    rows = rows[is_evidence(rows) & (rows.counts_as != "statement")]
    sentence = counts_sentence(rows, verdict_counts(rows))
    assert sentence in words(root / f"reports/{study}/report.md")
    assert sentence in words(root / PAGES[study])


def test_the_statements_of_dlr_are_counted_by_their_numbers(root: Path) -> None:
    rows = kept(root, "dlr")
    rows = rows[is_evidence(rows)]
    verdicts = rows.groupby(rows["item"].str.split(" ").str[0]).verdict.agg(
        lambda words: frozenset(words) - {"not run", "not set up"}
    )
    holds, fails = (int((verdicts == frozenset([word])).sum()) for word in ("holds", "does not hold here"))
    tested = f"{holds} hold in every evaluation by which they are tested, {fails} do not hold here"
    sentence = f"Of {len(verdicts)} statements {tested}"
    assert sentence in words(root / "reports/dlr/report.md")
    assert sentence in words(root / "docs/dlr.md")


def test_no_row_whose_bound_is_ours_is_counted_as_published(root: Path) -> None:
    for study in ("conae", "drdc", "gains"):
        rows = kept(root, study)
        assert not rows["item"].str.contains("bound ours").any()
        assert ((rows.own == "") | ~is_evidence(rows)).all()
