"""Figures of many designs."""

from __future__ import annotations

import pytest

from lvnav_trade.plots import PLOTS
from lvnav_trade.plots.raster import drawn
from tests import many_designs


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory):
    return many_designs.tables(tmp_path_factory.mktemp("space"))


def test_effects_have_a_bar_and_an_interval_for_every_axis(tables) -> None:
    parts, ranks = drawn(PLOTS["effects"](tables, "fast")).axes
    assert [label.get_text() for label in parts.get_yticklabels()] == ["heading", "filter", "bias repeatability"]
    widths = [bar.get_width() for bar in parts.patches]
    assert widths == sorted(widths)
    assert ranks.get_xlim() == (-1.0, 1.0)


def test_shares_have_a_panel_for_every_axis_in_the_unit_of_the_campaign(tables) -> None:
    axes = drawn(PLOTS["regions"](tables)).axes
    labels = [ax.get_xlabel() for ax in axes if ax.get_xlabel()]
    assert [label.partition(" (")[0] for label in labels] == ["filter", "bias repeatability", "heading"]
    assert "deg/h" in labels[1]
    assert [label.get_text() for label in axes[0].get_xticklabels()] == ["loose", "tight"]
