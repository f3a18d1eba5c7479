"""The page carries everything in itself, and has a Markdown twin and CSV tables."""

from __future__ import annotations

import base64
import hashlib
import importlib
import inspect
import json
import re
import shutil
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pandas as pd
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.report import build, keep
from lvnav_trade.report.blocks import number
from lvnav_trade.report.build import html_page, make, markdown_page
from lvnav_trade.results.evaluation import CSV, METRICS
from lvnav_trade.results.tables.dictionary import REPORTED
from lvnav_trade.results.tables.read import load
from lvnav_trade.results.tables.write import open_results
from tests import synthetic


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
    assert all(link.startswith("#") for link in links.found)
    scripts = re.findall(r"<script([^>]*)>", text)
    assert set(scripts) == {"", ' type="application/json"', ' type="application/json" class="grades"'}
    assert not re.search(r"fetch\(|XMLHttpRequest|import\(", text)
    assert not re.search(r"url\(|@import|http://|https://", text.split("<main>")[0])


def test_the_only_script_that_may_run_is_the_one_on_the_page(text):
    allowed = re.search(r"script-src 'sha256-([^']+)'", text)[1]
    script = re.search(r"<script>(.*?)</script>", text, flags=re.S)[1]
    assert base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() == allowed


def test_the_control_holds_the_numbers_of_its_table(text):
    data = json.loads(re.search(r'class="grades">(.*?)</script>', text, flags=re.S)[1])
    attitude = next(row for row in data if row["case"] == "imu=fine" and row["metric"].startswith("attitude"))
    source = attitude["sources"][0]
    assert source["name"] == "gyro bias"
    frozen = (attitude["square"] + 99.0 * source["square"]) ** 0.5
    tuned = dict(map(tuple, source["retuned"]))[10.0]
    assert f"<td>{number(frozen)} / {number(tuned)}</td>" in re.sub(r'<td class="[^"]*">', "<td>", text)


def test_a_report_is_kept_without_its_html(page, kept):
    assert {"report.md", "budget.csv", "figures"} <= {file.name for file in kept.parent.iterdir()}
    assert not list(kept.parent.glob("*.html"))
    assert (kept.parent / "budget.csv").read_bytes() == (page.parent / "budget.csv").read_bytes()


def test_a_report_that_is_kept_again_replaces_what_it_wrote_and_nothing_else(page, kept, monkeypatch):
    twin, kept = kept.read_bytes(), kept.parent
    drawn = {f"figures/{file.name}": file.read_bytes() for file in (kept / "figures").iterdir()}
    monkeypatch.setattr(importlib.import_module("lvnav_trade.report.build"), "pictures", lambda sections: drawn)
    own = {"figures/mine.png": b"a photo", "mine.csv": b"a,b\n", "notes.md": b"mine"}
    for name, content in own.items():
        (kept / name).write_bytes(content)
    listing = json.loads((kept / "contents.json").read_text())
    listing["files"]["report"].append("figures/of-an-earlier-report.png")
    (kept / "contents.json").write_text(json.dumps(listing))
    (kept / "figures/of-an-earlier-report.png").write_bytes(b"ours")
    (kept / "report.md").write_text("old")
    keep(page.parent, kept)
    assert {name: (kept / name).read_bytes() for name in own} == own
    assert not (kept / "figures/of-an-earlier-report.png").exists()
    assert {f"figures/{file.name}" for file in (kept / "figures").iterdir()} == {*drawn, "figures/mine.png"}
    assert (kept / "report.md").read_bytes() == twin
    for name in own:
        (kept / name).unlink()


def test_a_page_is_kept_without_its_tables_where_these_are_not_wanted(page, tmp_path, monkeypatch):
    module = importlib.import_module("lvnav_trade.report.build")
    made = make(load(page.parent))
    monkeypatch.setattr(module, "pictures", lambda sections: {})
    monkeypatch.setattr(module, "make", lambda tables: made)
    assert (keep(page.parent, tmp_path / "kept").parent / "rms.csv").exists()
    assert keep(page.parent, tmp_path / "kept", writes_tables=False).exists()
    assert not list((tmp_path / "kept").glob("*.csv"))


@pytest.mark.parametrize("name", ["data.csv", "figures/photo.png", "report.md", "contents.json", "manifest.json"])
def test_a_folder_of_the_users_own_is_refused_and_left_as_it_is(page, tmp_path, name):
    mine = tmp_path / "mine" / name
    mine.parent.mkdir(parents=True)
    mine.write_text('{"mine": true}')
    with pytest.raises(InputError, match="nothing was changed; give another folder") as caught:
        keep(page.parent, tmp_path / "mine")
    assert "\n" not in str(caught.value)
    assert [path for path in (tmp_path / "mine").rglob("*") if path.is_file()] == [mine]
    assert mine.read_text() == '{"mine": true}'


def test_a_report_built_again_leaves_the_users_own_files_in_the_results(tmp_path):
    folder = synthetic.results(tmp_path, n_run=0)
    build(folder, ["summary"])
    (folder / "figures").mkdir(exist_ok=True)
    for name in ("figures/mine.png", "mine.csv"):
        (folder / name).write_text("mine")
    build(folder, ["references"])
    assert (folder / "figures/mine.png").read_text() == (folder / "mine.csv").read_text() == "mine"


def test_names_and_descriptions_are_plain_text_in_the_markdown_page(tmp_path):
    campaign = synthetic.CAMPAIGN.replace("Two grades drawn", "'<script>alert(1)</script> [a](b) | Two grades drawn")
    campaign = campaign.replace("'<script>", "<script>")
    folder = synthetic.results(tmp_path, n_run=0, campaign=campaign)
    tables = load(folder)
    text = markdown_page(*make(tables, ["summary"])[:3])
    assert "&lt;script>alert(1)&lt;/script> [a\\](b)" in text
    assert "<script" not in text


def test_the_page_is_small(page):
    assert page.stat().st_size < 5e6


def test_the_markdown_twin_has_its_pictures_and_the_same_verdicts(kept):
    twin = kept.read_text(encoding="utf-8")
    pictures = re.findall(r"!\[[^]]*\]\((figures/[^)]+)\)", twin)
    assert len(pictures) > 10
    assert all((kept.parent / name).exists() for name in pictures)
    assert len(set(pictures)) == len(list((kept.parent / "figures").iterdir()))
    assert "| loose bound | imu=fine | met |" in twin
    assert "&" + "#39;" not in twin


def test_markdown_tables_have_as_many_cells_in_every_row(kept):
    lines = kept.read_text(encoding="utf-8").splitlines()
    for line, after in pairwise(lines):
        if line.startswith("|") and after.startswith("|"):
            assert line.count("|") == after.count("|")


@pytest.mark.parametrize("name", ["rms", "agreement", "references", "requirements"])
def test_csv_tables_stand_beside_the_page(page, name):
    assert len(pd.read_csv(page.parent / f"{name}.csv")) > 0


def test_a_second_report_has_the_same_bytes(page, text):
    build(page.parent)
    assert page.read_text(encoding="utf-8") == text


def test_figures_are_written_where_they_are_asked_for(tmp_path):
    folder = synthetic.results(tmp_path, n_run=0)
    build(folder, ["summary"])
    assert not (folder / "figures").exists()
    build(folder, ["summary"], ("png", "svg"))
    assert {file.name for file in (folder / "figures").iterdir()} == {"ranking.png", "ranking.svg"}


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


def test_the_report_names_cases_by_their_cards_and_tables_for_programs_by_their_labels(page):
    tables = load(page.parent)
    cards = {"path": "imu", "labels": ["fine", "coarse"], "values": [{"name": "Ring laser"}, {"name": "MEMS"}]}
    tables.__dict__["campaign"] = {**tables.campaign, "axes": [cards]}
    made = make(tables, ["summary", "requirements", "consistency"])
    shown = html_page(made.title, made.question, made.sections)
    assert "Ring laser" in shown
    assert "imu=fine" not in shown
    of_cards = made.csv.pop("configuration.csv")  # lists cards by name
    assert "imu=fine,IMU,Ring laser" in of_cards
    assert "Ring laser" not in "".join(made.csv.values())
    assert "imu=fine" in made.csv["requirements.csv"]


def test_a_brief_report_keeps_what_a_board_looks_for(page):
    brief = build(page.parent, brief=True).read_text(encoding="utf-8")
    for name in ("consistency", "agreement", "reproduce"):
        assert f'<section id="{name}"' in brief
    for name in ("satellites", "tracking"):
        assert f'id="{name}"' not in brief


def test_a_campaign_whose_every_case_failed_has_a_report_that_says_why(tmp_path):
    lost = ["imu=good: linear covariance: ValueError: not positive"]
    written = open_results(tmp_path / "failed", "synthetic", synthetic.CAMPAIGN, {"seed": 7}, "resume")
    written.finish({"timings_s": {}, "cases": [], "lost": lost}, None)
    shown = build(tmp_path / "failed").read_text(encoding="utf-8")
    assert "No case could be computed" in shown
    assert lost[0] in shown
    for name, metric in METRICS.items():  # and no table of the report or the terminal stumbles over it
        if len(inspect.signature(metric).parameters) == 1:
            assert len(metric(tmp_path / "failed")) == 0, name


def test_tables_without_rows_are_not_written_and_each_other_one_has_its_feature(page, tmp_path):
    folder = page.parent
    written = {file.name for file in folder.glob("*.csv")}
    assert {"rms.csv", "requirements.csv", "references.csv", "sensitivity.csv"} <= written
    assert not {"corridor.csv", "mode_transitions.csv", "protection.csv"} & written
    assert all(len(pd.read_csv(folder / name)) for name in written)
    listed = json.loads((folder / "contents.json").read_text())["tables"]
    assert {name for name in listed if name.endswith(".csv")} == written
    assert listed["references.csv"] == "published numbers (references)"
    # a report of results without references and sensitivity leaves none behind
    again = Path(shutil.copytree(folder, tmp_path / "again"))
    tables = load(again)
    tables.__dict__["campaign"] = {key: value for key, value in tables.campaign.items() if key != "references"}
    assert "references.csv" not in make(tables).csv


def test_every_csv_table_has_a_feature():
    assert set(REPORTED) == {*CSV, "models"}
