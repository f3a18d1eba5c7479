"""Cards of the atmosphere: read, refused, matched."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from lvnav_trade.gnss.delay_cards import (
    AtmosphereCard,
    BeanThayerProfile,
    ContentIonosphere,
    CorrectionsCard,
    NoIonosphere,
    NoTroposphere,
    RayTracedTroposphere,
    SpilkerTroposphere,
    correction_models,
)


def test_without_settings_nothing_is_true_and_nothing_is_corrected():
    atmosphere, corrections = AtmosphereCard(), CorrectionsCard()
    assert atmosphere.troposphere == NoTroposphere()
    assert atmosphere.ionosphere == NoIonosphere()
    assert (atmosphere.troposphere_scale, atmosphere.troposphere_scale_time) == (0.0, None)
    assert correction_models(corrections, atmosphere) == (NoTroposphere(), NoIonosphere())


def test_a_card_is_read_with_its_units():
    card = AtmosphereCard.model_validate(
        {
            "troposphere": {"kind": "ray_traced", "profile": {"kind": "bean_thayer", "surface": 340.0}},
            "ionosphere": {"kind": "content", "vertical": "20 TECU", "peak": "400 km", "slant": "integrated"},
            "troposphere_scale": "5 percent",
            "troposphere_scale_time": "600 s",
        }
    )
    assert card.troposphere == RayTracedTroposphere(profile=BeanThayerProfile(surface=340.0))
    assert card.ionosphere == ContentIonosphere(vertical="2e17 1/m^2", peak="400 km", slant="integrated")
    assert (card.ionosphere.vertical, card.ionosphere.peak) == (2e17, 400e3)
    assert (card.troposphere_scale, card.troposphere_scale_time) == (0.05, 600.0)


@pytest.mark.parametrize("kind", ["none", "ray_traced", "any_elevation", "spilker", "stanag", "saastamoinen", "niell"])
def test_every_model_reads_back_from_its_own_text(kind):
    card = AtmosphereCard.model_validate({"troposphere": {"kind": kind}})
    assert AtmosphereCard.model_validate(card.model_dump(mode="json")) == card
    assert hash(card.troposphere) == hash(AtmosphereCard.model_validate({"troposphere": {"kind": kind}}).troposphere)


def test_matched_takes_the_model_that_is_true():
    atmosphere = AtmosphereCard(troposphere=RayTracedTroposphere(), ionosphere=ContentIonosphere())
    corrections = CorrectionsCard.model_validate(
        {"troposphere": {"kind": "matched"}, "ionosphere": {"kind": "matched"}}
    )
    assert correction_models(corrections, atmosphere) == (atmosphere.troposphere, atmosphere.ionosphere)
    other = CorrectionsCard(troposphere=SpilkerTroposphere())
    assert correction_models(other, atmosphere) == (SpilkerTroposphere(), NoIonosphere())


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"troposphere": {"kind": "hopfield"}}, "hopfield"),
        ({"troposphere": {"kind": "matched"}}, "matched"),
        ({"troposphere": {"kind": "ray_traced", "profile": {"kind": "standard", "wet": 200.0}}}, "traps rays"),
        ({"troposphere": {"kind": "ray_traced", "profile": {"kind": "bean_thayer", "surface": 500.0}}}, "450"),
        ({"troposphere": {"kind": "ray_traced", "satellite_radius": "7000 km"}}, "12000000"),
        ({"troposphere": {"kind": "niell", "humidity": "120 percent"}}, "less than or equal to 1"),
        ({"troposphere": {"kind": "spilker", "zenith": 2.4}}, "no unit"),
        ({"ionosphere": {"kind": "klobuchar", "alpha": [1e-8, 0, 0, 0]}}, "beta"),
        ({"ionosphere": {"kind": "content", "vertical": "20 m"}}, "TECU"),
        ({"troposphere_scale": "-1 percent"}, "greater than or equal to 0"),
    ],
)
def test_what_cannot_be_meant_is_refused(settings, words):
    with pytest.raises(ValidationError, match=words):
        AtmosphereCard.model_validate(settings)
