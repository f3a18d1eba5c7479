"""A damaged manifest is one line that names the file and what mends it."""

from __future__ import annotations

import json

import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.tables.contents import read_manifest

GOOD = {"campaign_digest": "a", "campaign": "demo", "asked_cases": {"b": "base"}, "asked_runs": 8, "asked_block": 4}
GOOD |= {"cases": ["b"], "lost": [], "another": {"of": 3}}


def test_what_is_sound_is_returned_as_it_is(tmp_path):
    (tmp_path / "manifest.json").write_text(json.dumps(GOOD))
    assert read_manifest(tmp_path / "manifest.json") == GOOD


@pytest.mark.parametrize(
    "change",
    [
        {"asked_cases": []}, {"asked_cases": {"b": None}}, {"asked_block": 0}, {"asked_block": None}, {"cases": "b"},
        {"asked_runs": -1}, {"asked_runs": 10**30}, {"asked_runs": True}, {"lost": [1]}, {"campaign": {}},
        {"finished": 1.5},
    ],
)  # fmt: skip
def test_a_part_of_another_kind_is_named(tmp_path, change):
    path = tmp_path / "manifest.json"
    path.write_text(json.dumps(GOOD | change))
    (name,) = change
    with pytest.raises(InputError, match=rf"manifest\.json: damaged: {name} cannot be .*; the same lvnav-trade"):
        read_manifest(path)


@pytest.mark.parametrize("content", [b"", b'{"created":', b"\xff\xfe", b"[" * 100_000])
def test_what_is_no_json_is_damaged(tmp_path, content):
    path = tmp_path / "manifest.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match="damaged: "):
        read_manifest(path)
