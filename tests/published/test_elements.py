"""The page on elements of the publications: every module, test, campaign and decision that it names exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PAGE = "docs/published_elements.md"
FOLDERS = ("lvnav_trade", "tests", "campaigns")
NAMED = re.compile(r"`([\w/]+\.(?:py|yaml))`")


def lines(root: Path) -> list[list[str]]:
    rows = [line for line in (root / PAGE).read_text().splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows if not row.startswith("| element |")]


@pytest.mark.parametrize("column", [1, 2, 3])
def test_what_the_page_names_exists(root: Path, column: int) -> None:
    named = [name for row in lines(root) for name in NAMED.findall(row[column])]
    assert len(named) > 50
    assert [name for name in named if not (root / FOLDERS[column - 1] / name).is_file()] == []


def test_every_element_is_simulated_or_refused_with_a_reason(root: Path) -> None:
    for element, module, test, campaign in lines(root):
        assert campaign, element
        if not module:  # refused: the last column says why
            assert not test, element
            assert not NAMED.search(campaign), element
            assert len(campaign) > 40, element


def test_every_campaign_of_a_study_that_simulates_an_element_belongs_to_its_folder(root: Path) -> None:
    for study in ("conae", "dlr", "drdc", "gains"):
        named = {name for row in lines(root) for name in NAMED.findall(row[3]) if name.startswith(f"{study}/")}
        listed = re.findall(r"- campaign: (\w+)", (root / f"campaigns/{study}/study.yaml").read_text())
        assert {Path(name).stem for name in named} <= set(listed)
