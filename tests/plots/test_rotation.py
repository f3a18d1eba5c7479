"""Figures of the turning launcher show what they are given."""

from __future__ import annotations

import numpy as np

from lvnav_trade.plots.rotation import gain_sweep, inside_envelope, nozzle_movement

T = np.linspace(0.0, 100.0, 11)
BURNS = np.array([[0.0, 60.0], [150.0, 200.0]])


def test_movement_is_shown_in_degrees_run_by_run_with_the_mean_on_top():
    moved = np.radians(np.arange(3 * 11 * 2, dtype=float)).reshape(3, 11, 2)
    axes = nozzle_movement(T, {"raw rate": moved, "filtered rate": 0.5 * moved}, BURNS).axes
    assert [one.get_title() for one in axes] == ["pitch", "yaw"]
    lines = axes[1].get_lines()
    assert len(lines) == 8  # two kinds, three runs and a mean each
    np.testing.assert_allclose(lines[3].get_ydata(), np.degrees(moved[:, :, 1].mean(axis=0)))
    assert axes[0].get_ylabel().endswith("(deg)")


def test_the_envelope_is_drawn_on_both_sides_and_only_burns_in_reach_are_shaded():
    figure = inside_envelope(T, np.zeros(11), np.full(11, 0.02), np.zeros(11), np.full(11, 10.0), BURNS)
    for axes, bound in zip(figure.axes, (0.02, 10.0), strict=True):
        shown = [line.get_ydata()[0] for line in axes.get_lines()]
        np.testing.assert_allclose(sorted(shown), [-bound, 0.0, bound])
        assert len(axes.patches) == 1
    assert "(s)" in figure.axes[1].get_xlabel()


def test_the_sweep_shows_totals_and_reductions_of_both_axes():
    factors, total = np.array([0.5, 1.0, 2.0]), np.radians([[10.0, 20.0], [20.0, 30.0], [40.0, 50.0]])
    part = np.array([[0.5, 0.6], [0.6, 0.7], [0.7, 0.8]])
    left, right = gain_sweep(factors, {"raw": total}, {"published": part}).axes
    np.testing.assert_allclose(left.get_lines()[1].get_ydata(), [20.0, 30.0, 50.0])
    np.testing.assert_allclose(right.get_lines()[0].get_ydata(), [50.0, 60.0, 70.0])
