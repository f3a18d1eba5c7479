"""Reading a field of a card by its attribute is recorded; nothing else is, and nothing changes."""

from __future__ import annotations

import pickle
from typing import Any

from pydantic import Field

from lvnav_trade.campaign.definition.axes import cases
from lvnav_trade.campaign.reading.load import load
from lvnav_trade.quantities.reads import FieldReads, result_cache, result_cache_by_reads
from lvnav_trade.quantities.units import Card, Length


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
    reads = FieldReads(outer())
    card = reads.card
    assert card.many[1].size == 3.0
    assert card.named["a"].start == "a"
    assert card.twice == 6
    assert outer().one.size == 1.0  # another card
    assert reads.paths == {"many", "many.1.size", "named", "named.a.from", "number"}


def test_writing_out_comparing_hashing_copying_and_validating_read_nothing():
    reads = FieldReads(outer())
    card = reads.card
    assert Outer.model_validate(card.model_dump(by_alias=True, mode="json")) == card
    assert Outer.model_validate(card) is card
    assert card.model_copy(update={"number": 4}) != card
    assert card.model_dump_json() == outer().model_dump_json()
    assert hash(FieldReads(Inner(size="1 m")).card) == hash(Inner(size="1 m"))
    assert reads.paths == set()


def test_a_copy_is_equal_to_its_card_and_of_its_class():
    card, copy = outer(), FieldReads(outer()).card
    assert card == copy == card
    assert copy == FieldReads(card).card
    assert card.model_copy(update={"number": 4}) != copy
    assert isinstance(copy, Outer)
    assert isinstance(copy.one, Inner)
    assert type(copy).__name__ == "Outer"


def test_the_card_itself_records_nothing():
    card = outer()
    reads = FieldReads(card)
    assert card.one.size == 1.0
    assert reads.paths == set()
    assert "__getattribute__" not in vars(Card)
    assert card.__class__ is Outer


def test_within_a_record_another_one_may_be_kept():
    reads = FieldReads(outer())
    within = FieldReads(reads.card.one)
    assert within.card.size == 1.0
    assert reads.card.number == 3
    assert (reads.paths, within.paths) == ({"one", "number"}, {"size"})


def test_what_goes_to_another_process_is_the_card_itself():
    card = outer()
    again = pickle.loads(pickle.dumps(FieldReads(card).card))
    assert again == card
    assert type(again) is Outer
    assert type(again.many[0]) is Inner


def test_a_result_that_was_kept_counts_as_having_read_what_it_was_made_of():
    calls = []

    @result_cache(2)
    def larger(key: str, card: Inner, factor: float) -> float:
        calls.append(key)
        return factor * card.size

    first, reads = outer(), FieldReads(outer())
    assert larger("a", first.one, 2.0) == 2.0
    assert larger("a", reads.card.one, 2.0) == 2.0
    assert calls == ["a"]
    assert reads.paths == {"one", "one.size"}
    assert larger("a", first.one, 3.0) == larger("b", first.one, 3.0) == 3.0
    assert larger("a", first.one, 2.0) == 2.0
    assert calls == ["a", "a", "b", "a"]  # two are kept


def demo() -> Any:
    return cases(load("demo"))[0].scenario


def test_a_result_is_kept_for_cards_that_differ_in_what_was_not_read() -> None:
    calls = []

    @result_cache_by_reads(2)
    def tilt(key: str, card: Any) -> float:
        calls.append(key)
        return float(card.initial.tilt) + (card.receiver.latency if card.initial.tilt > 1.0 else 0.0)

    base = demo()

    def changed(**fields: float) -> Any:
        return base.model_copy(update={"initial": base.initial.model_copy(update=fields)})

    assert tilt("a", base) == tilt("a", changed(heading=0.3)) == base.initial.tilt
    assert calls == ["a"]
    assert tilt("a", changed(tilt=0.5)) == 0.5
    assert tilt("b", base) == base.initial.tilt
    assert calls == ["a", "a", "b"]
    assert tilt("a", base) == base.initial.tilt  # the oldest was dropped
    assert calls == ["a", "a", "b", "a"]


def test_what_a_kept_result_was_computed_from_counts_as_read() -> None:
    @result_cache_by_reads(2)
    def tilt(key: str, card: Any) -> float:
        return float(card.initial.tilt)

    tilt("a", demo())
    reads = FieldReads(demo())
    tilt("a", reads.card)
    assert {"initial", "initial.tilt"} <= reads.paths
    assert "initial.heading" not in reads.paths


def test_a_result_is_not_kept_where_settings_are_built_otherwise() -> None:
    @result_cache_by_reads(4)
    def count(key: str, card: Any) -> int:
        return len(card.faults) + sum(fault.start != "" for fault in card.faults)

    base = demo()
    assert count("a", base) == 2
    assert count("a", base.model_copy(update={"faults": base.faults * 2})) == 4
    assert count("a", base.model_copy(update={"faults": ()})) == 0
