"""The cards that come with the tool: readable, sourced, and the numbers that were published."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.card_lookup import card_text, catalogue, tool_folder
from lvnav_trade.filter.card import FilterCard
from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.quantities.errors import InputError

IMUS = sorted(file.stem for file in (tool_folder("configs") / "imu").glob("*.yaml"))
FILTERS = sorted(file.stem for file in (tool_folder("configs") / "filters").glob("*.yaml"))
G = 9.80665
DEG = math.pi / 180.0
HOUR = 3600.0


def imu(name: str) -> ImuCard:
    return ImuCard.model_validate(tree.plain_data(tree.read(tool_folder("configs") / "imu" / f"{name}.yaml")))


READINGS = ("_published", "_unbiased", "_3sigma")
"""Endings of cards that are another reading of a unit whose twin there is."""


SOLD = [name for name in IMUS if imu(name).second_hand]
"""Units that can be bought, with public data."""


@pytest.mark.parametrize("name", IMUS)
def test_an_inertial_unit_states_its_source(name: str) -> None:
    assert ("second hand" if name in SOLD and name != "kvh_1750" else "table") in imu(name).source


def test_imus_that_can_be_bought_mark_what_of_their_resources_is_assumed() -> None:
    assert len(SOLD) >= 8
    for name in SOLD:
        card = imu(name)
        assert None not in (card.resources.cost, card.resources.mass, card.resources.power, card.resources.volume)
        assert {"resources", "resources.cost"} & dict(card.assumed).keys()


@pytest.mark.parametrize("name", SOLD)
def test_every_number_of_a_product_says_that_it_is_second_hand_or_assumed(name: str) -> None:
    """None of the cards was written from the maker's own sheet."""
    card = imu(name)
    marked = {path for path, _ in (*card.assumed, *card.second_hand)}
    stated = {f"{sensor}.{field}" for sensor in ("gyro", "accel") for field in getattr(card, sensor).model_fields_set}
    assert stated | {"rate"} <= marked


@pytest.mark.parametrize("name", ["kvh_1750", "primus200"])
def test_an_in_run_bias_is_not_filed_as_the_bias_at_turn_on(name: str) -> None:
    """0.05 deg/h is an in-run figure of a fibre-optic gyro, whose offset, of the order of 1 deg/h, is apart."""
    card = imu(name)
    assert card.gyro.bias_instability == pytest.approx(0.05 * DEG / HOUR)
    assert card.gyro.bias_repeatability == pytest.approx(1.0 * DEG / HOUR)
    assert "gyro.bias_repeatability" in dict(card.assumed)
    assert "gyro.bias_instability" in dict(card.second_hand)


CARDS = sorted(
    file for file in tool_folder("configs").rglob("*.yaml") if file.parent.name not in ("gains", "requirements")
)


@pytest.mark.parametrize("file", CARDS, ids=lambda file: f"{file.parent.name}-{file.stem}")
def test_what_a_card_assumes_is_a_field_and_no_comment(file: Path) -> None:
    """Comments reach no report."""
    comments = [line.partition("# ")[2] for line in file.read_text(encoding="utf-8").splitlines()]
    assert not [comment for comment in comments if "assumed" in comment]


@pytest.mark.parametrize("name", FILTERS)
def test_a_filter_card_reads(name: str) -> None:
    data = tree.plain_data(tree.read(tool_folder("configs") / "filters" / f"{name}.yaml"))
    if "gains" in data:
        data["gains"] = tree.plain_data(tree.read(tool_folder("configs") / f"{data['gains']}.yaml"))
    card = FilterCard.model_validate(data)
    coupling = {
        "loose": ("position", "velocity"),
        "tight": ("pseudorange", "range_rate"),
        "tight_001": ("pseudorange",),
        "inertial": (),
        "uncoupled": (),
        "baseline": ("position", "velocity", "attitude"),
        "pad": ("zero_velocity",),
        "vehicle": ("position", "velocity", "attitude", "imu"),
    }
    assert card.measurements == coupling.get(name, coupling[name.partition("_")[0]])
    assert card.report_imu_samples == ("attitude" in card.measurements)


def test_the_numbers_of_a_published_table_become_si() -> None:
    # Trigo and Theil, table 1, column Tactical-MEMS; conversions by hand.
    card = imu("tactical_mems")
    assert card.gyro.random_walk == pytest.approx(0.2 * DEG / 60.0, rel=1e-12)
    assert card.gyro.rate_random_walk == pytest.approx(1.0 * DEG / HOUR / 60.0, rel=1e-12)
    assert card.gyro.g_sensitivity == pytest.approx(10.0 * DEG / HOUR / G, rel=1e-12)
    assert card.gyro.scale_factor_drift == pytest.approx(3500e-6 / math.sqrt(365.25 * 86400.0), rel=1e-12)
    assert card.accel.random_walk == pytest.approx(0.5e-3 * G, rel=1e-12)
    assert card.accel.rate_random_walk == pytest.approx(2e-3 * G / 60.0, rel=1e-12)
    assert card.accel.misalignment == pytest.approx(1e-3, rel=1e-12)


@pytest.mark.parametrize(
    "name", [name for name in IMUS if not (name.endswith(("_matched", *READINGS)) or name in SOLD)]
)
def test_a_matched_twin_holds_only_what_the_standard_filter_models(name: str) -> None:
    unit, twin = imu(name), imu(f"{name}_matched")
    for triad in ("gyro", "accel"):
        whole, part = getattr(unit, triad), getattr(twin, triad)
        assert part.model_fields_set <= {"random_walk", "rate_random_walk", "bias_repeatability"}
        for field in part.model_fields_set:
            assert getattr(part, field) == getattr(whole, field)


def test_the_readings_of_a_unit_differ_from_it_as_they_say() -> None:
    # sigma of a sample as density x rate in place of density x sqrt(rate); biases a thousandth
    unit, published, unbiased = (imu(f"kvh1750_003{ending}") for ending in ("", *READINGS[:2]))
    for triad in ("gyro", "accel"):
        plain, noisy, free = (getattr(card, triad) for card in (unit, published, unbiased))
        assert noisy.random_walk == pytest.approx(plain.random_walk * math.sqrt(200.0), rel=1e-6)
        assert noisy.bias_repeatability == plain.bias_repeatability
        assert free.random_walk == noisy.random_walk
        assert free.bias_repeatability == pytest.approx(1e-3 * plain.bias_repeatability)


def test_a_unit_at_its_three_sigma_bound_has_three_times_every_error() -> None:
    unit, bound = imu("navigation"), imu("navigation_3sigma")
    settings = {"bandwidth", "instability_time", "full_scale", "quantisation"}
    for triad in ("gyro", "accel"):
        one, three = getattr(unit, triad), getattr(bound, triad)
        for field in type(one).model_fields:
            value = getattr(one, field)
            if isinstance(value, float):
                factor = 1.0 if field in settings else 3.0
                assert getattr(three, field) == pytest.approx(factor * value, rel=1e-9), field


def test_the_catalogue_lists_the_users_cards_beside_the_tools(study) -> None:
    found = {card.name: card for card in catalogue(Path())}
    assert found["imu/good"].file == "configs/imu/good.yaml"
    assert found["imu/tactical_fog"].title.startswith("Tactical FOG")


def test_the_catalogue_of_a_folder_reads_no_other_card(study, monkeypatch: pytest.MonkeyPatch) -> None:
    read, names = tree.read_mapping, []

    def noted(file: Path) -> tree.Node:
        names.append(file.parent.name)
        return read(file)

    monkeypatch.setattr(tree, "read_mapping", noted)
    whole = [card for card in catalogue(Path()) if card.name.startswith("imu/")]
    names.clear()
    assert catalogue(Path(), "imu/") == whole
    assert set(names) == {"imu"}


def test_a_card_that_cannot_be_read_is_listed_and_not_an_end(study) -> None:
    study.write("configs/imu/broken.yaml", "a: [1\n")
    found = {card.name: card for card in catalogue(Path())}
    assert found["imu/broken"].title == "(cannot be read)"


def test_a_card_is_shown_with_its_comments() -> None:
    assert card_text("imu/conae_000", Path()).startswith("# The paper prints the noise as 0.7 deg/h")
    with pytest.raises(InputError, match=r"^no card 'imu/conae_001' \(did you mean 'imu/conae_000'\?\)$"):
        card_text("imu/conae_001", Path())


@pytest.mark.parametrize(("written", "near"), [("cards/mnie", "cards/mine"), ("cards/mnie.yaml", "cards/mine.yaml")])
def test_a_card_of_the_users_own_folder_is_offered_as_it_would_be_written(study, written: str, near: str) -> None:
    study.write("cards/mine.yaml", "name: mine\n")
    study.edit("campaign.yaml", "imu/good", written)
    with pytest.raises(InputError, match=rf"no card '{written}' \(did you mean '{near}'\?\)$"):
        load("campaign.yaml")
