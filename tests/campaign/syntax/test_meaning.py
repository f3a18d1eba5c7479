"""Words that people use lead to the names that mean the same, not to those that look alike."""

from __future__ import annotations

import json

import pytest

from lvnav_trade.campaign.reading.field_reference import json_schema
from lvnav_trade.campaign.syntax.card_lookup import Shelf, card_text
from lvnav_trade.campaign.syntax.meaning import MEANINGS, find_synonym
from lvnav_trade.campaign.syntax.tree import hint
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.scenario.scenario import Scenario

SCENARIO = tuple(Scenario.model_fields)


@pytest.mark.parametrize(
    ("word", "name"),
    [("rocket", "trajectory"), ("GPS", "receiver"), ("mems", "imu"), ("kalman", "filter"), ("failures", "faults")],
)
def test_a_word_of_the_field_leads_to_what_it_means(word, name):
    assert hint(word, SCENARIO) == f" (did you mean {name!r}?)"


def test_a_sextant_is_a_star_tracker_and_not_what_is_spelt_like_it():
    assert hint("sextant", ["sensors", "sections", "star_tracker"]) == " (did you mean 'star_tracker'?)"
    assert hint("sextant", ["sensors", "sections"]) == ""


def test_letters_decide_where_a_word_has_no_meaning_of_its_own():
    assert hint("trajectry", SCENARIO) == " (did you mean 'trajectory'?)"


def test_a_card_is_found_by_meaning(root, tmp_path):
    with pytest.raises(InputError, match="did you mean 'star_trackers/"):
        card_text("sextant", tmp_path)


def test_the_nearest_of_several_is_the_name_itself():
    assert find_synonym("lag", ["latency_sigma", "latency"]) == "latency"


def test_every_meaning_is_a_part_of_a_name_that_can_be_written(root):
    schema, cards = json.dumps(json_schema()), " ".join(Shelf.from_folder(root).card_names())
    parts = {part for parts in MEANINGS.values() for part in parts}
    assert sorted(part for part in parts if part not in schema and part not in cards) == []
