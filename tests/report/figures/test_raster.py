"""Pictures are small and keep the colours that one needs to read them."""

from __future__ import annotations

import io
import json
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from lvnav_trade.report.figures.browser import data_of
from lvnav_trade.report.figures.figure import SHADE, Events, Figure, canvas, panel
from lvnav_trade.report.figures.raster import figure_bytes, files, matplotlib_figure, within_a_decade
from lvnav_trade.report.figures.style import PALETTE


def test_a_colour_that_shows_in_the_legend_alone_is_kept():
    figure, axes = panel(3.0)
    for number, colour in enumerate(PALETTE[:6]):  # each line hides those before it
        axes.plot(np.arange(500), np.sin(np.linspace(0.0, 9.0, 500)), color=colour, label=str(number))
    with Image.open(io.BytesIO(figure_bytes(figure, "png"))) as image:
        found = np.array(image.convert("RGB")).reshape(-1, 3).astype(int)
    for colour in PALETTE[:6]:
        wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
        assert np.abs(found - wanted).max(axis=1).min() <= 24, colour


def test_the_colours_of_large_areas_are_left_as_they_are():
    figure, axes = panel(3.0)
    for number, colour in enumerate(PALETTE[:6]):
        axes.plot(np.arange(500), np.sin(np.linspace(0.0, 9.0 + number, 500)), color=colour, label=str(number))
    axes.axvspan(100, 140, color=SHADE, alpha=0.25)
    with Image.open(io.BytesIO(figure_bytes(figure, "png"))) as image:
        found = image.convert("RGB").getcolors(1 << 20)
    often = [colour for _, colour in sorted(found, reverse=True)[:2]]
    assert often[0] == (255, 255, 255)
    assert (230, 232, 235) in often or (230, 231, 235) in often or (230, 231, 234) in often
    assert all(max(colour) - min(colour) <= 8 for colour in often)


class Deadly(Figure):
    """A figure that ends the process in which it arrives."""

    def __reduce__(self):
        return eval, ("__import__('os')._exit(1)",)


def test_figures_whose_worker_dies_are_drawn_by_this_process(caplog) -> None:
    figure, axes = panel(2.0)
    axes.plot([0.0, 1.0], [1.0, 2.0], label="line")
    found = files({"a": Deadly(*figure), "b": figure}, jobs=2)
    assert list(found) == ["a.png", "b.png"]
    assert found["a.png"] == found["b.png"] == figure_bytes(figure, "png")
    assert caplog.messages == ["a worker process died (out of memory?); the figures are drawn one by one"]


BACKENDS = ("module://matplotlib_inline.backend_inline", "module://none.at_all", "none")
DRAW = """\
import os, sys
from multiprocessing import get_context
from lvnav_trade.report.figures.figure import panel

assert "matplotlib" not in sys.modules  # which each process imports for itself

def draw(backend):
    os.environ["MPLBACKEND"] = backend
    try:
        from lvnav_trade.report.figures.raster import figure_bytes
        figure, axes = panel(2.0)
        axes.plot([0.0, 1.0], [1.0, 2.0])
        return figure_bytes(figure, "png")[1:4].decode()
    except Exception as error:
        return type(error).__name__

with get_context("fork").Pool(1, maxtasksperchild=1) as processes:
    print(*processes.imap(draw, sys.argv[1:], chunksize=1))
"""


@pytest.fixture(scope="module")
def first_characters() -> tuple[dict[str, str], str]:
    """Return the first characters of a figure by the name of the backend, and the standard error."""
    command = [sys.executable, "-c", DRAW, *BACKENDS]
    found = subprocess.run(command, capture_output=True, text=True, check=True, timeout=600)
    return dict(zip(BACKENDS, found.stdout.split(), strict=True)), found.stderr


@pytest.mark.parametrize("name", BACKENDS)
def test_figures_need_no_backend_that_a_notebook_names(name: str, first_characters: tuple[dict[str, str], str]) -> None:
    """As `!lvnav-trade ...` in a notebook runs it: the variable names a package of another installation."""
    characters, standard_error = first_characters
    assert (characters[name], standard_error) == ("PNG", "")


def test_files_of_workers_are_those_of_one_process():
    figure, axes = panel(2.0)
    axes.plot([0.0, 1.0], [1.0, 2.0], label="line")
    found = files({"a": figure, "b": figure}, ("png", "svg"), jobs=2)
    assert list(found) == ["a.png", "a.svg", "b.png", "b.svg"]
    assert found["a.png"] == figure_bytes(figure, "png")
    assert found["b.svg"].startswith(b"<?xml")


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (0.45, 1.6, [0.5, 0.7, 1.0, 1.5]),
        (0.65, 1.6, [0.7, 0.8, 0.9, 1.0, 1.2, 1.5]),
        (8.5, 17.0, [9.0, 10.0, 11.0, 12.0, 15.0]),
        (0.3, 2.5, [0.5, 0.7, 1.0, 1.5, 2.0]),
    ],
)
def test_a_logarithmic_axis_of_less_than_a_decade_has_ticks_enough(low, high, ticks):
    assert set(ticks) <= set(within_a_decade(low, high))


def test_a_very_short_logarithmic_axis_has_even_ticks():
    found = within_a_decade(0.97, 1.08)
    assert sum(0.97 <= at <= 1.08 for at in found) >= 4
    np.testing.assert_allclose(np.diff(found), found[1] - found[0])


@pytest.mark.parametrize(
    ("low", "high", "texts"),
    [
        (0.02, 2.0, {"0.02", "0.05", "0.1", "0.2", "0.5", "1", "2"}),
        (0.0018, 2.3, {"0.002", "0.005", "0.01", "0.02", "0.5", "1", "2"}),  # decades alone would be three
    ],
)
def test_an_axis_of_few_decades_has_labels_at_one_two_and_five(low, high, texts):
    figure, axes = panel(2.0)
    axes.plot([low, high], [0.0, 1.0])
    axes.set(xscale="log", margin=0.0)
    found = matplotlib_figure(figure)
    found.draw_without_rendering()
    assert texts <= {text.get_text() for text in found.axes[0].get_xticklabels()}


@pytest.mark.parametrize(("side", "columns", "close"), [("x", 1, True), ("y", 1, True), ("x", 5, False)])
def test_numbers_between_decades_stand_where_there_is_room(side, columns, close):
    figure, grid = canvas(1, columns, 2.0)
    axes = grid[0, 0]
    at, level = [20.0, 5e4], [0.0, 1.0]
    axes.plot(*((at, level) if side == "x" else (level, at)))
    axes.set(margin=0.0, **{f"{side}scale": "log"})
    found = matplotlib_figure(figure)
    found.draw_without_rendering()
    texts = {text.get_text() for text in getattr(found.axes[0], f"get_{side}ticklabels")()}
    assert ({"200", "500"} <= texts) == close
    assert {"100", "1000"} <= texts


def test_an_axis_of_many_decades_has_labels_at_decades_alone():
    figure, axes = panel(2.0)
    axes.plot([0.5, 5e4], [0.0, 1.0])
    axes.set(xscale="log", margin=0.0)
    found = matplotlib_figure(figure)
    found.draw_without_rendering()
    assert "2" not in {text.get_text() for text in found.axes[0].get_xticklabels()}


def test_ticks_of_a_short_logarithmic_axis_are_labelled():
    figure, axes = panel(2.0)
    axes.plot([0.6, 1.4], [0.0, 1.0])
    axes.set(xscale="log")
    found = matplotlib_figure(figure)
    found.draw_without_rendering()
    texts = {text.get_text() for text in found.axes[0].get_xticklabels()}
    assert {"0.6", "0.8", "1", "1.2"} <= texts


def test_what_is_drawn_has_room_below_the_upper_edge_also_where_panels_share_it():
    figure, grid = canvas(1, 2, sharey=True)
    for axes, top in zip(grid[0], (100.0, 104.0), strict=True):
        axes.plot([0.0, 1.0], [99.0, top])
        axes.set(ylim=0.0, margin=0.0)
    for axes in matplotlib_figure(figure).axes:
        np.testing.assert_allclose(axes.get_ylim(), (0.0, 1.05 * 104.0))


def test_a_logarithmic_axis_has_room_too():
    figure, axes = panel(2.0)
    axes.plot([0.0, 1.0], [1.0, 1000.0])
    axes.set(yscale="log", margin=0.01)
    np.testing.assert_allclose(matplotlib_figure(figure).axes[0].get_ylim(), (1000.0**-0.05, 1000.0**1.05))


@pytest.mark.parametrize("filled", [True, False])
def test_faults_are_shaded_over_areas_and_below_lines(filled):
    figure, axes = panel(2.0)
    axes.fill_between([0.0, 9.0], 0.0, 1.0, **({} if filled else {"alpha": 0.2}))
    axes.plot([0.0, 9.0], [0.0, 1.0])
    axes.events = Events((), (("outage 1", 2.0, 4.0),))
    found = matplotlib_figure(figure).axes[0]
    (shade,) = found.patches
    assert found.collections[0].get_zorder() < shade.get_zorder() < found.lines[0].get_zorder()
    assert (axes.has_opaque_areas, json.loads(data_of(figure))["panels"][0]["filled"]) == (filled, filled)
    assert (max(shade.get_facecolor()[:3]) == 0.0) == filled  # on areas of colours grey does not show
