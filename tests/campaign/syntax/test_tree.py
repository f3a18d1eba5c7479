"""YAML is read with positions and without innovations, and written so that it reads back."""

from __future__ import annotations

from pathlib import Path

import pytest

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.tree import Place
from lvnav_trade.quantities.errors import InputError


def test_numbers_and_words_are_read_without_surprises() -> None:
    node = tree.parse("[1e-3, no, on, 12:30, 010, 0x10, 2017-08-24, '1', true, null]", "f", Path())
    assert tree.plain_data(node) == [1e-3, "no", "on", "12:30", 10, 16, "2017-08-24", "1", True, None]


def test_separators_are_no_part_of_a_number() -> None:
    node = tree.parse("[1_000, 1_0.5, 0x1_0, -1_0]", "f", Path())
    assert tree.plain_data(node) == ["1_000", "1_0.5", "0x1_0", "-1_0"]


def test_a_tree_that_is_dumped_reads_back_to_the_same() -> None:
    data = {"a": "1e-3", "b": ["no", "null", "true", "0x10", "x: y", "# no", "", "tab\tand\nline"], "c": None, "d": {}}
    numbers = {"e": [1e-3, 5e-324, 1e300, 0.1 + 0.2, -0.0, 2**62], "f": [True, False]}
    text = tree.dump({**data, **numbers})
    assert tree.plain_data(tree.parse(text, "f", Path())) == {**data, **numbers}


def test_a_text_that_is_folded_over_lines_is_one_line() -> None:
    node = tree.parse("a: >-\n  one\n  two\n\n  three\n", "f", Path())
    assert tree.plain_data(node) == {"a": "one two\nthree"}


def test_rows_of_a_table_are_lines() -> None:
    data = {"gain": [[1.0, -2e-27], [3.0, 4.0]], "knots": [{"at": 1.0, "row": [5, 6]}]}
    text = tree.dump(data)
    assert text.splitlines() == ["gain:", "- [1.0, -2e-27]", "- [3.0, 4.0]", "knots:", "- at: 1.0", "  row: [5, 6]"]
    assert tree.plain_data(tree.parse(text, "f", Path())) == data


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "odd.yaml: is empty"),
        (b"# only a comment\n", "odd.yaml: is empty"),
        (b"\x80\x81\xff\x00", "odd.yaml: is not a text file in UTF-8"),
        (b"a\x00b: 1\n", "odd.yaml: is not YAML: unacceptable character #x0000: special characters are not allowed"),
        (b"just words\n", "odd.yaml:1:1: should be a mapping of keys to values ('key: value' lines)"),
        (b"- 1\n", "odd.yaml:1:1: should be a mapping of keys to values ('key: value' lines)"),
        (b"a: &x\n  b: *x\n", "odd.yaml:1:4: a.b: an alias that contains itself"),
        (
            b"a: {b: 1,\n  c: {d: 2}\ne: 3\n",
            "odd.yaml:3:1: is not YAML: expected ',' or '}', but got a word (in the block that begins on line 1)",
        ),
        (b"? [a, b]\n: 1\n", "odd.yaml:1:3: a key should be a word"),
    ],
)
def test_a_file_that_is_no_campaign_is_reported_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("odd.yaml").write_bytes(content)
    with pytest.raises(InputError) as caught:
        load("odd.yaml")
    assert str(caught.value) == message


def test_the_nearest_place_is_that_of_the_settings_above_what_was_not_written() -> None:
    root = tree.parse("a:\n  b: {c: 1}\n", "f.yaml", Path())
    assert tree.nearest_place(root, ["a", "b", "d", "e"])[:3] == ("f.yaml", 2, 6)
    assert isinstance(tree.nearest_place(root, ["x"]), Place)


def test_every_value_and_every_key_knows_its_line_and_column() -> None:
    root = tree.parse("a:\n  b: [1, two]\n", "f.yaml", Path())
    word = tree.find(root, ["a", "b", 1])
    assert word is not None
    assert (word.value, word.place[:3]) == ("two", ("f.yaml", 2, 10))
    assert tree.find(root, ["a"]).keys["b"][:3] == ("f.yaml", 2, 3)
    assert tree.find(root, ["a", "b", 2]) is None


def test_an_empty_value_stands_at_its_key() -> None:
    root = tree.parse("a:\n\n\nb: 1\n", "f.yaml", Path())
    assert root.value["a"].place[:3] == ("f.yaml", 1, 1)


def test_a_byte_order_mark_is_no_part_of_the_first_key(tmp_path: Path) -> None:
    (tmp_path / "f.yaml").write_bytes(b"\xef\xbb\xbfa: 1\n")
    assert tree.plain_data(tree.read(tmp_path / "f.yaml")) == {"a": 1}


def test_putting_one_tree_into_another_changes_neither() -> None:
    base, over = (tree.parse(text, "f", Path()) for text in ("{a: {b: 1, c: 2}, d: 3}", "{a: {b: 9}, e: [1]}"))
    assert tree.plain_data(tree.with_node(base, ["a", "x", "y"], over)) == {
        "a": {"b": 1, "c": 2, "x": {"y": {"a": {"b": 9}, "e": [1]}}},
        "d": 3,
    }
    assert tree.plain_data(base) == {"a": {"b": 1, "c": 2}, "d": 3}


def test_a_text_is_parsed_once_and_again_when_it_has_changed(tmp_path: Path) -> None:
    file = tmp_path / "card.yaml"
    file.write_text("a: 1\n")
    first = tree.read(file)
    assert tree.read(file) is first
    file.write_text("a: 2\n")
    assert tree.plain_data(tree.read(file)) == {"a": 2}
    (tmp_path / "copy.yaml").write_text("a: 1\n")
    assert tree.read(tmp_path / "copy.yaml").place != first.place


def test_a_file_below_the_working_folder_is_shown_relative_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert tree.show(tmp_path / "here/sub/f.yaml") == "sub/f.yaml"
    assert tree.show(tmp_path / "f.yaml") == str(tmp_path / "f.yaml")


@pytest.mark.parametrize(
    ("word", "near"),
    [("tigth", " (did you mean 'tight'?)"), ("TIGHT", " (did you mean 'tight'?)"), ("banana", "")],
)
def test_the_nearest_known_word_is_offered_or_none(word: str, near: str) -> None:
    assert tree.hint(word, ["tight", "loose"]) == near


def test_where_settings_were_written_makes_no_difference_to_what_they_say() -> None:
    one, other = tree.SourceTree(), tree.SourceTree(tree.parse("a: 1", "f", Path()))
    assert one == other
    assert str(one.mistake("a", "is odd")) == "a: is odd"
    assert str(other.mistake("a", "is odd")) == "f:1:4: a: is odd"
