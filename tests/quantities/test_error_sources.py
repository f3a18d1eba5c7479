"""The registry of error sources: keys that draws are numbered by, labels, and fields that exist."""

from __future__ import annotations

from typing import Any, get_args

import pytest
from pydantic import BaseModel

from lvnav_trade.kernels.random import source_word
from lvnav_trade.quantities.error_sources import SOURCES, fields_of, label_of
from lvnav_trade.scenario.scenario import Scenario


def models(annotation: Any) -> list[type[BaseModel]]:
    """Return the models that an annotation can be, however deep they stand in unions and tuples."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for one in get_args(annotation) for model in models(one)]


def exists(found: list[type[BaseModel]], path: tuple[str, ...]) -> bool:
    """Whether some of the models has a field at a path; the parts of a combined card hold it in its place."""
    head, rest = path[0], path[1:]
    at = [model.model_fields[head].annotation for model in found if head in model.model_fields]
    return bool(at) and (not rest or exists([model for one in at for model in models(one)], rest))


@pytest.mark.parametrize("key", sorted(key for key, source in SOURCES.items() if source.fields))
def test_the_fields_of_a_source_are_fields_of_a_scenario(key: str) -> None:
    assert all(exists([Scenario], path) for path, _ in SOURCES[key].fields)


def test_keys_are_the_sources_own_and_number_different_draws() -> None:
    assert all(source.key == key for key, source in SOURCES.items())
    assert len({int(source_word(key)) for key in SOURCES}) == len(SOURCES)


def test_a_budget_prints_the_label_and_finds_the_fields_by_it() -> None:
    assert label_of("gyro random walk") == SOURCES["gyro random walk"].label
    assert label_of("altimeter noise port") == "altimeter noise port"
    assert fields_of("receiver clock") == SOURCES["receiver clock"].fields
    assert fields_of("altimeter noise port") == ()
