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

    def __init__(self, whole: Card) -> None:
        self.paths: set[str] = set()
        self.card = self._copy(whole, "")

    def _copy(self, value: Any, prefix: str) -> Any:
        if isinstance(value, Card):
            fields = {name: item for name, item in value.__dict__.items() if name != _NOTES}
            within = {name: self._copy(item, f"{prefix}{_key(value, name)}.") for name, item in fields.items()}
            return _recording_copy(value, within | {_NOTES: _Notes(self.paths, prefix)})
        if isinstance(value, Mapping):
            return {name: self._copy(below, f"{prefix}{name}.") for name, below in value.items()}
        if type(value) is tuple:
            return tuple(self._copy(below, f"{prefix}{number}.") for number, below in enumerate(value))
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
        return bool(_plain(self) == (_plain(other) if isinstance(other, _Recording) else other))

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Pickle the card itself: the copy in another process records nothing."""
        return _itself, (_plain(self),)


def _itself(card: Card) -> Card:
    return card


@cache
def _recording_class(kind: type[Card]) -> type[Card]:
    """Return the class of the recording copies of a card."""
    if issubclass(kind, _Recording):
        return kind
    names = {"__module__": kind.__module__, "__qualname__": kind.__qualname__, "__doc__": kind.__doc__}
    recording: type[Card] = types.new_class(kind.__name__, (_Recording, kind), {}, lambda body: body.update(names))
    return recording


def _recording_copy(card: Card, values: dict[str, Any]) -> Card:
    return _copied(card, _recording_class(type(card)), values)


def _plain(card: Card) -> Card:
    """Return the original card of a recording copy, with all cards within it."""

    def plain(value: Any) -> Any:
        if isinstance(value, _Recording):
            return _plain(value)
        if isinstance(value, dict):
            return {name: plain(below) for name, below in value.items()}
        return tuple(map(plain, value)) if type(value) is tuple else value

    kind = type(card).__mro__[2]
    return _copied(card, kind, {name: plain(value) for name, value in card.__dict__.items() if name != _NOTES})


def _copied(card: Card, kind: type[Card], values: dict[str, Any]) -> Card:
    copy = kind.__new__(kind)
    object.__setattr__(copy, "__dict__", values)
    for name in ("__pydantic_fields_set__", "__pydantic_extra__", "__pydantic_private__"):
        object.__setattr__(copy, name, object.__getattribute__(card, name))
    return copy


def note(card: Card, names: Collection[str]) -> None:
    """Note fields of a recording copy as read, by names or paths within it; no effect on other settings."""
    notes = object.__getattribute__(card, "__dict__").get(_NOTES)
    if notes is not None:
        notes.paths.update(notes.prefix + name for name in names)


def remembered(size: int) -> Callable[[Callable[..., Value]], Callable[..., Value]]:
    """Cache the last `size` results of a function of (key, card, *rest) by key and rest.

    A cached result counts as a reading of the fields that its computation read.
    """

    def decorate(function: Callable[..., Value]) -> Callable[..., Value]:
        kept: OrderedDict[Hashable, tuple[Value, frozenset[str]]] = OrderedDict()

        @wraps(function)
        def call(key: Hashable, card: Card, *rest: Hashable) -> Value:
            if (key, rest) in kept:
                kept.move_to_end((key, rest))
            else:
                reads = FieldReads(card)
                value = function(key, reads.card, *rest)
                kept[key, rest] = value, frozenset(reads.paths)
                while len(kept) > size:
                    kept.popitem(last=False)
            value, names = kept[key, rest]
            note(card, names)
            return value

        return call

    return decorate


class _CachedResult(NamedTuple):
    """A cached result and the settings from which it was computed.

    key : Key and rest of the arguments.
    whole : Values read from the card, by path.
    built : Structure of the settings above these values, by path.
    value : The result.
    """

    key: tuple[Hashable, ...]
    whole: Mapping[str, Any]
    built: Mapping[str, Any]
    value: Any

    def is_of(self, key: tuple[Hashable, ...], card: Card) -> bool:
        """Whether the result is valid for a card: all values that were read are equal."""
        return (
            self.key == key
            and all(_built(_at(card, path)) == structure for path, structure in self.built.items())
            and all(_at(card, path) == value for path, value in self.whole.items())
        )


def remembered_by_reads(size: int) -> Callable[[Callable[..., Value]], Callable[..., Value]]:
    """Cache the last `size` results of a function of (key, card, *rest) by key, rest, and the fields it read.

    A deterministic function reads the same fields again as long as the values it read are equal, so that fields it did
    not read may differ. Anything that it reads other than by attribute must be in the key.
    """

    def decorate(function: Callable[..., Value]) -> Callable[..., Value]:
        kept: list[_CachedResult] = []

        @wraps(function)
        def call(key: Hashable, card: Card, *rest: Hashable) -> Value:
            plain = _plain(card) if isinstance(card, _Recording) else card
            cached = next((result for result in reversed(kept) if result.is_of((key, *rest), plain)), None)
            if cached is None:
                reads = FieldReads(plain)
                value = function(key, reads.card, *rest)
                above = {above for path in reads.paths for above in _above(path)}
                whole = {path: _at(plain, path) for path in reads.paths - above}
                cached = _CachedResult((key, *rest), whole, {path: _built(_at(plain, path)) for path in above}, value)
                kept.append(cached)
                del kept[:-size]
            note(card, {*cached.whole, *cached.built})
            return cached.value

        return call

    return decorate


_ABSENT = object()


def _above(path: str) -> list[str]:
    """Return the paths of the settings that contain a path."""
    steps = path.split(".")
    return [".".join(steps[:depth]) for depth in range(1, len(steps))]


def _at(card: Card, path: str) -> Any:
    """Return the value at a path of settings, without noting it as read."""
    value: Any = card
    for step in path.split("."):
        if isinstance(value, Card):
            fields = value.__dict__
            name = step if step in fields else next((field for field in fields if _key(value, field) == step), "")
            value = fields.get(name, _ABSENT)
        elif isinstance(value, Mapping):
            value = value.get(step, _ABSENT)
        elif isinstance(value, tuple) and step.isdigit() and int(step) < len(value):
            value = value[int(step)]
        else:
            return _ABSENT
    return value


def _built(value: Any) -> Any:
    """Return the structure of settings without their content: their class, or the classes of their items."""
    if isinstance(value, Mapping):
        return {key: type(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return tuple(type(item) if isinstance(item, Card | tuple | Mapping) else item for item in value)
    return type(value)
