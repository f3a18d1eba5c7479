"""The page answers in words, carries everything in itself, and has a Markdown twin and CSV tables."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from itertools import pairwise

import pandas as pd
import pytest

from lvnav_trade.errors import InputError
from lvnav_trade.report import SECTIONS, build
from lvnav_trade.report.blocks import number, percent
from tests import synthetic


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = synthetic.results(tmp_path_factory.mktemp("report") / "synthetic", n_run=80, failing=(3,))
    return build(folder)


@pytest.fixture(scope="module")
def text(page):
    return page.read_text(encoding="utf-8")


class Links(HTMLParser):
    """Collect what a page would load."""

    def __init__(self):
        super().__init__()
        self.found, self.open = [], []

    def handle_starttag(self, tag, attributes):
        self.found += [value for name, value in attributes if name in ("src", "href")]
        if tag not in ("meta", "img", "br", "link"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_loads_nothing_and_is_well_formed(text):
    links = Links()
    links.feed(text)
    assert links.open == []
    assert all(link.startswith(("data:image/png;base64,", "#")) for link in links.found)
    assert "<script" not in text
    assert not re.search(r"url\(|@import|http://|https://", text.split("<main>")[0])


def test_the_page_is_small(page):
    assert page.stat().st_size < 5e6


def test_the_first_section_answers_in_words(text):
    first = text[text.index('id="summary"') : text.index('id="requirements"')]
    assert "Met by" in first
    assert "Violated by" in first
    assert "further good runs would decide" in first
    assert "Largest source in the 3D error, by linear covariance: imu=coarse: gyro bias (75 % of the variance)" in first
    assert "2 of 160 runs failed" in first


def test_every_section_stands_on_the_page(text):
    for name in SECTIONS:
        assert f'<section id="{name}">' in text


def test_the_markdown_twin_has_its_pictures_and_the_same_verdicts(page):
    twin = (page.parent / "report.md").read_text(encoding="utf-8")
    pictures = re.findall(r"!\[[^]]*\]\((figures/[^)]+)\)", twin)
    assert len(pictures) > 10
    assert all((page.parent / name).exists() for name in pictures)
    assert len(set(pictures)) == len(list((page.parent / "figures").iterdir()))
    assert "| loose bound | imu=fine | met |" in twin
    assert "&" + "#39;" not in twin


def test_markdown_tables_have_as_many_cells_in_every_row(page):
    lines = (page.parent / "report.md").read_text(encoding="utf-8").splitlines()
    for line, after in pairwise(lines):
        if line.startswith("|") and after.startswith("|"):
            assert line.count("|") == after.count("|")


@pytest.mark.parametrize("name", ["rms", "agreement", "references", "requirements"])
def test_csv_tables_stand_beside_the_page(page, name):
    assert len(pd.read_csv(page.parent / f"{name}.csv")) > 0


def test_a_second_report_has_the_same_bytes(page, text):
    twin = (page.parent / "report.md").read_bytes()
    figures = {file.name: file.read_bytes() for file in (page.parent / "figures").iterdir()}
    build(page.parent)
    assert (page.parent / "report.md").read_bytes() == twin
    assert {file.name: file.read_bytes() for file in (page.parent / "figures").iterdir()} == figures
    assert page.read_text(encoding="utf-8") == text


def test_linear_covariance_alone_makes_a_report(tmp_path):
    text = build(synthetic.results(tmp_path, n_run=0)).read_text(encoding="utf-8")
    assert "linear covariance only" in text
    assert "nan" not in re.sub(r"base64,[^\"]+|<style>.*?</style>", "", text, flags=re.S).lower()


def test_sections_can_be_chosen_and_a_wrong_name_is_a_users_error(tmp_path):
    folder = synthetic.results(tmp_path, n_run=0)
    text = build(folder, ["references", "summary"]).read_text(encoding="utf-8")
    assert text.index('id="references"') < text.index('id="summary"')
    assert 'id="trajectory"' not in text
    with pytest.raises(InputError, match="did you mean summary"):
        build(folder, ["sumary"])


def test_what_a_campaign_says_is_escaped(tmp_path):
    campaign = synthetic.CAMPAIGN.replace("Two grades drawn", "<b>Two</b> & grades drawn")
    text = build(synthetic.results(tmp_path, n_run=0, campaign=campaign), ["summary"]).read_text(encoding="utf-8")
    assert "&lt;b&gt;Two&lt;/b&gt; &amp; grades" in text


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (0.0, "0"), (1234.5, "1230"), (0.012345, "0.0123"), (9.996, "10.0"), (1.0, "1.00"), (1e-7, "1.00e-07"),
        (float("nan"), "–"), (float("inf"), "∞"), (7, "7"), (-45.67, "-45.7"),
    ],
)  # fmt: skip
def test_numbers_have_three_significant_digits(value, told):
    assert number(value) == told


def test_percent_does_not_round_a_requirement_away():
    assert percent(0.9973) == "99.73 %"
