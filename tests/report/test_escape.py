"""What a user writes is shown as it is written, and is never markup, a script or a formula."""

from __future__ import annotations

import io
import json
import re
from html.parser import HTMLParser
from xml.etree import ElementTree

import pandas as pd
import pytest
from markdown_it import MarkdownIt

from lvnav_trade.report.blocks import Section, Text
from lvnav_trade.report.build import html_page, markdown_page
from lvnav_trade.report.escape import (
    csv_text,
    data_json,
    markdown,
    markdown_alt,
    markdown_cell,
    markdown_fence,
    markdown_line,
    xml_text,
)

RENDER = MarkdownIt("commonmark", {"html": True}).enable("table").enable("strikethrough")
ATTACKS = [
    "<script>alert(1)</script>", "<img src=x onerror=alert(1)>", "<!-- hidden", "</td><td>", "[a](javascript:alert(1))",
    "![a](http://x.y/z.png)", "[a][b]", "[a]: http://x.y", "<http://x.y>", "# Requirements", "> quoted", "Met\n===",
    "Met\n---", "| a | b |\n|---|---|\n| c | d |", "a | b\n--- | ---", "~~gone~~", "~~~\ncode", "```\ncode", "    code",
    "`code`", "**bold**", "_a_", "__a__", "*a*", "\\[a](b)", "\\<b>", "&lt;b&gt;", "a\\", "a\n\n    # x", "***", "___",
]  # fmt: skip


class Shown(HTMLParser):
    """Collect the elements and the text of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.text = ""

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)

    def handle_comment(self, data):
        self.tags.add("comment")

    def handle_data(self, data):
        self.text += data


def shown(text: str) -> Shown:
    page = Shown()
    page.feed(RENDER.render(text))
    return page


@pytest.mark.parametrize("attack", ATTACKS)
def test_a_paragraph_is_shown_as_it_is_written(attack):
    page = shown(f"{markdown(attack)}\n\nafter\n")
    assert page.tags == {"p"}
    assert page.text.split() == [*attack.split(), "after"]


@pytest.mark.parametrize("attack", ATTACKS)
def test_a_cell_stays_a_cell(attack):
    page = shown(f"| {markdown_cell(attack)} | second |\n| --- | --- |\n| {markdown_cell(attack)} | last |\n")
    assert page.tags == {"table", "thead", "tr", "th", "tbody", "td"}
    assert page.text.split() == [*attack.split(), "second", *attack.split(), "last"]


@pytest.mark.parametrize("attack", ATTACKS)
def test_a_heading_stays_a_heading_and_a_picture_a_picture(attack):
    assert shown(f"# {markdown_line(attack)}\n").tags == {"h1"}
    assert shown(f"![{markdown_alt(attack)}](figures/a.png)\n").tags == {"p", "img"}
    assert shown(f"*{markdown_line(attack)}*\n").tags == {"p", "em"}


def test_lists_numbers_and_names_are_left_as_they_are():
    for text in ("- a\n- b", "1. a", "-3.2 m to +4 m", "velocity_error_3d", "a < 3 & b > 4", "case [1a2b]", "~5 m"):
        assert markdown(text) == text


def test_a_fence_is_longer_than_any_in_its_text():
    code = "run x\n```\n<script>\n````"
    page = shown(f"{markdown_fence(code)}\n{code}\n{markdown_fence(code)}\n")
    assert page.tags == {"pre", "code"}
    assert page.text.rstrip("\n") == code


def test_data_in_a_script_element_cannot_end_it():
    data = {"a": "</script><!--<script>&'\"\u2028\u2029"}
    text = data_json(data)
    assert not set("<>&'\u2028\u2029") & set(text)
    assert json.loads(text) == data


@pytest.mark.parametrize("text", ["=1+1", "+1+1", "-1+1", "@SUM(A1)", "\t=1", "\r=1", "\n=1", "＝1", '=HYPERLINK("x")'])
def test_text_that_begins_a_formula_gets_an_apostrophe(text):
    frame = pd.DataFrame({"case": [text, "plain"], text: [1.0, -2.5]})
    found = pd.read_csv(io.StringIO(csv_text(frame), newline=""), keep_default_na=False)
    assert [name[0] for name in found.columns] == ["c", "'"]
    assert found["case"][0].startswith("'")
    assert found["case"][0][1:].strip() == text.strip()
    assert found.iloc[:, 1].tolist() == [1.0, -2.5]


def test_numbers_stay_numbers():
    frame = pd.DataFrame({"a": [-1.5, 2.0], "b": ["-1.5e-3", "+2"], "c": [None, -3.0], "d": ["-", "a-b"]})
    assert csv_text(frame) == "a,b,c,d\n-1.5,-1.5e-3,,-\n2,+2,-3,a-b\n"


def test_a_frame_keeps_its_names_and_is_not_changed():
    frame = pd.DataFrame([["=a", 1]], columns=["x", "x"])
    assert csv_text(frame) == "x,x\n'=a,1\n"
    assert frame.iloc[0, 0] == "=a"


def test_xml_holds_any_text():
    text = xml_text("a\x00\x1b[31m\ud800b\tc")
    assert ElementTree.fromstring(f"<a>{text}</a>").text == "a��[31m�b\tc"


HIDDEN = "a\x1b[2J\u202eb\u2066c\x9b\\u202e"


def test_hidden_characters_are_written_as_their_escape_sequences(tmp_path):
    shown = "a\\x1b[2J\\u202eb\\u2066c\\x9b"
    page = html_page(HIDDEN, HIDDEN, [Section("s", "s", [Text(HIDDEN)])])
    assert page.count(shown) == 4
    assert not re.search(
        "[\x1b\u202e\u2066\x9b]", page + markdown_page(HIDDEN, HIDDEN, []) + csv_text(pd.DataFrame({"a": [HIDDEN]}))
    )
    assert "\\u202eb" in xml_text(HIDDEN)
    assert json.loads(data_json({"a": HIDDEN}))["a"] == "a\\u001b[2J\\u202eb\\u2066c\\u009b\\u202e"
