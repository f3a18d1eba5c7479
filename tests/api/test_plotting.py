"""Figures of results by name: completion, defaults, PNG and SVG."""

from __future__ import annotations

import inspect

import pytest

from lvnav_trade.api.plotting import Plots, case_digest
from lvnav_trade.api.results import Results
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.report.figures import PLOTS
from tests import synthetic

PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def found(tmp_path_factory) -> Results:
    return Results(synthetic.results(tmp_path_factory.mktemp("plotting"), n_run=8))


def test_the_names_are_those_of_the_figures(found):
    assert set(dir(found.plot)) == set(PLOTS)
    assert set(Plots.__annotations__) <= set(PLOTS)  # what editors complete is there


@pytest.mark.parametrize("name", ["envelope", "budget", "rank", "comparison", "trajectory", "consistency"])
def test_a_figure_needs_no_argument(found, name):
    drawn = getattr(found.plot, name)()
    assert drawn._repr_png_().startswith(PNG)
    assert repr(drawn).startswith(f"<Plot {name}: ")


def test_a_figure_is_that_of_the_case_and_quantity_asked_for(found):
    first, second = found.tables.labels.items()
    chosen = found.plot.envelope(second[1], quantity="position")
    by_digest = found.plot.envelope(second[0][:8], "position")
    assert chosen._repr_png_() == by_digest._repr_png_()
    assert chosen._repr_png_() != found.plot.envelope(first[1], "position")._repr_png_()
    assert chosen._repr_png_() != found.plot.envelope(second[1])._repr_png_()
    assert list(inspect.signature(found.plot.envelope).parameters) == ["case", "quantity"]


def test_a_figure_is_saved_and_changed_with_matplotlib(found, tmp_path):
    drawn = found.plot.rank()
    assert drawn.save(tmp_path / "rank.png").read_bytes().startswith(PNG)
    assert b"<svg" in drawn.save(tmp_path / "rank.svg").read_bytes()
    assert drawn.matplotlib().axes
    with pytest.raises(InputError, match=r"saved as \.png or \.svg"):
        drawn.save(tmp_path / "rank.pdf")


def test_a_wrong_name_is_answered_with_the_nearest(found):
    with pytest.raises(AttributeError, match=r"no figure 'envelop' \(did you mean 'envelope'"):
        found.plot.envelop()
    with pytest.raises(InputError, match="no case 'fine'"):
        found.plot.envelope("fine")
    with pytest.raises(TypeError):
        found.plot.curves()  # an axis has to be named


def test_a_case_is_found_by_label_digest_or_its_beginning(found):
    digests = list(found.tables.labels)
    assert case_digest(found.tables, None) == digests[0]
    assert case_digest(found.tables, found.tables.labels[digests[1]]) == digests[1]
    assert case_digest(found.tables, digests[1][:6]) == digests[1]
    with pytest.raises(InputError, match="fits several cases, give more of one"):
        case_digest(found.tables, "")
