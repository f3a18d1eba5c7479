"""Record of the settings that code reads: a setting that is never read has no effect.

Code receives a recording copy of the settings, which notes the fields that are read. The settings do not change.
"""

import types
from collections import OrderedDict
from collections.abc import Callable, Collection, Hashable, Mapping
from functools import cache, wraps
from typing import Any, NamedTuple, TypeVar

from pydantic import ConfigDict

from lvnav_trade.quantities.units import Card

Value = TypeVar("Value")
_NOTES = "_notes"  # key of the notes in the dictionary of a recording copy


class FieldReads:
    """The fields that were read of some settings and of all settings within them.

    Fields are read by attribute. Comparing, hashing, copying, validating and writing settings out reads nothing.

    Attributes
    ----------
    card
        Recording copy of the settings; an instance of the same classes.
    paths
        Dotted paths of the fields that were read, as a user writes them.
    """

    def __init__(self, settings: Card) -> None:
        self.paths: set[str] = set()
        self.card = self._copy(settings, "")

    def _copy(self, value: Any, prefix: str) -> Any:
        if isinstance(value, Card):
            values: dict[str, Any] = {}
            for name, item in value.__dict__.items():
                if name != _NOTES:
                    key = _key(value, name)
                    values[name] = self._copy(item, f"{prefix}{key}.")
            values[_NOTES] = _Notes(self.paths, prefix)
            return _recording_copy(value, values)
        if isinstance(value, Mapping):
            return {name: self._copy(item, f"{prefix}{name}.") for name, item in value.items()}
        if type(value) is tuple:
            return tuple(self._copy(item, f"{prefix}{number}.") for number, item in enumerate(value))
        return value


def _key(card: Card, name: str) -> str:
    """Return the key that a user writes for a field."""
    field = type(card).__pydantic_fields__.get(name)
    return name if field is None else field.alias or name


class _Notes(NamedTuple):
    """Notes of a recording copy.

    paths : Paths read so far.
    prefix : Path of the copy within the whole settings, followed by a dot.
    """

    paths: set[str]
    prefix: str


class _Recording(Card):
    """Base of recording copies, in addition to the class of their card."""

    model_config = ConfigDict(defer_build=True)  # copies are never validated

    def __getattribute__(self, name: str) -> Any:
        value = object.__getattribute__(self, name)
        if name in type(self).__pydantic_fields__:
            notes = object.__getattribute__(self, "__dict__").get(_NOTES)
            if notes is not None:
                notes.paths.add(notes.prefix + _key(self, name))
        return value

    def __eq__(self, other: Any) -> bool:
        return bool(_plain_card(self) == (_plain_card(other) if isinstance(other, _Recording) else other))

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Pickle the card itself: the copy in another process records nothing."""
        return _identity, (_plain_card(self),)


def _identity(card: Card) -> Card:
    return card


@cache
def _recording_class(card_class: type[Card]) -> type[Card]:
    """Return the class of the recording copies of a card."""
    if issubclass(card_class, _Recording):
        return card_class
    names = {
        "__module__": card_class.__module__,
        "__qualname__": card_class.__qualname__,
        "__doc__": card_class.__doc__,
    }
    bases = (_Recording, card_class)
    recording: type[Card] = types.new_class(card_class.__name__, bases, {}, lambda body: body.update(names))
    return recording


def _recording_copy(card: Card, values: dict[str, Any]) -> Card:
    return _make_copy(card, _recording_class(type(card)), values)


def _plain_card(card: Card) -> Card:
    """Return the original card of a recording copy, with all cards within it."""

    def plain(value: Any) -> Any:
        if isinstance(value, _Recording):
            return _plain_card(value)
        if isinstance(value, dict):
            return {name: plain(item) for name, item in value.items()}
        return tuple(map(plain, value)) if type(value) is tuple else value

    card_class = type(card).__mro__[2]  # after the recording class itself and `_Recording`
    values = {name: plain(value) for name, value in card.__dict__.items() if name != _NOTES}
    return _make_copy(card, card_class, values)


def _make_copy(card: Card, card_class: type[Card], values: dict[str, Any]) -> Card:
    """Return a copy of a card as an instance of a class, with other values, without validation."""
    copy = card_class.__new__(card_class)
    object.__setattr__(copy, "__dict__", values)
    for name in ("__pydantic_fields_set__", "__pydantic_extra__", "__pydantic_private__"):
        object.__setattr__(copy, name, object.__getattribute__(card, name))
    return copy


def note(card: Card, names: Collection[str]) -> None:
    """Note fields of a recording copy as read, by names or paths within it; no effect on other settings."""
    notes = object.__getattribute__(card, "__dict__").get(_NOTES)
    if notes is not None:
        notes.paths.update(notes.prefix + name for name in names)


def result_cache(size: int) -> Callable[[Callable[..., Value]], Callable[..., Value]]:
    """Cache the last `size` results of a function of (key, card, *rest) by key and rest.

    A cached result counts as a reading of the fields that its computation read.
    """

    def decorate(function: Callable[..., Value]) -> Callable[..., Value]:
        results: OrderedDict[Hashable, tuple[Value, frozenset[str]]] = OrderedDict()

        @wraps(function)
        def call(key: Hashable, card: Card, *rest: Hashable) -> Value:
            if (key, rest) in results:
                results.move_to_end((key, rest))
            else:
                reads = FieldReads(card)
                value = function(key, reads.card, *rest)
                results[key, rest] = value, frozenset(reads.paths)
                while len(results) > size:
                    results.popitem(last=False)
            value, names = results[key, rest]
            note(card, names)
            return value

        return call

    return decorate


class _CachedResult(NamedTuple):
    """A cached result and the settings from which it was computed.

    key : Key and rest of the arguments.
    values : Values read from the card, by path.
    structures : Structure of the settings above these values, by path.
    result : The result.
    """

    key: tuple[Hashable, ...]
    values: Mapping[str, Any]
    structures: Mapping[str, Any]
    result: Any

    def is_valid(self, key: tuple[Hashable, ...], card: Card) -> bool:
        """Whether the result is valid for a card: all values that were read are equal."""
        if self.key != key:
            return False
        for path, structure in self.structures.items():
            if _structure(_value_at(card, path)) != structure:
                return False
        return all(_value_at(card, path) == value for path, value in self.values.items())


def _cached_result(key: tuple[Hashable, ...], card: Card, paths: set[str], result: Any) -> _CachedResult:
    parent_paths: set[str] = set()
    for path in paths:
        parent_paths.update(_paths_above(path))
    values = {path: _value_at(card, path) for path in paths - parent_paths}
    structures = {path: _structure(_value_at(card, path)) for path in parent_paths}
    return _CachedResult(key, values, structures, result)


def result_cache_by_reads(size: int) -> Callable[[Callable[..., Value]], Callable[..., Value]]:
    """Cache the last `size` results of a function of (key, card, *rest) by key, rest, and the fields it read.

    A deterministic function reads the same fields again as long as the values it read are equal, so that fields it did
    not read may differ. Anything that it reads other than by attribute must be in the key.
    """

    def decorate(function: Callable[..., Value]) -> Callable[..., Value]:
        results: list[_CachedResult] = []

        def find(key: tuple[Hashable, ...], card: Card) -> _CachedResult | None:
            for cached_result in reversed(results):
                if cached_result.is_valid(key, card):
                    return cached_result
            return None

        @wraps(function)
        def call(key: Hashable, card: Card, *rest: Hashable) -> Value:
            plain = _plain_card(card) if isinstance(card, _Recording) else card
            cached_result = find((key, *rest), plain)
            if cached_result is None:
                reads = FieldReads(plain)
                value = function(key, reads.card, *rest)
                cached_result = _cached_result((key, *rest), plain, reads.paths, value)
                results.append(cached_result)
                del results[:-size]
            note(card, {*cached_result.values, *cached_result.structures})
            return cached_result.result

        return call

    return decorate


_ABSENT = object()


def _paths_above(path: str) -> list[str]:
    """Return the paths of the settings that contain a path."""
    steps = path.split(".")
    return [".".join(steps[:depth]) for depth in range(1, len(steps))]


def _value_at(card: Card, path: str) -> Any:
    """Return the value at a path of settings, without noting it as read."""
    value: Any = card
    for step in path.split("."):
        if isinstance(value, Card):
            value = _field_value(value, step)
        elif isinstance(value, Mapping):
            value = value.get(step, _ABSENT)
        elif isinstance(value, tuple) and step.isdigit() and int(step) < len(value):
            value = value[int(step)]
        else:
            return _ABSENT
    return value


def _field_value(card: Card, step: str) -> Any:
    """Return the value of a field by its name, or by the key that a user writes for it."""
    fields = card.__dict__
    if step in fields:
        return fields[step]
    for name in fields:
        if _key(card, name) == step:
            return fields[name]
    return _ABSENT


def _structure(value: Any) -> Any:
    """Return the structure of settings without their content: their class, or the classes of their items."""
    if isinstance(value, Mapping):
        return {key: type(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return tuple(type(item) if isinstance(item, Card | tuple | Mapping) else item for item in value)
    return type(value)
