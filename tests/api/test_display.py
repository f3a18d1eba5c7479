"""What a result shows: title, lines, tables; nothing of a user's names is markup."""

from __future__ import annotations

import pandas as pd
import pytest

from lvnav_trade.api.display import MOST_ROWS, DisplayBase, DisplayContent, html_of, text_of


def test_html_has_title_lines_and_tables_as_text():
    frame = pd.DataFrame({"case": ["<b>x</b>"], "error_m": [0.123456789]})
    page = html_of(DisplayContent("<script>", ("a < b",), {"Errors": frame}))
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert "<p>a &lt; b</p>" in page
    assert "&lt;b&gt;x&lt;/b&gt;" in page
    assert "0.123457" in page


def test_text_has_the_same():
    assert text_of(DisplayContent("Title", ("line",), {"": pd.DataFrame({"n": [1]})})).splitlines() == [
        "Title",
        "line",
        " n",
        " 1",
    ]


@pytest.mark.parametrize("form", [html_of, text_of])
def test_a_long_table_is_cut_and_counted(form):
    frame = pd.DataFrame({"n": range(MOST_ROWS + 3)})
    assert "3 more rows" in form(DisplayContent("", (), {"": frame}))
    assert "more rows" not in form(DisplayContent("", (), {"": frame[:MOST_ROWS]}))


def test_a_result_says_what_it_shows():
    class One(DisplayBase):
        def _display_content(self):
            return DisplayContent("One")

    assert One()._repr_html_() == "<h4>One</h4>"
    assert str(One()) == "One"
    with pytest.raises(NotImplementedError):
        str(DisplayBase())
