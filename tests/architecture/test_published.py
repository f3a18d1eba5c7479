"""What is published: cards name their sources, and no text mentions the place where it was written."""

from __future__ import annotations

import json
import re

import pytest
from ruamel.yaml import YAML

from lvnav_trade.results.tables.contents import owned_folder

TEXT = {".py", ".md", ".yaml", ".yml", ".toml", ".csv", ".txt", ".html", ".j2", ".css", ".svg", ".cfg", ""}
# Spelt in pieces, so that this file does not find itself.
PRIVATE = re.compile(
    "|".join(
        [
            r"(?<![\w.$/}-])/" + r"(work|tmp|root|home)/",  # folders of one machine
            r"\bissues?" + r"\s*#?\s*\d",  # a tracker's numbers, which a reader of the archive cannot follow
            r"\bTO" + r"DO\b|\bFIX" + r"ME\b|\bX" + r"XX\b",
        ]
    )
)
MARKS = ("/" + "work/", "/" + "tmp/", "/" + "root/", "/" + "home/", "issue", "TO" + "DO", "FIX" + "ME", "X" + "XX")
"""Every match of the pattern contains one of these, and they are found ten times as fast."""


def test_no_text_mentions_a_private_folder_a_ticket_or_unfinished_work(published, root):
    found = []
    for path in published:
        if path.suffix not in TEXT:
            continue
        text = path.read_text(errors="replace")
        if not any(mark in text for mark in MARKS):
            continue
        for number, line in enumerate(text.splitlines(), 1):
            if PRIVATE.search(line):
                found.append(f"{path.relative_to(root)}:{number}: {line.strip()[:100]}")
    assert found == []


@pytest.mark.parametrize(
    "text", ["see /" + "work/a", "(/" + "home/b", "issue" + " #3", "issues" + " 12", "TO" + "DO: c"]
)
def test_what_must_not_be_mentioned_is_found(text):
    assert PRIVATE.search(text)
    assert any(mark in text for mark in MARKS)


def test_every_card_names_its_source(root):
    cards = sorted((root / "configs").rglob("*.yaml"))
    assert cards
    yaml = YAML(typ="safe")
    bare = [str(card.relative_to(root)) for card in cards if not str(yaml.load(card).get("source", "")).strip()]
    assert bare == []


def test_every_campaign_says_what_it_asks(root):
    found = (root / "campaigns").rglob("*.yaml")
    campaigns = sorted(path for path in found if not {"configs", "statements"} & set(path.parts))
    assert {path.stem for path in campaigns} >= {"demo", "smoke"}
    yaml = YAML(typ="safe")
    assert [path.name for path in campaigns if not yaml.load(path).get("description")] == []


def _is_part(shown: object, whole: object) -> bool:
    """Return whether everything shown is in the whole; a list has all its members."""
    if isinstance(shown, dict):
        return isinstance(whole, dict) and all(key in whole and _is_part(shown[key], whole[key]) for key in shown)
    if isinstance(shown, list):
        return isinstance(whole, list) and len(shown) == len(whole) and all(map(_is_part, shown, whole))
    return shown == whole


def test_the_readme_shows_the_demo_campaign_but_for_sources_and_margins(root):
    yaml = YAML(typ="safe")
    shown = yaml.load((root / "README.md").read_text().split("```yaml\n")[1].split("```")[0])
    asked = yaml.load(root / "campaigns" / "demo.yaml")
    assert _is_part(shown, asked)
    assert set(asked) - set(shown) <= {
        "description", "references", "report", "keep", "covariance", "margin_policy", "document"
    }  # fmt: skip
    left_out = {
        key
        for mine, whole in zip(shown["requirements"], asked["requirements"], strict=True)
        for key in whole.keys() - mine.keys()
    }
    assert left_out == {"id", "parent", "source", "rationale", "verification"}


def test_every_decision_stands_in_the_map_of_the_documents(root):
    docs = (root / "docs" / "README.md").read_text()
    decisions = sorted(path.name for path in (root / "docs" / "decisions").glob("*.md"))
    assert [name for name in decisions if f"(decisions/{name})" not in docs] == []


def test_every_link_between_documents_leads_to_a_file(published, root):
    link = re.compile(r"\]\((?![a-z]+:|#)([^)#\s]+)")
    broken = [
        f"{path.relative_to(root)}: {target}"
        for path in published
        if path.suffix == ".md"
        for target in link.findall(path.read_text())
        if not (path.parent / target).exists()
    ]
    assert broken == []


def test_every_kept_report_lists_its_files(root):
    folders = [page.parent for page in (root / "reports").rglob("report.md")]
    assert len(folders) > 10
    for folder in folders:
        kind = json.loads((folder / "contents.json").read_text())["kind"]
        found = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
        assert found - {"contents.json"} <= owned_folder(folder, kind).names
