"""Which changes make another campaign."""

from __future__ import annotations

import re
import tomllib

import pytest

from lvnav_trade.results.tables.read import load
from lvnav_trade.results.tables.versions import _COMPUTES, PACKAGE, campaign_digest
from tests.synthetic import CAMPAIGN


def test_more_runs_or_another_requirement_is_the_same_campaign():
    assert campaign_digest(CAMPAIGN) == campaign_digest(CAMPAIGN.replace("runs: 200", "runs: 400"))
    assert campaign_digest(CAMPAIGN) == campaign_digest(CAMPAIGN.replace("below: 2.0", "below: 3.0"))
    assert campaign_digest(CAMPAIGN) != campaign_digest(CAMPAIGN.replace("block: 40", "block: 80"))


@pytest.mark.parametrize("key", ["corridor", "compare", "report"])
def test_what_is_said_of_the_runs_is_no_other_campaign(key):
    assert campaign_digest(f"{CAMPAIGN}\n{key}: of one kind\n") == campaign_digest(f"{CAMPAIGN}\n{key}: of another\n")


def test_the_manifest_names_versions_machine_and_order(written):
    manifest = load(written).manifest
    assert manifest["cases"] == ["aaaaaaaaaaaa", "bbbbbbbbbbbb"]
    assert {"tool", "python", "numpy", "numba", "cpu", "seed", "created", "commit"} <= set(manifest)


def test_the_digest_of_the_code_covers_every_layer_below_the_tables(root):
    contracts = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = next(one["layers"] for one in contracts if one.get("containers") == ["lvnav_trade"])
    computing = layers[layers.index("campaign : results") + 1 :]
    assert {name.strip() for layer in computing for name in layer.split(":")} == set(_COMPUTES)


def test_the_digest_of_the_code_covers_every_package_that_these_use():
    text = "".join(path.read_text() for folder in _COMPUTES for path in (PACKAGE / folder).rglob("*.py"))
    used = set(re.findall(r"^from lvnav_trade\.(\w+)", text, flags=re.M))
    assert used
    assert used <= set(_COMPUTES)
