"""Valid YAML that is refused says why, at its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from lvnav_trade.campaign.syntax import tree
from lvnav_trade.quantities import input_limits
from lvnav_trade.quantities.errors import InputError


def test_an_anchor_that_stands_twice_is_refused_where_it_stands_again(tmp_path):
    with pytest.raises(InputError) as caught:
        tree.parse("&x 1: &x 1\nname: two\n", "card.yaml", tmp_path)
    record = caught.value.records[0]
    assert (record.message, record.line, record.column) == ("an anchor of this name is defined above", 1, 7)


def test_lists_within_lists_are_refused_beyond_the_limit_and_not_before() -> None:
    most = input_limits.YAML_DEPTH - 1  # the word within counts too
    tree.parse("[" * most + "1" + "]" * most, "f", Path())
    with pytest.raises(InputError, match=f"more than {input_limits.YAML_DEPTH} lists and mappings within each other"):
        tree.parse("[" * (most + 1) + "1" + "]" * (most + 1), "f", Path())
