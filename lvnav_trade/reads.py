"""Record of the settings that code reads: a setting that is never read has no effect.

Code is given a copy of the settings that notes which of its fields are read. The settings themselves stay as they are.
"""

import types
from collections import OrderedDict
from collections.abc import Callable, Collection, Hashable, Mapping
from functools import cache, wraps
from typing import Any, NamedTuple, TypeVar

from pydantic import ConfigDict

from lvnav_trade.units import Card

Value = TypeVar("Value")
_NOTES = "_notes"  # where a recording copy keeps where it notes


class Reads:
    """The fields that were read of some settings and of all settings within them.

    Fields are read by attribute. Comparing, hashing, copying, validating and writing settings out reads nothing.

    Attributes
    ----------
    card
        A copy of the settings for the code whose reading is recorded; an instance of the same classes.
    paths
        What was read of the copy: dotted, as a user writes them.
    """

    def __init__(self, whole: Card) -> None:
        self.paths: set[str] = set()
        self.card = self._copy(whole, "")

    def _copy(self, value: Any, prefix: str) -> Any:
        if isinstance(value, Card):
            fields = {name: one for name, one in value.__dict__.items() if name != _NOTES}
            within = {name: self._copy(one, f"{prefix}{_key(value, name)}.") for name, one in fields.items()}
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
    """Where a recording copy notes: the paths read so far, and its own place in the whole, with a dot behind it."""

    paths: set[str]
    prefix: str


class _Recording(Card):
    """What recording copies have beside the fields of their card."""

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
        """Return what another process makes the card itself of, which records nothing."""
        return _itself, (_plain(self),)


def _itself(card: Card) -> Card:
    return card


@cache
def _recording_class(kind: type[Card]) -> type[Card]:
    """Return the class of copies that record what is read of a card."""
    if issubclass(kind, _Recording):
        return kind
    names = {"__module__": kind.__module__, "__qualname__": kind.__qualname__, "__doc__": kind.__doc__}
    made: type[Card] = types.new_class(kind.__name__, (_Recording, kind), {}, lambda own: own.update(names))
    return made


def _recording_copy(card: Card, values: dict[str, Any]) -> Card:
    return _copied(card, _recording_class(type(card)), values)


def _plain(card: Card) -> Card:
    """Return a recording copy, and all within it, as the cards that they are copies of."""

    def plain(value: Any) -> Any:
        if isinstance(value, _Recording):
            return _plain(value)
        if isinstance(value, dict):
            return {name: plain(below) for name, below in value.items()}
        return tuple(map(plain, value)) if type(value) is tuple else value

    kind = type(card).__mro__[2]
    return _copied(card, kind, {name: plain(value) for name, value in card.__dict__.items() if name != _NOTES})


def _copied(card: Card, kind: type[Card], values: dict[str, Any]) -> Card:
    found = kind.__new__(kind)
    object.__setattr__(found, "__dict__", values)
    for name in ("__pydantic_fields_set__", "__pydantic_extra__", "__pydantic_private__"):
        object.__setattr__(found, name, object.__getattribute__(card, name))
    return found


def note(card: Card, names: Collection[str]) -> None:
    """Note fields of settings as read, by names or paths within them; nothing where they are no recording copy."""
    notes = object.__getattribute__(card, "__dict__").get(_NOTES)
    if notes is not None:
        notes.paths.update(notes.prefix + name for name in names)


def remembered(size: int) -> Callable[[Callable[..., Value]], Callable[..., Value]]:
    """Keep the last `size` results of a function of (key, card, *rest) by the key and the rest.

    A result that was kept counts as having read what its computation read of a card that is equal.
    """

    def decorate(function: Callable[..., Value]) -> Callable[..., Value]:
        kept: OrderedDict[Hashable, tuple[Value, frozenset[str]]] = OrderedDict()

        @wraps(function)
        def call(key: Hashable, card: Card, *rest: Hashable) -> Value:
            if (key, rest) in kept:
                kept.move_to_end((key, rest))
            else:
                reads = Reads(card)
                value = function(key, reads.card, *rest)
                kept[key, rest] = value, frozenset(reads.paths)
                while len(kept) > size:
                    kept.popitem(last=False)
            value, names = kept[key, rest]
            note(card, names)
            return value

        return call

    return decorate


class _Kept(NamedTuple):
    """A result that is kept, and what it was computed from.

    key : Key and rest of the arguments.
    whole : What was read of the card, by path.
    built : How the settings above that are built, by path.
    value : The result.
    """

    key: tuple[Hashable, ...]
    whole: Mapping[str, Any]
    built: Mapping[str, Any]
    value: Any

    def is_of(self, key: tuple[Hashable, ...], card: Card) -> bool:
        """Whether the result is that of another card too."""
        return (
            self.key == key
            and all(_built(_at(card, path)) == one for path, one in self.built.items())
            and all(_at(card, path) == one for path, one in self.whole.items())
        )


def remembered_by_reads(size: int) -> Callable[[Callable[..., Value]], Callable[..., Value]]:
    """Keep the last `size` results of a function of (key, card, *rest) by key, rest, and what it read of the card.

    A function that is given the same reads the same. As long as all that it read has the same content it would read
    nothing else, so fields that it never reads may differ. What it reads otherwise than by attribute belongs into the
    key.
    """

    def decorate(function: Callable[..., Value]) -> Callable[..., Value]:
        kept: list[_Kept] = []

        @wraps(function)
        def call(key: Hashable, card: Card, *rest: Hashable) -> Value:
            own = _plain(card) if isinstance(card, _Recording) else card
            found = next((one for one in reversed(kept) if one.is_of((key, *rest), own)), None)
            if found is None:
                reads = Reads(own)
                value = function(key, reads.card, *rest)
                above = {above for path in reads.paths for above in _above(path)}
                whole = {path: _at(own, path) for path in reads.paths - above}
                found = _Kept((key, *rest), whole, {path: _built(_at(own, path)) for path in above}, value)
                kept.append(found)
                del kept[:-size]
            note(card, {*found.whole, *found.built})
            return found.value

        return call

    return decorate


_ABSENT = object()


def _above(path: str) -> list[str]:
    """Return the paths of the settings that a path lies in."""
    steps = path.split(".")
    return [".".join(steps[:depth]) for depth in range(1, len(steps))]


def _at(card: Card, path: str) -> Any:
    """Return what stands at a path of settings; nothing of it counts as read."""
    value: Any = card
    for step in path.split("."):
        if isinstance(value, Card):
            fields = value.__dict__
            name = step if step in fields else next((one for one in fields if _key(value, one) == step), "")
            value = fields.get(name, _ABSENT)
        elif isinstance(value, Mapping):
            value = value.get(step, _ABSENT)
        elif isinstance(value, tuple) and step.isdigit() and int(step) < len(value):
            value = value[int(step)]
        else:
            return _ABSENT
    return value


def _built(value: Any) -> Any:
    """Return how settings are built, without their content: their class, the classes of their items, by key."""
    if isinstance(value, Mapping):
        return {key: type(one) for key, one in value.items()}
    if isinstance(value, tuple):
        return tuple(type(one) if isinstance(one, Card | tuple | Mapping) else one for one in value)
    return type(value)
