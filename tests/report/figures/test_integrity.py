import numpy as np
import pytest

from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.figure import panel
from lvnav_trade.report.figures.integrity import mark_decisions
from lvnav_trade.results.tables.read import load
from tests import synthetic

FINE = synthetic.CASES[0][0].id


@pytest.fixture(scope="module")
def tested(tmp_path_factory):
    """Return results of a filter that excludes a channel in every run at 40 s."""
    return load(synthetic.results(tmp_path_factory.mktemp("tested"), n_run=8, size=8, logic=True))


def test_decisions_are_drawn_as_part_of_the_runs(tested):
    figure = PLOTS["decisions"](tested, FINE)
    (mark,) = [mark for mark in figure.panels[0].marks if mark.label]
    assert (mark.label, mark.style["marker"]) == ("channel", "o")
    np.testing.assert_array_equal([mark.data["x"], mark.data["y"]], [[40.0], [100.0]])


@pytest.mark.parametrize("plot", [("envelope", "velocity"), ("consistency",)])
def test_figures_of_errors_and_innovations_have_a_mark_for_each_decision(tested, plot):
    figure = PLOTS[plot[0]](tested, FINE, *plot[1:])
    marks = [mark for panel in figure.panels for mark in panel.marks if mark.label == "decisions: channel"]
    assert marks
    for mark in marks:
        np.testing.assert_array_equal([mark.data["x"], mark.data["y"]], [[40.0], [0.0]])


def test_an_excluded_unit_has_a_mark_of_its_own(tested):
    """So it is of a filter that does not test its innovations itself."""
    frame = tested.integrity.assign(isolated_element="unit", channel="unit 2")
    changed = {"nominal_integrity": frame.iloc[:0], "cases": tested.cases.assign(integrity=False)}
    figure = PLOTS["envelope"](tested.with_frames(integrity=frame, **changed), FINE, "velocity")
    marks = [mark for panel in figure.panels for mark in panel.marks if mark.label == "decisions: unit"]
    assert marks
    for mark in marks:
        np.testing.assert_array_equal([mark.data["x"], mark.data["y"]], [[40.0], [0.0]])


def test_a_filter_without_tests_has_no_marks(good):
    _, ax = panel(2.0)
    mark_decisions(ax, good, FINE)
    assert ax.marks == []
