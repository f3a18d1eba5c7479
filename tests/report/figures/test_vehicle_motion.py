"""Figures of the vehicle itself: axes are labelled, figures can be saved, and they show what they are given."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.raster import figure_bytes, matplotlib_figure
from lvnav_trade.report.figures.vehicle_motion import motion, movement, singular, sweep, turning
from tests.vehicle_tables import FILTERED, LESS, RAW, tables

CASE = "aaaaaaaaaaaa"
ARGUMENTS = {
    "motion": (CASE, "acceleration"),
    "singular": (CASE,),
    "movement": (CASE,),
    "sweep": (),
    "turning": (CASE,),
}


@pytest.mark.parametrize("name", ARGUMENTS)
def test_axes_are_labelled_and_the_figure_can_be_saved(name):
    figure = matplotlib_figure(PLOTS[name](tables(), *ARGUMENTS[name]))
    grid = figure.axes[0].get_subplotspec().get_gridspec()
    for axes in figure.axes:
        assert axes.get_xlabel() or not axes.get_subplotspec().is_last_row()
        assert axes.get_ylabel() or (grid.ncols > 1 and not axes.get_subplotspec().is_first_col())
    assert len(figure_bytes(PLOTS[name](tables(), *ARGUMENTS[name]), "png")) > 5000


def test_raw_and_filtered_stand_in_one_panel_an_axis():
    figure = matplotlib_figure(motion(tables(), CASE, "rate"))
    assert len(figure.axes) == 3
    shown = {line.get_label(): line.get_ydata() for line in figure.axes[0].get_lines()}
    np.testing.assert_allclose(shown["raw, RMS of 20 runs"], RAW * 206264.8)
    np.testing.assert_allclose(shown["filtered, LinCov true"], FILTERED * 206264.8)


def test_the_sweep_shows_reductions_by_their_gain():
    figure = matplotlib_figure(sweep(tables()))
    line = next(line for line in figure.axes[0].get_lines() if line.get_marker() != "None")
    np.testing.assert_allclose(np.asarray(line.get_xdata(), dtype=float), [1.0, 2.0])
    np.testing.assert_allclose(np.asarray(line.get_ydata(), dtype=float), 100.0 * LESS)


def test_what_is_shaded_has_a_name_in_the_legend():
    assert "shaded: all runs, from the least to the largest" in {
        mark.label for mark in movement(tables(), CASE).legend()
    }
    assert "band: 40 to 80 %" in {mark.label for mark in sweep(tables(), (40.0, 80.0)).legend()}
    assert not any(mark.label.startswith("band") for mark in sweep(tables()).legend())


def test_positions_against_their_biases_stand_out():
    labels = {mark.label for mark in singular(tables(), CASE).legend()}
    assert {"all other directions", "position against its bias"} <= labels


def test_trajectory_shows_altitude_in_km(good):
    reference = good.reference[good.reference.case == CASE]
    line = matplotlib_figure(PLOTS["trajectory"](good, CASE)).axes[0].get_lines()[0]
    np.testing.assert_array_equal(line.get_ydata(), reference.altitude_m / 1e3)


class _Tables:
    """The one table that the figure reads."""

    def __init__(self, motion: pd.DataFrame) -> None:
        self.motion_history = motion


def test_the_envelope_is_drawn_on_both_sides(monkeypatch):
    t = np.linspace(0.0, 100.0, 11)
    rows = {"case": "a", "axis": "pitch", "t_s": t, "angular_acceleration_rad_per_s2": 0.0,
            "angular_acceleration_envelope_rad_per_s2": 0.02, "jerk_m_per_s3": 0.0,
            "jerk_envelope_m_per_s3": 10.0}  # fmt: skip
    monkeypatch.setattr("lvnav_trade.report.figures.style.load", lambda tables: tables)
    other = pd.DataFrame(rows | {"axis": "yaw", "angular_acceleration_envelope_rad_per_s2": 9.0})
    figure = matplotlib_figure(turning(_Tables(pd.concat([pd.DataFrame(rows), other])), "a"))
    for axes, bound in zip(figure.axes, (0.02, 10.0), strict=True):
        shown = [line.get_ydata()[0] for line in axes.get_lines()]
        np.testing.assert_allclose(sorted(shown), [-bound, 0.0, bound])
        assert len(axes.get_lines()[0].get_xdata()) == t.size  # of pitch alone
    assert "(s)" in figure.axes[1].get_xlabel()
