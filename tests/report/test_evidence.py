"""Every section stands on the page."""

from __future__ import annotations

import re

from lvnav_trade.report import SECTIONS, build
from tests import synthetic


def test_every_section_stands_on_the_page(text):
    for name in SECTIONS:
        assert f'<section id="{name}">' in text


def test_linear_covariance_alone_makes_a_report(tmp_path):
    text = build(synthetic.results(tmp_path, n_run=0)).read_text(encoding="utf-8")
    assert "linear covariance only" in text
    assert "nan" not in re.sub(r"base64,[^\"]+|<style>.*?</style>", "", text, flags=re.S).lower()
