"""Figures of many designs."""

from __future__ import annotations

import pytest

from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.raster import matplotlib_figure
from tests import many_designs


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory):
    return many_designs.tables(tmp_path_factory.mktemp("space"))


def test_effects_have_a_bar_and_an_interval_for_every_axis(tables) -> None:
    parts, ranks = matplotlib_figure(PLOTS["effects"](tables, "fast")).axes
    assert [label.get_text() for label in parts.get_yticklabels()] == ["heading", "filter", "bias repeatability"]
    widths = [bar.get_width() for bar in parts.patches]
    assert widths == sorted(widths)
    assert ranks.get_xlim() == (-1.0, 1.0)


def test_shares_have_a_panel_for_every_axis_in_the_unit_of_the_campaign(tables) -> None:
    axes = matplotlib_figure(PLOTS["regions"](tables)).axes
    labels = [ax.get_xlabel() for ax in axes if ax.get_xlabel()]
    assert [label.partition(" (")[0] for label in labels] == ["filter", "bias repeatability", "heading"]
    assert "deg/h" in labels[1]
    assert [label.get_text() for label in axes[0].get_xticklabels()] == ["loose", "tight"]


def test_the_error_between_the_ends_of_each_axis_is_a_bar_the_longest_on_top(tables) -> None:
    (ax,) = matplotlib_figure(PLOTS["swings"](tables, "fast")).axes
    assert [label.get_text() for label in ax.get_yticklabels()] == ["heading", "filter", "bias repeatability"]
    widths = [bar.get_width() for bar in ax.patches]
    assert widths == sorted(widths)
    texts = [text.get_text().strip() for text in ax.texts]
    assert "tight … loose" in texts
    assert "0.0102 deg/h … 9.93 deg/h" in texts
    assert ax.get_xlabel() == "fast (m/s, log)"


def test_a_dot_at_an_end_of_a_share_is_whole(tables) -> None:
    for ax in matplotlib_figure(PLOTS["regions"](tables)).axes:
        low, high = ax.get_ylim()
        assert low < -0.03
        assert high > 1.03
        assert list(ax.get_yticks()) == [0.0, 0.25, 0.5, 0.75, 1.0]


def test_figures_of_a_grid_are_without_intervals(tmp_path) -> None:
    grid = many_designs.grid(tmp_path)
    for name, about in (("effects", ("fast",)), ("swings", ("fast",)), ("regions", ())):
        assert matplotlib_figure(PLOTS[name](grid, *about)).axes
