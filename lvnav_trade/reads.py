"""Record of the card fields that code reads: a setting that is never read has no effect."""

from collections import OrderedDict
from collections.abc import Callable, Collection, Hashable, Iterator, Mapping
from contextlib import contextmanager
from functools import wraps
from typing import Any, TypeVar

from lvnav_trade.units import Card

Value = TypeVar("Value")


class Reads:
    """The fields that were read of some settings and of all settings within them; paths: dotted, as a user writes them.

    Fields are read by attribute. Comparing, hashing, copying, validating and writing settings out reads nothing.
    """

    def __init__(self, whole: Card) -> None:
        self.paths: set[str] = set()
        self._prefixes: dict[int, list[str]] = {}
        self._whole = whole  # kept: while it lives, no other object has the identity of a part of it
        self._enter(whole, "")

    def _enter(self, value: Any, prefix: str) -> None:
        if isinstance(value, Card):
            self._prefixes.setdefault(id(value), []).append(prefix)
            value = {_key(value, name): below for name, below in value.__dict__.items()}
        if isinstance(value, Mapping):
            for name, below in value.items():
                self._enter(below, f"{prefix}{name}.")
        elif isinstance(value, tuple):
            for number, below in enumerate(value):
                self._enter(below, f"{prefix}{number}.")

    def note(self, card: Card, names: Collection[str]) -> None:
        """Note fields of a card, by names or paths within it; nothing where it is no part of the whole."""
        for prefix in self._prefixes.get(id(card), ()):
            self.paths.update(prefix + name for name in names)


def _key(card: Card, name: str) -> str:
    """Return the key that a user writes for a field."""
    field = type(card).__pydantic_fields__.get(name)
    return name if field is None else field.alias or name


_open: list[Reads] = []


def _noting(self: Card, name: str) -> Any:
    value = object.__getattribute__(self, name)
    if name in type(self).__pydantic_fields__:
        for reads in _open:
            reads.note(self, (_key(self, name),))
    return value


@contextmanager
def recorded(whole: Card) -> Iterator[Reads]:
    """Record which fields of some settings are read within.

    The hook is on the class of all cards while it is needed, and only then: otherwise reading a field costs nothing.
    """
    reads = Reads(whole)
    _open.append(reads)
    if len(_open) == 1:
        type.__setattr__(Card, "__getattribute__", _noting)
    try:
        yield reads
    finally:
        _open.remove(reads)
        if not _open:
            type.__delattr__(Card, "__getattribute__")


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
                value, names = kept[key, rest]
                for reads in _open:
                    reads.note(card, names)
                return value
            with recorded(card) as reads:
                value = function(key, card, *rest)
            kept[key, rest] = value, frozenset(reads.paths)
            while len(kept) > size:
                kept.popitem(last=False)
            return value

        return call

    return decorate
