"""Reading a field of a card by its attribute is recorded; nothing else is, and nothing changes."""

from __future__ import annotations

from pydantic import Field

from lvnav_trade.reads import recorded, remembered
from lvnav_trade.units import Card, Length


class Inner(Card):
    size: Length = 2.0
    start: str = Field("a", alias="from")


class Outer(Card):
    one: Inner = Inner()
    many: tuple[Inner, ...] = ()
    named: dict[str, Inner | None]
    number: int = 3

    @property
    def twice(self) -> int:
        return 2 * self.number


def outer() -> Outer:
    return Outer(one={"size": "1 m"}, many=({"size": "2 m"}, {"size": "3 m"}), named={"a": {"size": "4 m"}, "b": None})


def test_fields_are_recorded_where_they_stand_as_a_user_writes_them():
    card = outer()
    with recorded(card) as reads:
        assert card.many[1].size == 3.0
        assert card.named["a"].start == "a"
        assert card.twice == 6
        assert outer().one.size == 1.0  # another card
    assert reads.paths == {"many", "many.1.size", "named", "named.a.from", "number"}


def test_writing_out_comparing_hashing_copying_and_validating_read_nothing():
    card = outer()
    with recorded(card) as reads:
        assert Outer.model_validate(card.model_dump(by_alias=True, mode="json")) == card
        assert card.model_copy(update={"number": 4}) != card
        assert card.model_dump_json()
        assert hash(Inner(size="1 m")) != hash(Inner(size="2 m"))
    assert reads.paths == set()


def test_outside_nothing_is_recorded_and_cards_are_as_they_were():
    before = Card.__dict__.get("__getattribute__")
    card = outer()
    with recorded(card) as reads:
        with recorded(card.one) as within:
            assert card.one.size == 1.0
        assert card.number == 3
    assert card.many
    assert (reads.paths, within.paths) == ({"one", "one.size", "number"}, {"size"})
    assert Card.__dict__.get("__getattribute__") is before is None


def test_a_result_that_was_kept_counts_as_having_read_what_it_was_made_of():
    calls = []

    @remembered(2)
    def larger(key: str, card: Inner, factor: float) -> float:
        calls.append(key)
        return factor * card.size

    first, second = outer(), outer()
    assert larger("a", first.one, 2.0) == 2.0
    with recorded(second) as reads:
        assert larger("a", second.one, 2.0) == 2.0
    assert calls == ["a"]
    assert reads.paths == {"one", "one.size"}
    assert larger("a", first.one, 3.0) == larger("b", first.one, 3.0) == 3.0
    assert larger("a", first.one, 2.0) == 2.0
    assert calls == ["a", "a", "b", "a"]  # two are kept
