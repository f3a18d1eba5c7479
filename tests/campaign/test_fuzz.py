"""Mutants of campaigns, cards, quantities and files of data: no traceback, no hang, and nothing that was not meant."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.campaign import fuzz
from tests.campaign.study import make

QUICK, LONG = 50, 2_500  # of each of four sorts
ODDLY = {"deadline": None, "derandomize": True, "database": None, "suppress_health_check": list(HealthCheck)}


def often(count: int) -> Callable[[Any], Any]:
    return settings(max_examples=count, **ODDLY)  # type: ignore[arg-type]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def fresh(folder: Path) -> Path:
    return make(folder, fuzz.CAMPAIGN)


def test_the_campaign_that_is_mutated_is_accepted_and_means_what_it_says(folder: Path) -> None:
    found = fuzz.read(fresh(folder))
    assert found is not None
    fuzz.is_meant(*found)
    assert len(found[1]) == 8
    for file, text, path, units in fuzz.QUANTITIES:
        assert text in (folder / file).read_text(encoding="utf-8")
        assert fuzz.value_at(found[0], path) == pytest.approx(fuzz.stated(text.strip('"'), units), rel=1e-12)


def mutate_quantity(folder: Path, data: st.DataObject) -> None:
    """One quantity becomes another text: it is refused, or read as a grammar of its own reads it."""
    fresh(folder)
    file, old, path, units = data.draw(st.sampled_from(fuzz.QUANTITIES))
    new = data.draw(fuzz.quantities())
    place = folder / file
    escaped = new.replace("\\", "\\\\").replace('"', '\\"').replace("\t", "\\t")
    place.write_text(place.read_text(encoding="utf-8").replace(old, f'"{escaped}"', 1), encoding="utf-8")
    found = fuzz.read(folder / "campaign.yaml")
    wanted = fuzz.stated(new, units)
    if found is not None:
        assert wanted is not None, f"{new!r} was read at {path}"
        assert fuzz.value_at(found[0], path) == pytest.approx(wanted, rel=1e-12, abs=0.0), new


def mutate_campaign(folder: Path, data: st.DataObject) -> None:
    """Words, lines and characters of the campaign change."""
    file = fresh(folder)
    file.write_text(data.draw(fuzz.rewritten(file.read_text(encoding="utf-8"))), encoding="utf-8", newline="")
    found = fuzz.read(file)
    if found is not None:
        fuzz.is_meant(*found)


def mutate_card(folder: Path, data: st.DataObject) -> None:
    """Words, lines and characters of a card change."""
    campaign = fresh(folder)
    cards = sorted(folder.glob("configs/*/*.yaml"))
    file = data.draw(st.sampled_from(cards))
    file.write_text(data.draw(fuzz.rewritten(file.read_text(encoding="utf-8"))), encoding="utf-8", newline="")
    found = fuzz.read(campaign)
    if found is not None:
        fuzz.is_meant(*found)


def mutate_table(folder: Path, data: st.DataObject) -> None:
    """Words, lines and characters of a file of data change."""
    file = folder / "rows.csv"
    file.write_text(data.draw(fuzz.rewritten(fuzz.TABLE)), encoding="utf-8", newline="")
    fuzz.read_table(file)


SORTS = [mutate_quantity, mutate_campaign, mutate_card, mutate_table]


@pytest.mark.parametrize("mutate", SORTS, ids=lambda one: one.__name__)
def test_a_mutant_is_refused_in_short_lines_or_means_what_it_says(folder: Path, mutate: Callable[..., None]) -> None:
    @often(QUICK)
    @given(st.data())
    def each(data: st.DataObject) -> None:
        mutate(folder, data)

    each()


@pytest.mark.slow
@pytest.mark.parametrize("mutate", SORTS, ids=lambda one: one.__name__)
def test_so_is_each_of_many(folder: Path, mutate: Callable[..., None]) -> None:
    @often(LONG)
    @given(st.data())
    def each(data: st.DataObject) -> None:
        mutate(folder, data)

    each()
