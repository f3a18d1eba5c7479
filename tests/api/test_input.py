"""What scripts read: settings with the place of every value."""

from __future__ import annotations

import pytest

from lvnav_trade.api.input import Card, Length, read_input
from lvnav_trade.quantities.errors import InputError


class Fence(Card):
    height: Length
    posts: tuple[str, ...] = ()


def test_a_file_is_read_with_units_and_knows_where_its_values_are(tmp_path):
    file = tmp_path / "fence.yaml"
    file.write_text("height: 30 cm\nposts: [oak]\n")
    found = read_input(file, Fence)
    assert found.content == Fence.model_validate({"height": "0.3 m", "posts": ["oak"]})
    wrong = found.mistake("posts.0", "is rotten")
    assert (wrong.path, wrong.line, wrong.column) == ("posts.0", 2, 9)


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("height: 30\n", "fence.yaml:1:9: height: 30 has no unit"),
        ("height: 3 m\nhight: 2 m\n", r"fence.yaml:2:1: hight: unknown key \(did you mean 'height'"),
    ],
)
def test_a_mistake_is_reported_at_its_place(tmp_path, text, reported):
    file = tmp_path / "fence.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=reported):
        read_input(file, Fence)
