"""The verbs that tell what there is: schema, cards, status."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest

from lvnav_trade.campaign.syntax import card_lookup
from tests.cli.calling import call

_catalogue = cache(card_lookup.catalogue)


@pytest.fixture
def read_once(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Work in an empty folder, the same for all tests, in which the cards of the tool are read once."""
    monkeypatch.chdir(tmp_path_factory.getbasetemp())
    monkeypatch.setattr(card_lookup, "catalogue", _catalogue)


def test_the_schema_knows_cards_and_every_key() -> None:
    schema = json.loads(call("schema").stdout)
    assert set(schema["properties"]) >= {"name", "seed", "base", "axes", "design", "monte_carlo", "requirements"}
    assert schema["additionalProperties"] is False
    imu = schema["$defs"]["ImuCard"]["anyOf"]
    assert imu[0]["type"] == "string"
    assert "card" in imu[1]["properties"]


def test_the_cards_are_listed_and_shown_with_their_sources(read_once: None) -> None:
    listed = call("cards").stdout
    assert "imu/tactical_fog" in listed
    assert "Trigo and Theil" not in listed
    assert "Trigo and Theil" in call("cards", "imu", "--long").stdout
    shown = call("cards", "imu/tactical_fog").stdout
    assert 'random_walk: "0.03 deg/sqrt(h)"' in shown
    wrong = call("cards", "imu/tactical_fogg")
    assert (wrong.exit_code, wrong.stderr) == (2, "no card 'imu/tactical_fogg' (did you mean 'imu/tactical_fog'?)\n")


def test_the_status_is_reported_in_words_and_as_json(variants: Path) -> None:
    result = call("status", str(variants / "base"))
    assert (result.exit_code, result.stdout.startswith(f"{variants / 'base'}: finished: ")) == (0, True)
    content = json.loads(call("status", str(variants / "base"), "--json").stdout)
    assert (content["verb"], content["state"], content["damaged_files"]) == ("status", "finished", [])
    assert call("status", str(variants)).exit_code == 2


def test_fields_are_listed_with_default_and_what_they_take() -> None:
    shown = call("fields", "receiver.clock").output
    assert "initial_bias   0         length (m, km, cm)" in shown
    assert (
        "kind: clock_jump - Single jump of the receiver clock, in metres of range." in call("fields", "faults").output
    )
    part = json.loads(call("fields", "receiver.clock", "--json").stdout)["parts"][0]
    assert part["rows"][0] == {"field": "h0", "type": "number", "default": "required", "meaning": ""}
    assert call("fields", "receiver.clok").exit_code == 2


def test_the_cards_of_a_folder_are_listed(read_once: None) -> None:
    shown = call("cards", "constellations").output.splitlines()
    assert all(line.startswith("constellations/") for line in shown[1:])
    assert call("cards", "constellations/").output.splitlines() == shown
