"""A digest covers what has an effect on the results of a case."""

from __future__ import annotations

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.definition.case_digest import case_id
from lvnav_trade.campaign.reading.load import load
from tests.trajectory.flight_cases import ascent_card, ascent_settings


def test_a_digest_does_not_take_another_card_for_one_that_is_gone(study):
    """What is kept holds the card itself: a later one cannot stand at its place in memory."""
    campaign, kept = load("campaign.yaml"), {}
    scenario = campaign.base
    case_id(scenario, 1, 1.0, kept)
    assert all(id(card) == place for place, (card, _) in kept.items())
    assert case_id(scenario, 1, 1.0, kept) == case_id(scenario, 1, 1.0)


def test_spreads_that_no_run_uses_are_in_no_digest(study) -> None:
    def digest(**changes):
        card = ascent_card(**changes)
        scenario = cases(load(study.path))[0].scenario.model_copy(update={"trajectory": card})
        return case_id(scenario, 1, 1.0)

    settings = ascent_settings()["vehicle"]
    bare = {name: value for name, value in settings.items() if name != "dispersions"}
    assert digest() == digest(vehicle=bare)
    guided = {"guidance": "explicit", "dispersion": {"draw": "all"}}
    assert digest(**guided) != digest()
    other = {**settings, "dispersions": {**settings["dispersions"], "thrust": "2 %"}}
    assert digest(**guided) != digest(**guided, vehicle=other)
    assert digest(guidance="explicit") != digest(guidance="open_loop")
