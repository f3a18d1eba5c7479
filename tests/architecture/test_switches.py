"""Every model that a card can choose is chosen by a shipped campaign, or is listed here with a reason."""

from __future__ import annotations

import sys
import typing
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.units import Card
from lvnav_trade.simulation.recorded import navigation_log, receiver_file

OF_LOGS = (navigation_log.NavigationLog, receiver_file.ReceiverFile)  # no campaign imports them

ROOT = Path(__file__).parents[2]
ROOMS = (
    "lvnav_trade.filter",
    "lvnav_trade.gnss",
    "lvnav_trade.imu",
    "lvnav_trade.scenario",
    "lvnav_trade.sensors",
    "lvnav_trade.simulation.recorded",
    "lvnav_trade.trajectory",
)
FILES = "a form of the user's own files, which tests read"
STUDIES = "of a published system; its tests fly it"
TESTED = "a variant of a model that is used; its tests compare both"
STEERING = "how a user's own vehicle turns, beside the one that the shipped flights use"
ELSEWHERE = {
    "AlmanacConstellation": FILES,
    "PreciseConstellation": FILES,
    "RinexConstellation": FILES,
    "AttitudeColumns.form": FILES,
    "AttitudeColumns.frame": FILES,
    "PositionColumns.frame": FILES,
    "VelocityColumns.frame": FILES,
    "ErrorTable.frame": FILES,
    "ErrorTable.outside": FILES,
    "NavigationLog": FILES,
    "ReceiverFile": FILES,
    "Turn": STEERING,
    "Descent.attitude": STEERING,
    "OrbitalLeg.attitude": STEERING,
    "Coning.axis": "an axis of the body, as good as the one that is used",
    "NominalConstellation.system": "BeiDou is used together with the others",
    "BancroftSolution.least_quality": STUDIES,
    "FeedbackCard": STUDIES,
    "InstabilityFit.convention": STUDIES,
    "ReceiverCard.frequencies": STUDIES,
    "DroppedSamples.instead": TESTED,
    "LoopsCard.carrier": TESTED,
    "RecordedAscent.direction": TESTED,
    "SmoothingCard.velocity": TESTED,
    "Tone": TESTED,
    "TrackingCard.start": TESTED,
}


def cards_of(value: Any) -> Iterator[Card]:
    """Yield all cards within a value."""
    if isinstance(value, Card):
        yield value
        for name in type(value).model_fields:
            yield from cards_of(getattr(value, name))
    elif isinstance(value, dict):
        for below in value.values():
            yield from cards_of(below)
    elif isinstance(value, list | tuple):
        for below in value:
            yield from cards_of(below)


@pytest.fixture(scope="module")
def chosen() -> dict[type, dict[str, set[Any]]]:
    """Return the values of the fields of every class of cards, in all cases of all campaigns."""
    found: dict[type, dict[str, set[Any]]] = defaultdict(lambda: defaultdict(set))
    for file in (ROOT / "campaigns").glob("**/*.yaml"):
        if file.name == "study.yaml" or {"statements", "configs"} & set(file.parts):
            continue
        seen: set[int] = set()
        is_sampled = "\nsamples:" in file.read_text(encoding="utf-8")
        campaign = load(file, ["samples=100"] if is_sampled else ())  # a Latin hypercube has every level of an axis
        for card in cards_of((campaign.base, [case.scenario for case in cases(campaign)])):
            if id(card) in seen:
                continue
            seen.add(id(card))
            for name in type(card).model_fields:
                value = getattr(card, name)
                if isinstance(value, str | int | bool):
                    found[type(card)][name].add(value)
    return found


def _below(kind: type) -> Iterator[type]:
    for one in kind.__subclasses__():
        if one.__qualname__ in vars(sys.modules[one.__module__]):  # not a copy that records what is read of a card
            yield vars(sys.modules[one.__module__])[one.__qualname__]
        yield from _below(one)


def _choices(annotation: Any) -> tuple[Any, ...]:
    return typing.get_args(annotation) if typing.get_origin(annotation) is typing.Literal else ()


def test_each_choice_of_a_card_is_made_in_a_campaign(chosen: dict[type, dict[str, set[Any]]]) -> None:
    missing = {}
    for kind in set(_below(Card)):
        if not kind.__module__.startswith(ROOMS) or not kind.model_fields:
            continue
        if kind.__name__.startswith("_"):  # what members of a family share; its choices are theirs
            continue
        for name, field in kind.model_fields.items():
            choices, made = set(_choices(field.annotation)), chosen[kind][name] if kind in chosen else set()
            if left := choices - made:
                missing[f"{kind.__name__}.{name}"] = sorted(map(str, left))
    never = {
        name: left for name, left in missing.items() if name not in ELSEWHERE and name.split(".")[0] not in ELSEWHERE
    }
    assert never == {}
    assert {one for one in ELSEWHERE if not any(name.startswith(one) for name in missing)} == set()
